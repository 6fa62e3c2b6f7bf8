"""Round values to the digits that their standard errors support."""

from __future__ import annotations

import math


def error_places(std: float) -> int:
    """Return the decimal place of the second digit of a standard error; negative left of the point.

    >>> error_places(0.0058), error_places(1300.0)
    (4, -2)
    """
    # The error is rounded first: 0.0996 becomes 0.10.
    return 1 - math.floor(math.log10(float(f"{std:.1e}")))


def to_places(value: float, places: int) -> str:
    """Format a value with so many decimals; digits left of a negative place are zero."""
    # + 0.0 turns -0.0 into 0.0.
    return f"{round(value, places) + 0.0:.{max(places, 0)}f}"


def with_error(value: float, std: float) -> str:
    """Format "value +- std": the error with two digits, the value to the same place."""
    if not math.isfinite(std):
        return f"{value:.5g} +- unknown"
    if not 1e-9 < std < 1e6:
        return f"{value:.5g} +- {std:.2g}"
    places = error_places(std)
    return f"{to_places(value, places)} +- {to_places(std, places)}"


def format_interval(value: float, std: float, half: float) -> tuple[str, str, str, str]:
    """Format value, standard error and both ends of the interval value +- half, to one place."""
    if not (math.isfinite(std) and 1e-9 < std < 1e9):
        return f"{value:.3g}", f"{std:.2g}", f"{value - half:.3g}", f"{value + half:.3g}"
    places = error_places(std)
    ends = to_places(value - half, places), to_places(value + half, places)
    return to_places(value, places), to_places(std, places), *ends
