"""Monotone cubic interpolation (PCHIP) and its inverse, for a few points.

Source: F. N. Fritsch, R. E. Carlson, "Monotone Piecewise Cubic Interpolation", SIAM J. Numer.
Anal. 17 (1980); slopes as in Fritsch, Butland (1984). Implemented here because importing scipy
takes longer than the car needs to stop.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise

from dart_hal.core.errors import NotMonotone

# Steps of the inverse: with so many, bisection alone reaches the resolution of a double.
MAX_NEWTON_STEPS = 60
# Of t in [0, 1]: a smaller step does not change a double.
MIN_NEWTON_STEP = 1e-16


class Pchip:
    """Interpolant y(x) through points with increasing x and strictly monotone y.

    Between two points y lies between their values; outside the points it is that of the nearest
    end. Raises NotMonotone.
    """

    def __init__(self, x: Sequence[float], y: Sequence[float]) -> None:
        steps = [b - a for a, b in pairwise(x)]
        rises = [b - a for a, b in pairwise(y)]
        if len(x) != len(y) or not steps or min(steps) <= 0 \
                or not (min(rises) > 0 or max(rises) < 0):
            raise NotMonotone("the points do not rise or fall throughout", found=str(list(y)))
        self.x = tuple(x)
        self.y = tuple(y)
        self._steps = steps
        self._slopes = _slopes(steps, [r / h for r, h in zip(rises, steps, strict=True)])
        self._sign = 1.0 if rises[0] > 0 else -1.0
        self._heights = [self._sign * v for v in y]     # increasing

    def __call__(self, x: float) -> float:
        """Return y at x; x outside the points is clipped."""
        if x <= self.x[0] or x >= self.x[-1]:
            return self.y[0] if x <= self.x[0] else self.y[-1]
        i = bisect_right(self.x, x) - 1
        return self._cubic(i, (x - self.x[i]) / self._steps[i])

    def inverse(self, y: float) -> float:
        """Return x at y, to rounding; y outside the points is clipped."""
        height = self._sign * y
        heights = self._heights
        if height <= heights[0] or height >= heights[-1]:
            return self.x[0] if height <= heights[0] else self.x[-1]
        i = bisect_right(heights, height) - 1
        return self.x[i] + self._solve(i, y) * self._steps[i]

    def _solve(self, i: int, y: float) -> float:
        """Return t in [0, 1] at which interval i has the value y, by safeguarded Newton steps."""
        low, high = 0.0, 1.0
        t = 0.5
        for _ in range(MAX_NEWTON_STEPS):
            # 1. Narrow the bracket [low, high] by the sign of the error at t.
            error = self._cubic(i, t) - y
            low, high = (t, high) if self._sign * error < 0.0 else (low, t)
            # 2. Take a Newton step, or bisect if it would leave the bracket.
            slope = self._steps[i] * self._slope(i, t)
            following = t - error / slope if slope else -1.0
            if not low <= following <= high:
                following = 0.5 * (low + high)
            if abs(following - t) <= MIN_NEWTON_STEP:
                break
            t = following
        return t

    def slope(self, x: float) -> float:
        """Return dy/dx at x inside the points."""
        i = min(max(bisect_right(self.x, x) - 1, 0), len(self._steps) - 1)
        return self._slope(i, (x - self.x[i]) / self._steps[i])

    def _slope(self, i: int, t: float) -> float:
        """Return dy/dx of interval i at t in [0, 1]."""
        chord = (self.y[i + 1] - self.y[i]) / self._steps[i]
        return (6 * t * (1 - t) * chord + (1 - t) * (1 - 3 * t) * self._slopes[i]
                + t * (3 * t - 2) * self._slopes[i + 1])

    def _cubic(self, i: int, t: float) -> float:
        """Return the Hermite cubic of interval i at t in [0, 1]."""
        h = self._steps[i]
        u = 1.0 - t
        return (u * u * (1 + 2 * t) * self.y[i] + t * t * (3 - 2 * t) * self.y[i + 1]
                + h * t * u * (u * self._slopes[i] - t * self._slopes[i + 1]))


def _slopes(steps: Sequence[float], chords: Sequence[float]) -> list[float]:
    """Return the slopes at the points: weighted harmonic means of the adjacent chords."""
    if len(chords) == 1:
        return [chords[0], chords[0]]
    inner = []
    for h0, h1, d0, d1 in zip(steps, steps[1:], chords, chords[1:], strict=False):
        # Fritsch and Butland: the chord of the shorter interval has the larger weight.
        w0 = 2 * h1 + h0
        w1 = h1 + 2 * h0
        inner.append((w0 + w1) / (w0 / d0 + w1 / d1))
    first = _end_slope(steps[0], steps[1], chords[0], chords[1])
    last = _end_slope(steps[-1], steps[-2], chords[-1], chords[-2])
    return [first, *inner, last]


def _end_slope(h0: float, h1: float, d0: float, d1: float) -> float:
    """Return the three-point slope at an end, limited to the sign and three times the chord."""
    slope = ((2 * h0 + h1) * d0 - h0 * d1) / (h0 + h1)
    if slope * d0 <= 0:
        return 0.0
    return 3 * d0 if d0 * d1 <= 0 and abs(slope) > abs(3 * d0) else slope
