"""Conversion of host time to MCAP stamps and back, without loss.

MCAP counts whole nanoseconds; a float64 of seconds is finer. The remainder, in 2^-32 ns, is stored
in the free ``sequence`` field of the message, so that a replay gives the estimators exactly the
stamps of the run.
"""

from __future__ import annotations

NS_PER_S = 10**9
UNITS_PER_NS = 1 << 32


def split(t: float) -> tuple[int, int]:
    """Split seconds (>= 0) into (whole ns, rest in 2^-32 ns)."""
    numerator, denominator = t.as_integer_ratio()
    # Half a unit is 1.2e-19 s, below half a float64 step from 1 ms on.
    scaled = (2 * numerator * NS_PER_S * UNITS_PER_NS + denominator) // (2 * denominator)
    return divmod(max(scaled, 0), UNITS_PER_NS)


def join(ns: int, rest: int) -> float:
    """Return the seconds of ``split``; exact for t = 0 and every t >= 1 ms."""
    return (ns * UNITS_PER_NS + rest) / (NS_PER_S * UNITS_PER_NS)
