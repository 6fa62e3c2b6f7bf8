"""Formatted numbers: significant digits, values with errors, per cent, p-values, lists."""

from __future__ import annotations

import math
from collections.abc import Sequence

from dart_hal.core.rounding import with_error as with_error

# Smaller p-values are printed as "p < 0.0001": the tail of a simulated null distribution is not
# known better.
MIN_P_VALUE = 1e-4


def significant(value: float | None, digits: int = 3) -> str:
    """Format a number with so many significant digits; "-" for None, NaN and infinity."""
    if value is None or not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 10**digits else f"{value:.{digits}g}"


def percent(share: float) -> str:
    """Format a share as whole per cent; "-" for NaN and infinity."""
    return f"{100.0 * share:.0f} %" if math.isfinite(share) else "-"


def describe_change(ratio: float, low: float, high: float) -> str:
    """Format a ratio as a change: "7 % larger [+5 %, +9 %]", "0.4 % smaller [-0.6 %, -0.1 %]".

    low, high: interval of the ratio; omitted if not finite.
    """
    if not math.isfinite(ratio):
        return "larger by an unknown share"
    # Changes below 2 % get a decimal.
    digits = 1 if abs(ratio - 1.0) < 0.02 else 0
    ends = [f"{100.0 * (end - 1.0):+.{digits}f} %" for end in (low, high) if math.isfinite(end)]
    word = "larger" if ratio >= 1.0 else "smaller"
    return (f"{100.0 * abs(ratio - 1.0):.{digits}f} % {word}"
            + (f" [{', '.join(ends)}]" if len(ends) == 2 else ""))


def p_value(p: float | None) -> str:
    """Format a p-value: "p = 0.012", "p < 0.0001", "p unknown"."""
    if p is None or not math.isfinite(p):
        return "p unknown"
    return f"p < {MIN_P_VALUE:g}" if p < MIN_P_VALUE else f"p = {p:.2g}"


def join_names(names: Sequence[str], word: str) -> str:
    """Join names by commas and a last word: "a", "a or b", "a, b or c"."""
    return f" {word} ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def shorten_list(names: Sequence[str], most: int = 3) -> str:
    """Join the first ``most`` names, and count the others: "a, b, c and 4 more"."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
