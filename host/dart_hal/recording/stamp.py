"""Host time <-> MCAP stamps, without losing a bit.

MCAP counts whole nanoseconds; a float64 of seconds is finer. The rest, in
2^-32 ns, goes into the message's free ``sequence`` field, so that a replay
feeds the estimators the very stamps of the run.
"""

from __future__ import annotations

NS_PER_S = 10**9
UNITS_PER_NS = 1 << 32


def split(t: float) -> tuple[int, int]:
    """Seconds (>= 0) -> (whole ns, rest in 2^-32 ns)."""
    numerator, denominator = t.as_integer_ratio()
    # Half a unit is 1.2e-19 s, below half a float64 step from 1 ms on.
    scaled = (2 * numerator * NS_PER_S * UNITS_PER_NS + denominator) // (2 * denominator)
    return divmod(max(scaled, 0), UNITS_PER_NS)


def join(ns: int, rest: int) -> float:
    """Inverse of ``split``; exact for every t >= 1 ms and for 0."""
    return (ns * UNITS_PER_NS + rest) / (NS_PER_S * UNITS_PER_NS)
