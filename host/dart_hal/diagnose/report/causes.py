"""The part of the page about what was found: one section per cause, and what is left."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dart_hal.diagnose.result import Cause, Claim, Constancy, Diagnosis, Number, Unexplained
from dart_hal.diagnose.unexplained.features import UNITS
from dart_hal.report import charts, page, svg
from dart_hal.report.html import Html, el, join, table
from dart_hal.report.numbers import listed, p_value, percent, significant
from dart_hal.vehicle.effects import catalogue, equation

from .along import SIDES, WHISKER, Along, Column, Means, Rows, along, columns, most, stages_of
from .claimed import KEY as CLAIM_KEY
from .claimed import pictures
from .words import channel, claim, interval, quantity, sentence, structure, variable

VISIBLE = 0.02
"""Share of a mean square that must go away for a second picture."""
AT_ONCE = 2
"""Pictures outside of the fold, beside that of the size: a screen has no room for more."""
MARK_OFFSET = 0.08
"""Half the distance of two marks of one side of the turn, whose sides are 1 apart."""
KEY = svg.legend([("before", "before"), ("after", "with the cause in the model")])


def cause_section(d: Diagnosis, i: int, rows: Rows) -> Html:
    """One screen of the cause number i: sentence, pictures, what would decide; more in a fold."""
    cause = d.causes[i]
    known = catalogue().get(cause.effect)
    like = listed(cause.cannot_be_told_from, "and") or "nothing in the catalogue"
    drawn = list(cause_pictures(d, i, rows))
    physics = Html() if known is None else join([
        el("p", known.physics), el("pre", equation(known))])
    return el(
        "section", el("h3", f"{i + 1}. {cause.effect}"),
        page.card(el("p", sentence(cause), class_="big"), good=cause.gain.low > 0.0, kind="cause"),
        el("p", f"Cannot be told from, with these data: {like}."), _decides(cause),
        page.figures([*drawn[:AT_ONCE], *_constant(cause.effect, cause.constancy)]),
        KEY if drawn else page.soft(
            "The test recordings are too short for a picture of the residuals, or none of them "
            "became smaller."),
        page.fold("Physics, equation, numbers and evidence", physics,
                  el("p", f"Enters at: {cause.enters}."), _figures(cause),
                  page.items(cause.evidence),
                  _sizes(cause), page.figures(drawn[AT_ONCE:])), id=f"cause-{i + 1}")


def unexplained_section(d: Diagnosis, rows: Rows) -> Html:
    """What is left after the last cause, with its picture."""
    if not d.unexplained:
        return el("p", "Nothing is left whose shape a flexible regression could predict on "
                       "stretches that it had not seen. That is no proof that the model is right "
                       "where these recordings did not go.")
    parts: list[Html] = []
    for u in d.unexplained:
        parts.append(page.card(el("p", structure(u)), good=False, kind="cause"))
        left = _left(d, u, rows)
        if left is not None:
            again = f", from 0 again every {u.period:.2f} m" if u.period else ""
            words = (f"{left.column.words}, along {variable(left.variable)}{again}: the last "
                     "model on the test recordings (found on the training recordings)")
            parts.append(page.figure(words, _drawn(left, [(left.before, "before")])))
    head = ("channel", "structure", "with", "p", "share of the rest")
    return join([*parts, table(head, [
        (channel(u.channel), u.structure, ", ".join(map(variable, u.along)) or "-",
         p_value(u.p_value), percent(u.share)) for u in d.unexplained])])


def claims_section(d: Diagnosis) -> Html:
    """Parameters of the model that were wrong: one card each, and the figures in a table."""
    if not d.claims:
        return el("p", "No parameter of the model is said to have been wrong.")
    head = ("group", "quantity", "before", "after", "probability", "errors without it", "share")
    rows = [(c.title, name, significant(q.before), quantity(Number(q.after, q.std, q.unit)),
             f"{c.probability:.2f}", f"x {c.cost[0]:.2f}", percent(max(c.share, 0.0)))
            for c in d.claims for name, q in c.quantities.items()]
    return join([*(join([page.card(el("p", claim(c)), good=True, kind="cause"),
                         page.figures([*pictures(c, d), *_changes(c)])]) for c in d.claims),
                 CLAIM_KEY, table(head, rows, 2),
                 page.soft("Errors without it: those of the motion on the test recordings with the "
                           "group at its old value over those with all fitted anew, each the root "
                           "of the robust loss that the fits lower. Share: its Shapley value in "
                           "what all of them take away there.")])


def _changes(c: Claim) -> list[Html]:
    """One that is no constant, drawn."""
    return [] if c.constant else _constant(c.group, c.constancy)


def possible_section(d: Diagnosis) -> Html:
    """Names of which data left out are not sure enough."""
    if not d.possible:
        return el("p", "Nothing: every effect that the search accepted is sure enough to be shown, "
                       "or hardly more than chance.")
    head = ("effect", "probability", "drop of the loss", "what it would mean", "why not shown")
    return join([page.soft("The search accepted these, but not all that a cause must pass. They "
                           "are not in the extended model."),
                 table(head, [(p.effect, f"{p.probability:.2f}", significant(p.loss, 4),
                               f"the car {p.title}", p.why) for p in d.possible], 1)])


def _constant(of: str, found: Constancy) -> list[Html]:
    """Along what its size changes most, drawn; nothing of one that does nothing."""
    if not found.curve:
        return []
    name, unit = variable(found.along), UNITS[found.along]
    x, y, error = (np.array(v) for v in zip(*found.curve, strict=True))
    says = ("constant, it varies most with" if found.constant else "its size changes with")
    return [page.figure(
        f"{of}: {says} {name} ({p_value(found.p_value)})",
        charts.lines(f"{of}: size along {name}",
                     name if unit == "-" else f"{name} [{unit}]", "size, of the fitted one",
                     [charts.Series(x, y, WHISKER * error, "after")]))]


def _sizes(cause: Cause) -> Html:
    """Its size in each recording, where there are several."""
    if len(cause.sizes) < 2:
        return Html()
    return table(("recording", "size there, of the fitted one"), [
        (name, f"{a:.2f} +- {s:.2f}") for name, (a, s) in cause.sizes.items()], 1)


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


def cause_pictures(d: Diagnosis, i: int, rows: Rows) -> Iterator[Html]:
    """Where the cause number i shows, before and after it is in the model; the clearest first."""
    before, after = stages_of(d, i)
    effect, gained = d.causes[i].effect, d.causes[i].gain.channel
    first = most(rows, columns(d.evidence, gained), before, after)
    if first is not None:
        yield _captioned(first, effect)
    second = most(rows, [c for c in columns(d.evidence)
                         if first is None or c.channel != first.column.channel], before, after)
    if second is not None and second.score > VISIBLE:
        yield _captioned(second, effect)
    if first is not None:
        plain = replace(first.column, folded=False)
        was, now = (rows.sides(plain, s.residuals) for s in (before, after))
        if was is not None and now is not None:
            yield page.figure(f"{plain.words}: left against right", _sides(was, now, plain, effect))


def _captioned(a: Along, effect: str) -> Html:
    gone = percent(min(max(a.score, 0.0), 1.0))
    return page.figure(f"{effect}: {a.column.words}, along {variable(a.variable)}; {gone} of its "
                       "mean square went with this structure",
                       _drawn(a, [(a.before, "before"), (a.after, "after")]))


def _drawn(a: Along, shown: list[tuple[Means, str]]) -> Html:
    """Mean residual along a variable, with two standard errors."""
    name, unit = variable(a.variable), UNITS[a.variable]
    return charts.lines(f"{a.column.words} along {name}",
                        name if unit == "-" else f"{name} [{unit}]", f"error [{a.column.unit}]",
                        [charts.Series(m.x, m.mean, WHISKER * m.error, style)
                         for m, style in shown])


def _sides(before: Means, after: Means, column: Column, effect: str) -> Html:
    """Mean residual in left turns, straight on and in right turns."""
    return charts.lines(f"{effect}: {column.words}, left against right", "direction of the turn",
                        f"error [{column.unit}]",
                        [charts.Series(m.x + shift, m.mean, WHISKER * m.error, style, joined=False)
                         for m, shift, style in ((before, -MARK_OFFSET, "before"),
                                                 (after, MARK_OFFSET, "after"))], SIDES)


def _left(d: Diagnosis, u: Unexplained, rows: Rows) -> Along | None:
    """The last residual of a channel along the first variable that can be drawn."""
    wanted = columns(d.evidence, u.channel)
    for v in u.along:
        tried = [along(rows, column, v, d.stages[-1], period=u.period) for column in wanted]
        found = [a for a in tried if a is not None]
        if found:
            return max(found, key=lambda a: a.score)
    return None
