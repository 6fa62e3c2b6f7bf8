"""The part of the page about what was found: one section per cause, and what is left."""

from __future__ import annotations

from dataclasses import replace

from dart_hal.diagnose.result import Cause, Diagnosis, Unexplained
from dart_hal.vehicle.effects import catalogue

from . import svg
from .along import Along, Rows, along, columns, most, stages_of
from .charts import before_after, share_gone, sides
from .html import Html, el, join, table
from .words import (
    channel,
    interval,
    listed,
    p_value,
    percent,
    quantity,
    sentence,
    significant,
    structure,
    variable,
)

VISIBLE = 0.02
"""Share of a mean square that must go away for a second picture."""
KEY = (("before", "before"), ("after", "with the cause in the model"))


def cause_section(d: Diagnosis, i: int, rows: Rows) -> Html:
    """Sentence, figures, physics and pictures of the cause number i."""
    cause = d.causes[i]
    known = catalogue().get(cause.effect)
    like = listed(cause.cannot_be_told_from, "and") or "nothing in the catalogue"
    facts = [el("li", text) for text in cause.evidence]
    return el(
        "section", el("h3", f"{i + 1}. {cause.effect}"),
        el("div", el("p", sentence(cause), class_="big"),
           class_="cause good" if cause.gain.low > 0.0 else "cause bad"),
        el("p", known.physics) if known is not None else Html(),
        _figures(cause), el("p", f"Enters at: {cause.enters}. Cannot be told from, with these "
                                 f"data: {like}."),
        _decides(cause),
        el("ul", *facts) if facts else Html(), _pictures(d, i, rows), id=f"cause-{i + 1}")


def unexplained_section(d: Diagnosis, rows: Rows) -> Html:
    """What is left after the last cause, with its picture."""
    if not d.unexplained:
        return el("p", "Nothing is left whose shape a flexible regression could predict on "
                       "stretches that it had not seen. That is no proof that the model is right "
                       "where these recordings did not go.")
    parts: list[Html] = []
    for u in d.unexplained:
        parts.append(el("div", el("p", structure(u)), class_="cause bad"))
        picture = _left(d, u, rows)
        if picture is not None:
            again = f", from 0 again every {u.period:.2f} m" if u.period else ""
            words = (f"{picture.column.words}, along {variable(picture.variable)}{again}: the last "
                     "model on the test recordings (found on the training recordings)")
            parts.append(el("figure", el("figcaption", words),
                            before_after(picture, u.channel, only_before=True)))
    head = ("channel", "structure", "with", "p", "share of the rest")
    return join([*parts, table(head, [
        (channel(u.channel), u.structure, ", ".join(map(variable, u.along)) or "-",
         p_value(u.p_value), percent(u.share)) for u in d.unexplained])])


def _decides(cause: Cause) -> Html:
    if not cause.experiment:
        return Html()
    lead = "What would decide" if cause.cannot_be_told_from else "A drive that would confirm it"
    return el("p", f"{lead}: {cause.experiment}")


def _figures(cause: Cause) -> Html:
    gain = cause.gain
    rows = [(f"{name}", quantity(n), significant(n.null)) for name, n in cause.parameters.items()]
    return join([
        table(("parameter", "value", "null value"), rows, 1),
        table(("channel", "gain on test data", "95 %", "on training data",
               "drop of the loss", "p"),
              [(channel(gain.channel), percent(gain.test), interval(gain), percent(gain.train),
                significant(cause.loss, 4), p_value(cause.p_value))], caption=gain.measure)])


def _pictures(d: Diagnosis, i: int, rows: Rows) -> Html:
    cause = d.causes[i]
    before, after = stages_of(d, i)
    first = most(rows, columns(d.evidence, cause.gain.channel), before, after)
    others = [c for c in columns(d.evidence)
              if first is None or c.channel != first.column.channel]
    second = most(rows, others, before, after)
    drawn = [_captioned(a, cause.effect) for a in (first, second)
             if a is not None and (a is first or a.score > VISIBLE)]
    if first is not None:
        plain = replace(first.column, folded=False)
        was, now = (rows.sides(plain, s.residuals) for s in (before, after))
        if was is not None and now is not None:
            drawn.append(el("figure", el("figcaption", f"{plain.words}: left against right"),
                            sides(was, now, plain, cause.effect)))
    if not drawn:
        return el("p", "The test recordings are too short for a picture of the residuals, or none "
                       "of them became smaller.", class_="soft")
    return join([el("div", *drawn, class_="figures"), svg.legend(KEY)])


def _captioned(a: Along, what: str) -> Html:
    words = (f"{a.column.words}, along {variable(a.variable)}: {share_gone(a)} of its mean square "
             "went with this structure")
    return el("figure", el("figcaption", words), before_after(a, what))


def _left(d: Diagnosis, u: Unexplained, rows: Rows) -> Along | None:
    """The last residual of a channel along the first variable that can be drawn."""
    wanted = columns(d.evidence, u.channel)
    for v in u.along:
        tried = [along(rows, column, v, d.stages[-1], period=u.period) for column in wanted]
        found = [a for a in tried if a is not None]
        if found:
            return max(found, key=lambda a: a.score)
    return None
