"""Numbers that a program passes in."""

from __future__ import annotations

from numbers import Real


def is_number(value: object) -> bool:
    """Return whether a value is a real number: no text, no bool, no NaN; infinity is one.

    >>> is_number(0.5), is_number(float("nan")), is_number("0.5"), is_number(True)
    (True, False, False, False)
    """
    return isinstance(value, Real) and not isinstance(value, bool) and float(value) == float(value)
