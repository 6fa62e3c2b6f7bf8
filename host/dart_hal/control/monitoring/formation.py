"""N robots spread evenly over a Lissajous curve with a + b = N.

Then they lie on one ellipse, in the order of a X, at any time: with phi_i = a (X + 2 pi i / N)
and b = N - a

    x_i = A cos(phi_i),   y_i = -B sin(phi_i - N X).

The ellipse touches the four sides of the area. It degenerates to one diagonal, then to the other,
each time N X grows by pi. Two robots that follow each other on it have a difference of 2 pi / N in
phi and hence a distance of at most 2 r_s, r_s = sqrt(A^2 + B^2) sin(pi / N): discs of that radius
around the robots are a closed fence. Consequences for targets: docs/use_cases/monitoring.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, gcd, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from dart_hal.control.monitoring.kuramoto import is_stable
from dart_hal.control.monitoring.lissajous import Lissajous
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray

# Samples of X in 2 pi / N, after which the robots have exchanged positions.
DISTANCE_SAMPLES = 801


class FormationDistances(NamedTuple):
    """min_distance [m]: between two robots at any time; chord [m]: the longest between two that
    follow each other on the ellipse.
    """

    min_distance: float
    chord: float


@dataclass(frozen=True)
class Formation:
    """n robots with phases theta_i, 2 pi p / n from one to the next of the ring, and X = alpha
    theta.

    Raises UsageError if n is not a + b, if the state is unstable, or if positions coincide.
    """

    curve: Lissajous
    n: int
    p: int
    alpha: int = 1

    def __post_init__(self) -> None:
        a = self.curve.a
        b = self.curve.b
        n = self.n
        options = self.windings
        if n != a + b:
            raise UsageError(f"a {a}:{b} curve is fenced by {a + b} robots", found=f"{n} robots",
                             expected=f"n = a + b = {a + b}",
                             remedy=f"Formation(curve, {a + b}, p), or a curve with a + b = {n}")
        if not is_stable(n, self.p):
            raise UsageError(
                f"{n} robots are unstable with {self.p} windings",
                found=f"cos(2 pi {self.p} / {n}) >= 0",
                expected=_name_options(options),
                remedy=f"Formation(curve, {n}, {options[0] if options else 'p'})",
            )
        if gcd(self.alpha * self.p, n) != 1:
            raise UsageError("several robots would be at one position",
                             found=f"alpha p = {self.alpha * self.p}, n = {n}",
                             expected="alpha p and n without a common divisor",
                             remedy=f"for alpha = {self.alpha}: {_name_options(options)}")

    @property
    def windings(self) -> list[int]:
        """All p that are stable and spread the robots over n positions.

        The initial phases decide which one a team reaches.
        """
        return [p for p in range(1, self.n)
                if is_stable(self.n, p) and gcd(self.alpha * p, self.n) == 1]

    def slots(self, X: FloatArray | float = 0.0) -> FloatArray:
        """Return X (..., n) of the robots in the order of the ring, the first at X."""
        spacing = 2.0 * pi * self.alpha * self.p / self.n
        X_all = np.asarray(X, dtype=np.float64)[..., None] + spacing * np.arange(self.n)
        return np.asarray(X_all, dtype=np.float64)

    @property
    def sensing_radius(self) -> float:
        """r_s [m]: robots with this sensing radius enclose any target."""
        return self.curve.diagonal * sin(pi / self.n)

    @property
    def is_bound_proven(self) -> bool:
        """Whether the area is short enough for the proof of the bound: the fence then reaches all
        four walls.

        Largest aspect ratio: 1.41 for 3 robots, 2.9 for 5, 5.6 for 9.
        """
        long = max(self.curve.A, self.curve.B)
        short = min(self.curve.A, self.curve.B)
        return long * sin(0.5 * pi / self.n) <= short * sqrt(cos(pi / self.n))

    def bound(self, rate: float) -> float:
        """Return the time [s] within which any target in the area is detected, for a rate X'
        [rad/s] of the parameter: until each robot is at the former position of the next one.
        """
        return 2.0 * pi / (self.n * rate)

    def distances(self) -> FormationDistances:
        """Return the distances between the robots while they are spread evenly."""
        X = np.linspace(0.0, 2.0 * pi / self.n, DISTANCE_SAMPLES)
        positions = self.curve.position(X[:, None] + 2.0 * pi / self.n * np.arange(self.n))
        distances = np.linalg.norm(positions[:, :, None] - positions[:, None], axis=-1)
        step = pow(self.curve.a, -1, self.n)  # robots along the curve to the next on the ellipse
        i = np.arange(self.n)
        return FormationDistances(float(distances[:, ~np.eye(self.n, dtype=bool)].min()),
                                  float(distances[:, i, (i + step) % self.n].max()))


def _name_options(good: list[int]) -> str:
    """Return a text with the possible p."""
    return f"p one of {', '.join(map(str, good))}" if good else "another n: no p does with this one"
