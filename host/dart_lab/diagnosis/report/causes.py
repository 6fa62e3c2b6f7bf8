"""Sections of the page about the findings: one per cause, and the unexplained remainder."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from dart_hal.vehicle.effects import catalogue, equation_text
from dart_lab.diagnosis.result import Cause, Claim, Constancy, Diagnosis
from dart_lab.diagnosis.unexplained.features import FEATURE_UNITS
from dart_lab.report import charts, page, svg
from dart_lab.report.html import Html, el, join, table
from dart_lab.report.numbers import describe_change, p_value, percent, significant

from . import tables
from .along import (
    WHISKER_ERRORS,
    Means,
    ResidualCurve,
    ResidualRows,
    find_largest_change,
    list_columns,
)
from .claimed import LEGEND as CLAIM_LEGEND
from .claimed import pictures
from .compared import stages_around
from .explain import describe_cause, describe_claim, heading, is_small
from .patterns import Pattern
from .summary import remainder
from .words import channel, excess, interval, quantity, variable

# Minimum reduction of the mean square, as a share, for a second picture.
MIN_SECOND_SCORE = 0.02
# Pictures outside of the fold, in addition to that of the size: two columns are readable.
MAX_VISIBLE_PICTURES = 1
LEGEND = svg.legend([("before", "before"), ("after", "with the cause in the model")])


def cause_section(d: Diagnosis, i: int, rows: ResidualRows) -> Html:
    """Describe the cause number i: four sentences, pictures, and all numbers in a fold."""
    cause = d.causes[i]
    known = catalogue().get(cause.effect)
    figures = list(cause_pictures(d, i, rows))
    physics = Html() if known is None else join([
        el("p", known.physics), el("pre", equation_text(known))])
    tone = "found" if cause.constancy.constant and cause.gain.low > 0.0 else "bad"
    return el(
        "section", el("h3", f"{i + 1}. {heading(cause)}"),
        _four_sentences(describe_cause(d, i), tone),
        page.figures([*figures[:MAX_VISIBLE_PICTURES],
                      *_constancy_figure("size", cause.constancy)]),
        LEGEND if figures else page.small_print(
            "The test recordings are too short for a picture of the residuals, or none of them "
            "became smaller."),
        page.foldable("Physics, equation, numbers and evidence", physics,
                      el("p", f"Enters at: {cause.enters}."), _figures(cause),
                      page.items(cause.evidence),
                      _sizes(cause), page.figures(figures[MAX_VISIBLE_PICTURES:])),
        id=f"cause-{i + 1}")


def _four_sentences(sentences: Mapping[str, str], tone: str) -> Html:
    """Draw the box of a finding; the first sentence is the large one. tone: as of ``card``."""
    (_, first), *others = sentences.items()
    return page.card(el("p", first, class_="big"), *(
        el("p", el("strong", f"{lead}: "), text) for lead, text in others),
        tone=tone, kind="cause")


def unexplained_section(d: Diagnosis, rows: ResidualRows) -> Html:
    """Describe patterns, single moments and excesses without a cause; "" for none."""
    parts: list[Html] = []
    for u in d.unexplained:
        pattern = Pattern(d, u, rows)
        parts.append(_four_sentences(pattern.sentences(), "bad"))
        if pattern.found is not None:
            parts.append(page.figure(pattern.caption(), _draw_curve(
                pattern.found, [(pattern.found.after, "after")], pattern.names)))
    above = page.items(f"Above the noise floor: {excess(e)}." for e in d.excesses)
    shown = join([*parts, above, tables.moments(d)])
    return shown or page.text(_as_sentence(remainder(d)))


def rejected_section(d: Diagnosis) -> Html:
    """Tabulate candidates that a gate rejected; "" for none."""
    return join([_possible(d),
                 tables.considered_table(d)]) if d.possible or d.considered else Html()


def _as_sentence(words: str) -> str:
    return f"{words[0].upper()}{words[1:]}." if words else ""


def claims_section(d: Diagnosis) -> Html:
    """Describe parameters of the model that changed; "" for none."""
    if not d.claims:
        return Html()
    cards = (join([_four_sentences(describe_claim(c), _claim_tone(c)),
                   page.figures([*pictures(c, d), *_changes(c)])]) for c in d.claims)
    return join([*cards, CLAIM_LEGEND, page.small_print(
        "Errors of the motion with the group at its old value are compared with those with all "
        "groups estimated again: the root of the robust loss that the fits lower.")])


def _claim_tone(c: Claim) -> str:
    return "bad" if not c.constant else "good" if is_small(c) else "found"


def _changes(c: Claim) -> list[Html]:
    """Draw how the size of a claim changes; nothing for a constant one."""
    return [] if c.constant else _constancy_figure("change", c.constancy)


def _possible(d: Diagnosis) -> Html:
    """Tabulate effects that the search accepted and a later test did not; "" for none."""
    head = ("possible effect", "what it would mean", "probability", "loss reduction, added",
            "why not accepted")
    return table(head, [(p.effect, f"the car {p.title}", f"{p.probability:.2f}, {p.grade}",
                         significant(p.loss, 4), p.why) for p in d.possible],
                 caption="Possible, but not accepted; not in the extended model")


def _constancy_figure(name: str, found: Constancy) -> list[Html]:
    """Draw the size along the variable with which it changes most; nothing if there is no curve."""
    if not found.curve:
        return []
    along_name = variable(found.along)
    unit = FEATURE_UNITS[found.along]
    x, y, error = (np.array(v) for v in zip(*found.curve, strict=True))
    p = p_value(found.p_value)
    text = (f"no significant change of its {name} (largest with {along_name}, {p})"
            if found.constant else f"its {name} changes with {along_name} ({p})")
    return [page.figure(
        text[:1].upper() + text[1:],
        charts.draw_lines(f"{name} along {along_name}",
                          along_name if unit == "-" else f"{along_name} [{unit}]",
                          "size, of the fitted one",
                          [charts.Series(x, y, WHISKER_ERRORS * error, "after", joined=False)]))]


def _sizes(cause: Cause) -> Html:
    """Tabulate the size in each recording, if there are several."""
    if len(cause.sizes) < 2:
        return Html()
    return table(("recording", "size there, of the fitted one"), [
        (name, f"{a:.2f} +- {s:.2f}") for name, (a, s) in cause.sizes.items()], 1)


def _figures(cause: Cause) -> Html:
    gain = cause.gain
    rows = [(name, quantity(n), significant(n.null)) for name, n in cause.parameters.items()]
    return join([
        table(("parameter", "value", "null value"), rows, 1),
        table(("channel", "gain on test data", "95 %", "on training data",
               "loss reduction, added", "p"),
              [(channel(gain.channel), percent(gain.test), interval(gain), percent(gain.train),
                significant(cause.loss, 4), p_value(cause.p_value))], caption=gain.measure),
        page.small_print("All residuals of the test recordings, of motion and sensors, are "
                         f"{describe_change(*cause.cost)} without this cause, in the robust loss "
                         "of the fits. Most of them are noise, which no cause lowers.")])


def cause_pictures(d: Diagnosis, i: int, rows: ResidualRows) -> Iterator[Html]:
    """Draw the residuals in which cause number i shows, before and after; clearest first."""
    before, after = stages_around(d, i)
    variables = catalogue()[d.causes[i].effect].acts_along
    first = find_largest_change(rows, list_columns(d.evidence, d.causes[i].gain.channel), before,
                                after, variables)
    if first is not None:
        yield _curve_figure(first)
    second = find_largest_change(rows, [c for c in list_columns(d.evidence)
                         if first is None or c.channel != first.column.channel], before, after,
                  variables)
    if second is not None and second.score > MIN_SECOND_SCORE:
        yield _curve_figure(second)


def _curve_figure(a: ResidualCurve) -> Html:
    words = a.column.words
    return page.figure(f"{words[:1].upper()}{words[1:]}, along {variable(a.variable)}",
                       _draw_curve(a, [(a.before, "before"), (a.after, "after")]))


def _draw_curve(a: ResidualCurve, shown: list[tuple[Means, str]],
                names: Sequence[str] = ()) -> Html:
    """Draw mean residuals with two standard errors, along a variable or by recording."""
    name = variable(a.variable)
    unit = FEATURE_UNITS.get(a.variable, "-")
    return charts.draw_lines(
        f"{a.column.words} along {name}", name if unit == "-" else f"{name} [{unit}]",
        f"error [{a.column.unit}]",
        [charts.Series(m.x, m.mean, WHISKER_ERRORS * m.error, style, joined=not names)
         for m, style in shown], [str(i + 1) for i in range(len(names))])
