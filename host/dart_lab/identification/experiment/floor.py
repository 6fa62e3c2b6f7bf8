"""The floor that a drive may use: a rectangle, and where on it the car stands."""

from __future__ import annotations

from dataclasses import dataclass

from dart_hal.core.errors import UsageError

MARGIN = 0.5
"""m kept free on all sides: half a car, and what odometry and path keeping are off."""


@dataclass(frozen=True, slots=True)
class Floor:
    """Free floor [m]: ``length`` along the car as it stands, ``width`` across."""

    length: float
    width: float

    @classmethod
    def parse(cls, text: str) -> Floor:
        """"8" (a square) or "8x3". Raises UsageError."""
        parts = text.lower().replace("m", "").split("x")
        try:
            sides = [float(part) for part in parts]
        except ValueError:
            sides = []
        if len(sides) not in (1, 2) or not all(0.5 <= side <= 200.0 for side in sides):
            raise UsageError(f"--space {text!r} is not a floor", found=text,
                             expected="metres, 0.5 to 200: 8 for a square of 8 m by 8 m, or 8x3 "
                                      "for 8 m along the car and 3 m across")
        return cls(sides[0], sides[-1])

    def __str__(self) -> str:
        return f"{self.length:g} m x {self.width:g} m"


@dataclass(frozen=True, slots=True)
class Place:
    """Where the rear axle stands: ``behind`` and ``right`` [m] are free floor there."""

    behind: float
    right: float

    def __str__(self) -> str:
        return (f"{self.behind:.1f} m of free floor behind the rear axle and "
                f"{self.right:.1f} m to its right")


@dataclass(frozen=True, slots=True)
class Fence:
    """What the rear axle may not leave [m], in the frame of the car at the start."""

    x_low: float
    x_high: float
    y_low: float
    y_high: float

    def inside(self, x: float, y: float) -> bool:
        """Whether a point [m] lies within."""
        return self.x_low <= x <= self.x_high and self.y_low <= y <= self.y_high


def fence_of(floor: Floor, place: Place, margin: float = 0.5 * MARGIN) -> Fence:
    """The floor less ``margin`` [m]; the car stands at the origin and looks along x."""
    return Fence(margin - place.behind, floor.length - place.behind - margin,
                 margin - place.right, floor.width - place.right - margin)
