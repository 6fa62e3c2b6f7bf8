"""The floor that a drive may use: a rectangle, and the start of the car on it."""

from __future__ import annotations

from dataclasses import dataclass

from dart_hal.core.errors import UsageError

# [m] Free on all sides: half a car, and the errors of odometry and path following.
FLOOR_MARGIN = 0.5


@dataclass(frozen=True, slots=True)
class Floor:
    """Free floor [m]: ``length`` along the car at its start, ``width`` across."""

    length: float
    width: float

    @classmethod
    def parse(cls, text: str) -> Floor:
        """Parse "8" (a square) or "8x3". Raises UsageError."""
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
class StartPlace:
    """Start of the rear axle: free floor ``behind`` it and to its ``right`` [m]."""

    behind: float
    right: float

    def __str__(self) -> str:
        return (f"{self.behind:.1f} m of free floor behind the rear axle and "
                f"{self.right:.1f} m to its right")


@dataclass(frozen=True, slots=True)
class Fence:
    """Limits of the rear axle's position [m], in the frame of the start."""

    x_low: float
    x_high: float
    y_low: float
    y_high: float

    def inside(self, x: float, y: float) -> bool:
        """Return whether a point [m] is within the limits."""
        return self.x_low <= x <= self.x_high and self.y_low <= y <= self.y_high


def make_fence(floor: Floor, place: StartPlace, margin: float = 0.5 * FLOOR_MARGIN) -> Fence:
    """Return the floor less ``margin`` [m]; the car starts at the origin, heading along x."""
    return Fence(margin - place.behind, floor.length - place.behind - margin,
                 margin - place.right, floor.width - place.right - margin)
