"""Lissajous curves x = A cos(a X), y = B sin(b X), and how tight they are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import gcd, hypot, isfinite, pi

import numpy as np

from dart_hal.control.paths import Path
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray

# m between the points of the path; the spline between them is 1e-5 m off at a bend of 0.5 m.
DENSE = 0.05
# Places at which bends are looked at; of a 13:12 curve 300 to each lobe.
LOOK = 4000


@dataclass(frozen=True)
class Lissajous:
    """A, B [m]: half width and half height of the area; a, b: its lobes. X [rad] goes round in
    2 pi. Raises UsageError for sizes that are none, and for curves that go over themselves twice:
    a and b with a common divisor, or a even, which is driven to and fro."""

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
                       f"{_partner(self.a + 1 - self.a % 2, self.b)})")

    def at(self, X: FloatArray) -> FloatArray:
        """Places (..., 2) [m]."""
        return np.stack([self.A * np.cos(self.a * X), self.B * np.sin(self.b * X)], axis=-1)

    def rate(self, X: FloatArray) -> FloatArray:
        """|dr/dX| [m/rad]: the speed for a rate of X of 1 rad/s."""
        return np.asarray(np.hypot(self.A * self.a * np.sin(self.a * X),
                                   self.B * self.b * np.cos(self.b * X)), dtype=np.float64)

    def curvature(self, X: FloatArray) -> FloatArray:
        """Curvature [1/m], left positive."""
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
        return 1.0 / float(np.abs(self.curvature(_round(LOOK))).max())

    @cached_property
    def length(self) -> float:
        """Length [m]; the trapezoidal rule is exact to rounding for what is periodic."""
        return 2.0 * pi * float(self.rate(_round(LOOK)).mean())

    @property
    def diagonal(self) -> float:
        """Half the diagonal of the area [m]."""
        return hypot(self.A, self.B)

    def scaled(self, factor: float) -> Lissajous:
        """The same form, so many times as large."""
        return replace(self, A=factor * self.A, B=factor * self.B)

    def path(self) -> Path:
        """The closed path; it begins at X = 0, in (A, 0), upwards."""
        fine = np.append(0.0, np.cumsum(self.rate(_round(LOOK)))) / LOOK * 2.0 * pi
        s = np.linspace(0.0, self.length, round(self.length / DENSE), endpoint=False)
        X = np.interp(s, fine, np.linspace(0.0, 2.0 * pi, LOOK + 1))
        return Path.through(self.at(X), closed=True)


def _round(n: int) -> FloatArray:
    """n values of X [rad] once round."""
    return np.linspace(0.0, 2.0 * pi, n, endpoint=False)


def _partner(a: int, b: int) -> int:
    """The b next to the one that was asked for, without a divisor common with a."""
    return min((k for k in range(1, a + b + 2) if gcd(a, k) == 1), key=lambda k: (abs(k - b), k))
