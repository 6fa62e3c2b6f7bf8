"""Lissajous curves x = A cos(a X), y = B sin(b X), and their curvature."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import gcd, hypot, isfinite, pi

import numpy as np

from dart_hal.control.paths import Path
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray

# Distance between the points of the path [m]; the spline between them is 1e-5 m off in a bend of
# 0.5 m.
POINT_SPACING = 0.05
# Positions at which the curvature is evaluated; of a 13:12 curve 300 for each lobe.
SAMPLES = 4000


@dataclass(frozen=True)
class Lissajous:
    """A Lissajous curve.

    A, B [m]: half width and half height of the area; a, b: its lobes. X [rad] goes round in 2 pi.
    Raises UsageError for impossible sizes, and for curves that cover themselves twice: a and b with
    a common divisor, or a even, which is driven to and fro.
    """

    A: float
    B: float
    a: int
    b: int

    def __post_init__(self) -> None:
        if not (isfinite(self.A) and isfinite(self.B) and min(self.A, self.B) > 0.0):
            raise UsageError("a Lissajous curve without an area", found=f"A {self.A}, B {self.B}",
                             expected="half width A and half height B in m, above 0")
        if self.a < 1 or self.b < 1 or self.a % 2 == 0 or gcd(self.a, self.b) != 1:
            raise UsageError(
                "this Lissajous curve goes over itself twice", found=f"a {self.a}, b {self.b}",
                expected="a odd, a and b without a common divisor: 1:2, 3:2, 5:4, 13:12",
                likely="with a even x = A cos(a X), y = B sin(b X) ends, and comes back on itself",
                remedy=f"Lissajous({self.A:g}, {self.B:g}, {self.a + 1 - self.a % 2}, "
                       f"{_coprime_near(self.a + 1 - self.a % 2, self.b)})")

    def position(self, X: FloatArray) -> FloatArray:
        """Return positions (..., 2) [m]."""
        return np.stack([self.A * np.cos(self.a * X), self.B * np.sin(self.b * X)], axis=-1)

    def rate(self, X: FloatArray) -> FloatArray:
        """Return |dr/dX| [m/rad]: the speed for a rate of X of 1 rad/s."""
        return np.asarray(np.hypot(self.A * self.a * np.sin(self.a * X),
                                   self.B * self.b * np.cos(self.b * X)), dtype=np.float64)

    def curvature(self, X: FloatArray) -> FloatArray:
        """Return the curvature [1/m], left positive."""
        a = self.a
        b = self.b
        dx = -self.A * a * np.sin(a * X)
        dy = self.B * b * np.cos(b * X)
        ddx = -self.A * a * a * np.cos(a * X)
        ddy = -self.B * b * b * np.sin(b * X)
        return np.asarray((dx * ddy - dy * ddx) / np.hypot(dx, dy) ** 3, dtype=np.float64)

    @cached_property
    def tightest(self) -> float:
        """Smallest radius of curvature [m]."""
        return 1.0 / float(np.abs(self.curvature(_parameters(SAMPLES))).max())

    @cached_property
    def length(self) -> float:
        """Length [m]; for periodic functions the trapezoidal rule is exact to rounding."""
        return 2.0 * pi * float(self.rate(_parameters(SAMPLES)).mean())

    @property
    def diagonal(self) -> float:
        """Half the diagonal of the area [m]."""
        return hypot(self.A, self.B)

    def scale(self, factor: float) -> Lissajous:
        """Return the same form, scaled by a factor."""
        return replace(self, A=factor * self.A, B=factor * self.B)

    def path(self) -> Path:
        """Return the closed path; it begins at X = 0, in (A, 0), upwards."""
        fine = np.append(0.0, np.cumsum(self.rate(_parameters(SAMPLES)))) / SAMPLES * 2.0 * pi
        s = np.linspace(0.0, self.length, round(self.length / POINT_SPACING), endpoint=False)
        X = np.interp(s, fine, np.linspace(0.0, 2.0 * pi, SAMPLES + 1))
        return Path.through(self.position(X), closed=True)


def _parameters(n: int) -> FloatArray:
    """Return n values of X [rad] in one period."""
    return np.linspace(0.0, 2.0 * pi, n, endpoint=False)


def _coprime_near(a: int, b: int) -> int:
    """Return the b closest to the given one without a common divisor with a."""
    return min((k for k in range(1, a + b + 2) if gcd(a, k) == 1), key=lambda k: (abs(k - b), k))
