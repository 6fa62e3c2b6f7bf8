"""The part of the page about what to drive next: how far each pair would be told apart."""

from __future__ import annotations

from collections.abc import Sequence

from dart_hal.diagnose.suggest.result import ENOUGH, Suggestion

from .html import Html, el, join, table
from .words import percent, significant


def next_drives(suggestions: Sequence[Suggestion]) -> Html:
    """One paragraph for each cause that has rivals, with the commands and the separations."""
    if not suggestions:
        return el("p", "Nothing to suggest: no cause is left that another one could stand for.")
    return join([_one(s) for s in suggestions])


def _one(s: Suggestion) -> Html:
    parts = [el("h3", s.cause), el("div", el("p", f"{s.sentence()}.", class_="big"),
                                   class_="cause good" if s.enough else "cause bad")]
    if s.drive:
        parts.append(el("p", f"{s.description}; needs {s.needs} and {s.space} of floor."))
        parts.append(el("ol", *(el("li", el("code", command)) for command in s.commands)))
    if s.caution():
        parts.append(el("p", f"{s.caution()[0].upper()}{s.caution()[1:]}.", class_="warn"))
    if s.by_hand:
        parts.append(el("p", f"By hand: {s.by_hand}"))
    rows = [(p.effect, p.rival, significant(p.before), significant(p.after), percent(p.right))
            for p in s.pairs]
    if rows:
        parts.append(table(
            ("if the truth is", "and the rival", "apart now", "after this drive", "right"), rows, 2,
            "standard deviations between the two, by simulation "
            f"({ENOUGH:g} are enough); right: share of simulated repeats that name the truth"))
    return join(parts)
