"""The part of the page about what to drive next: how separable each pair would be after it."""

from __future__ import annotations

from collections.abc import Sequence

from dart_lab.diagnosis.suggest.result import MIN_SEPARATION, Suggestion
from dart_lab.diagnosis.suggest.sharpen import ParameterDrive
from dart_lab.report.html import Html, el, join, table
from dart_lab.report.numbers import percent, significant
from dart_lab.report.page import card, items

NOTHING = ("nothing to suggest: no cause is confounded with another effect, and no parameter was "
           "wrong")


def next_drives(suggestions: Sequence[Suggestion], drives: Sequence[ParameterDrive] = ()) -> Html:
    """One paragraph for each cause that has confounders, with the commands and the separations,
    and one for each claimed parameter."""
    if not suggestions and not drives:
        return el("p", f"{NOTHING[0].upper()}{NOTHING[1:]}.")
    return join([*map(_one, suggestions), *map(_sharper, drives)])


def _sharper(s: ParameterDrive) -> Html:
    parts = [el("h3", s.title),
             card(el("p", f"{s.sentence()}.", class_="big"), good=s.enough, kind="cause")]
    if s.drive:
        parts.append(el("p", f"{s.description}; needs {s.needs}."))
        parts.append(items((el("code", command) for command in s.commands), "ol"))
    return join([*parts, el("p", f"By hand: {s.by_hand}")])


def _one(s: Suggestion) -> Html:
    parts = [el("h3", s.cause),
             card(el("p", f"{s.sentence()}.", class_="big"), good=s.enough, kind="cause")]
    if s.drive:
        parts.append(el("p", f"{s.description}; needs {s.needs} and {s.space} of floor."))
        parts.append(items((el("code", command) for command in s.commands), "ol"))
    if s.caution():
        parts.append(el("p", f"{s.caution()[0].upper()}{s.caution()[1:]}.", class_="warn"))
    if s.by_hand:
        parts.append(el("p", f"By hand: {s.by_hand}"))
    rows = [(p.effect, p.confounder, significant(p.before), significant(p.after), percent(p.right))
            for p in s.pairs]
    return join([*parts, table(
        ("if the truth is", "confounder", "separation now", "after this drive", "right"), rows, 2,
        "standard deviations between the two, by simulation "
        f"({MIN_SEPARATION:g} are enough); right: share of simulated repeats that name the truth")])
