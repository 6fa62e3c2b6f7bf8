"""Section of the page about the next drive: the predicted separation of each pair."""

from __future__ import annotations

from collections.abc import Sequence

from dart_lab.diagnosis.suggest.result import MIN_SEPARATION, Suggestion
from dart_lab.diagnosis.suggest.sharpen import ParameterDrive
from dart_lab.report.html import Html, el, join, table
from dart_lab.report.numbers import percent, significant
from dart_lab.report.page import card, items

NOTHING_TO_SUGGEST = ("nothing to suggest: no cause is confounded with another effect, and no "
                      "parameter was wrong")


def next_drives(suggestions: Sequence[Suggestion], drives: Sequence[ParameterDrive] = ()) -> Html:
    """Describe one drive for each cause that has confounders, and for each claimed parameter."""
    if not suggestions and not drives:
        return el("p", f"{NOTHING_TO_SUGGEST[0].upper()}{NOTHING_TO_SUGGEST[1:]}.")
    return join([*map(_cause_drive, suggestions), *map(_parameter_drive, drives)])


def _parameter_drive(s: ParameterDrive) -> Html:
    """Describe the drive for a claimed parameter."""
    parts = [el("h3", s.title),
             card(el("p", f"{s.sentence()}.", class_="big"), good=s.enough, kind="cause")]
    if s.drive:
        parts.append(el("p", f"{s.description}; needs {s.needs}."))
        parts.append(items((el("code", command) for command in s.commands), "ol"))
    return join([*parts, el("p", f"By hand: {s.by_hand}")])


def _cause_drive(s: Suggestion) -> Html:
    """Describe the drive for a cause, with its commands and separations."""
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
        f"({MIN_SEPARATION:g} are enough); right: share of simulated repeats in which the "
        "true effect fits better")])
