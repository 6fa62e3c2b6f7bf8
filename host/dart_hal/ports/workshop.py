"""The person beside the car."""

from __future__ import annotations

from typing import Protocol


class Workshop(Protocol):
    """What a person with chalk, a tape and a scale answers; a simulated car brings its own.

    ``mark`` chalks the spot and the heading; the others are measured from there.
    """

    def mark(self) -> None: ...

    def distance(self) -> float:
        """Path rolled since the mark [m], forward positive, +- 2 mm."""

    def turns(self) -> float:
        """Yaw since the mark [rad], left positive, full turns counted, +- 0.5 deg."""

    def mass(self) -> tuple[float, float]:
        """(reading, one sigma) of a kitchen scale under the car [kg]."""

    def axle_loads(self) -> tuple[float, float, float]:
        """(front, rear, one sigma) [kg]: one axle on the scale at a time, the car level."""
