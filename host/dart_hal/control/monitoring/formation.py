"""N robots spread evenly over a Lissajous curve with a + b = N.

Then they lie on one ellipse, in the order of a X, at any time: with phi_i = a (X + 2 pi i / N)
and b = N - a

    x_i = A cos(phi_i),   y_i = -B sin(phi_i - N X).

The ellipse touches the four sides of the area, and falls together to one diagonal, then to the
other, each time N X grows by pi. Two robots that follow each other on it are 2 pi / N apart in phi
and hence at most 2 r_s, r_s = sqrt(A^2 + B^2) sin(pi / N): discs of that radius about the robots
are a closed fence. What follows for targets: docs/use_cases/monitoring.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, gcd, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from dart_hal.control.monitoring.kuramoto import stable
from dart_hal.control.monitoring.lissajous import Lissajous
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray

# Values of X in 2 pi / N, after which the robots have changed places.
LOOK = 801


class Distances(NamedTuple):
    """least [m] between two robots at any time; chord [m]: the longest between two that follow each
    other on the ellipse."""

    least: float
    chord: float


@dataclass(frozen=True)
class Formation:
    """n robots whose phases theta_i, 2 pi p / n from one to the next of the ring, are X = alpha
    theta. Raises UsageError where they are not a + b, would not stay there, or would not be spread.
    """

    curve: Lissajous
    n: int
    p: int
    alpha: int = 1

    def __post_init__(self) -> None:
        a = self.curve.a
        b = self.curve.b
        n = self.n
        good = self.windings
        if n != a + b:
            raise UsageError(f"a {a}:{b} curve is fenced by {a + b} robots", found=f"{n} robots",
                             expected=f"n = a + b = {a + b}",
                             remedy=f"Formation(curve, {a + b}, p), or a curve with a + b = {n}")
        if not stable(n, self.p):
            raise UsageError(f"{n} robots do not stay {self.p} windings apart",
                             found=f"cos(2 pi {self.p} / {n}) >= 0", expected=_one_of(good),
                             remedy=f"Formation(curve, {n}, {good[0] if good else 'p'})")
        if gcd(self.alpha * self.p, n) != 1:
            raise UsageError("several robots would be at one place",
                             found=f"alpha p = {self.alpha * self.p}, n = {n}",
                             expected="alpha p and n without a common divisor",
                             remedy=f"for alpha = {self.alpha}: {_one_of(good)}")

    @property
    def windings(self) -> list[int]:
        """All p that are stable and spread the robots over n places; which one a team finds depends
        on where it begins."""
        return [p for p in range(1, self.n)
                if stable(self.n, p) and gcd(self.alpha * p, self.n) == 1]

    def slots(self, X: FloatArray | float = 0.0) -> FloatArray:
        """X (..., n) of the robots in the order of the ring, where that of the first is X."""
        apart = 2.0 * pi * self.alpha * self.p / self.n
        at = np.asarray(X, dtype=np.float64)[..., None] + apart * np.arange(self.n)
        return np.asarray(at, dtype=np.float64)

    @property
    def sensing_radius(self) -> float:
        """r_s [m]: robots that see so far fence any target in."""
        return self.curve.diagonal * sin(pi / self.n)

    @property
    def proven(self) -> bool:
        """Whether the area is not too long for the proof of the bound: the fence then reaches all
        four walls. 1.41 for 3 robots, 2.9 for 5, 5.6 for 9."""
        long = max(self.curve.A, self.curve.B)
        short = min(self.curve.A, self.curve.B)
        return long * sin(0.5 * pi / self.n) <= short * sqrt(cos(pi / self.n))

    def bound(self, rate: float) -> float:
        """s within which any target in the area is seen, for a rate X' [rad/s] of the curve's
        parameter: until each robot is where the next one was."""
        return 2.0 * pi / (self.n * rate)

    def distances(self) -> Distances:
        """Between the robots, while they are spread evenly."""
        X = np.linspace(0.0, 2.0 * pi / self.n, LOOK)
        at = self.curve.at(X[:, None] + 2.0 * pi / self.n * np.arange(self.n))
        to = np.linalg.norm(at[:, :, None] - at[:, None], axis=-1)
        step = pow(self.curve.a, -1, self.n)  # places on the curve to the next on the ellipse
        i = np.arange(self.n)
        return Distances(float(to[:, ~np.eye(self.n, dtype=bool)].min()),
                         float(to[:, i, (i + step) % self.n].max()))


def _one_of(good: list[int]) -> str:
    return f"p one of {', '.join(map(str, good))}" if good else "another n: no p does with this one"
