"""Numbers as a reader wants them: few digits, an error beside the value, per cent, p-values."""

from __future__ import annotations

import math
from collections.abc import Sequence

SURE = 1e-4
"""p-values below it are not written out: the tail of a null has no more digits."""


def significant(value: float | None, digits: int = 3) -> str:
    """A number for a table; "-" where there is none."""
    if value is None or not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 10**digits else f"{value:.{digits}g}"


def with_error(value: float, std: float) -> str:
    """value +- std: the error with two digits, the value to the same place."""
    if not math.isfinite(std):
        return f"{value:.5g} +- unknown"
    if not 1e-9 < std < 1e6:
        return f"{value:.5g} +- {std:.2g}"
    place = 1 - math.floor(math.log10(float(f"{std:.1e}")))
    value, std = round(value, place) + 0.0, round(std, place)  # + 0.0: no minus zero
    return f"{value:.{max(place, 0)}f} +- {std:.{max(place, 0)}f}"


def percent(share: float) -> str:
    """A share as whole per cent; "-" where there is none."""
    return f"{100.0 * share:.0f} %" if math.isfinite(share) else "-"


def larger(ratio: float, low: float, high: float) -> str:
    """A ratio as a change: "7 % larger [+5 %, +9 %]", "0.4 % smaller [-0.6 %, -0.1 %]".

    low, high: of its interval; it is left out where they are not known.
    """
    if not math.isfinite(ratio):
        return "larger by an unknown share"
    digits = 1 if abs(ratio - 1.0) < 0.02 else 0
    ends = [f"{100.0 * (end - 1.0):+.{digits}f} %" for end in (low, high) if math.isfinite(end)]
    word = "larger" if ratio >= 1.0 else "smaller"
    return (f"{100.0 * abs(ratio - 1.0):.{digits}f} % {word}"
            + (f" [{', '.join(ends)}]" if len(ends) == 2 else ""))


def p_value(p: float | None) -> str:
    """"p = 0.012", "p < 0.0001"; "p unknown" where there is none."""
    if p is None or not math.isfinite(p):
        return "p unknown"
    return f"p < {SURE:g}" if p < SURE else f"p = {p:.2g}"


def listed(names: Sequence[str], word: str) -> str:
    """"a", "a or b", "a, b or c"."""
    return f" {word} ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def some(names: Sequence[str], most: int = 3) -> str:
    """The first of them, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
