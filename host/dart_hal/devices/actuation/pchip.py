"""Monotone cubic interpolation (PCHIP) and its inverse, for a few points.

Source: F. N. Fritsch, R. E. Carlson, "Monotone Piecewise Cubic Interpolation",
SIAM J. Numer. Anal. 17 (1980); slopes as in Fritsch, Butland (1984). Written
out here because scipy takes longer to import than the car to stop.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise

from dart_hal.core.errors import NotMonotone

STEPS = 60
"""At most so many steps of the inverse: bisection alone would reach a double's resolution."""
RESOLUTION = 1e-16
"""Of t in [0, 1]: a Newton step below it changes nothing."""


class Pchip:
    """y(x) through points with x rising and y rising or falling throughout.

    Between two points y stays between theirs; outside it stays at the end
    values. Raises NotMonotone.
    """

    def __init__(self, x: Sequence[float], y: Sequence[float]) -> None:
        steps = [b - a for a, b in pairwise(x)]
        rises = [b - a for a, b in pairwise(y)]
        if len(x) != len(y) or not steps or min(steps) <= 0 \
                or not (min(rises) > 0 or max(rises) < 0):
            raise NotMonotone("the points do not rise or fall throughout", found=str(list(y)))
        self.x, self.y = tuple(x), tuple(y)
        self._steps = steps
        self._slopes = _slopes(steps, [r / h for r, h in zip(rises, steps, strict=True)])
        self._sign = 1.0 if rises[0] > 0 else -1.0
        self._heights = [self._sign * v for v in y]     # rising, whichever way y goes

    def __call__(self, x: float) -> float:
        """y at x; x outside the points counts as the nearest end."""
        if x <= self.x[0] or x >= self.x[-1]:
            return self.y[0] if x <= self.x[0] else self.y[-1]
        i = bisect_right(self.x, x) - 1
        return self._cubic(i, (x - self.x[i]) / self._steps[i])

    def inverse(self, y: float) -> float:
        """x at y, to rounding; y outside the points counts as the nearest end."""
        aim, heights = self._sign * y, self._heights
        if aim <= heights[0] or aim >= heights[-1]:
            return self.x[0] if aim <= heights[0] else self.x[-1]
        i = bisect_right(heights, aim) - 1
        return self.x[i] + self._solve(i, y) * self._steps[i]

    def _solve(self, i: int, y: float) -> float:
        """t in [0, 1] at which interval i has height y: Newton, kept inside by bisection."""
        low, high, t = 0.0, 1.0, 0.5
        for _ in range(STEPS):
            over = self._cubic(i, t) - y
            low, high = (t, high) if self._sign * over < 0.0 else (low, t)
            slope = self._steps[i] * self._slope(i, t)
            ahead = t - over / slope if slope else -1.0
            if not low <= ahead <= high:
                ahead = 0.5 * (low + high)
            if abs(ahead - t) <= RESOLUTION:
                break
            t = ahead
        return t

    def slope(self, x: float) -> float:
        """dy/dx at x inside the points."""
        i = min(max(bisect_right(self.x, x) - 1, 0), len(self._steps) - 1)
        return self._slope(i, (x - self.x[i]) / self._steps[i])

    def _slope(self, i: int, t: float) -> float:
        chord = (self.y[i + 1] - self.y[i]) / self._steps[i]
        return (6 * t * (1 - t) * chord + (1 - t) * (1 - 3 * t) * self._slopes[i]
                + t * (3 * t - 2) * self._slopes[i + 1])

    def _cubic(self, i: int, t: float) -> float:
        """Hermite cubic of interval i at t in [0, 1]."""
        h, u = self._steps[i], 1.0 - t
        return (u * u * (1 + 2 * t) * self.y[i] + t * t * (3 - 2 * t) * self.y[i + 1]
                + h * t * u * (u * self._slopes[i] - t * self._slopes[i + 1]))


def _slopes(steps: Sequence[float], chords: Sequence[float]) -> list[float]:
    """Slopes at the points: weighted harmonic means of the chords beside them."""
    if len(chords) == 1:
        return [chords[0], chords[0]]
    inner = []
    for h0, h1, d0, d1 in zip(steps, steps[1:], chords, chords[1:], strict=False):
        w0, w1 = 2 * h1 + h0, h1 + 2 * h0
        inner.append((w0 + w1) / (w0 / d0 + w1 / d1))
    first = _end_slope(steps[0], steps[1], chords[0], chords[1])
    last = _end_slope(steps[-1], steps[-2], chords[-1], chords[-2])
    return [first, *inner, last]


def _end_slope(h0: float, h1: float, d0: float, d1: float) -> float:
    """Three-point slope at an end, held to the sign and three times the chord."""
    slope = ((2 * h0 + h1) * d0 - h0 * d1) / (h0 + h1)
    if slope * d0 <= 0:
        return 0.0
    return 3 * d0 if d0 * d1 <= 0 and abs(slope) > abs(3 * d0) else slope
