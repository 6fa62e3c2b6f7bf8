"""The operator interface: what a person measures and does during a calibration."""

from __future__ import annotations

from math import radians
from typing import Protocol

# m, standard deviation of a tape measure on the floor, including the width of the chalk line.
TAPE_STD = 0.002
# rad, standard deviation of sighting along the side of the car.
SIGHT_STD = radians(0.5)
# kg, standard deviation of a kitchen scale: its resolution is 1 g, its repeatability 2 g.
SCALE_STD = 0.002


class Workshop(Protocol):
    """Actions of a person with chalk, tape measure, scale and car jack; a simulation has its own.

    ``mark`` marks position and heading on the floor; distance and yaw are measured from there.
    """

    def mark(self) -> None: ...

    def distance(self) -> float:
        """Return the distance rolled since the mark [m], forward positive, +- ``TAPE_STD``."""

    def turns(self) -> float:
        """Return the yaw since the mark [rad], left positive, unwrapped, +- ``SIGHT_STD``."""

    def lift(self) -> None:
        """Lift the car so that all wheels are off the ground and spin freely."""

    def set_down(self) -> None:
        """Set the car back on the floor."""

    def push(self) -> bool:
        """Turn the wheels by hand or push the car; return whether the wheels turn freely.

        They may turn for one more second.
        """

    def wheels_turned(self) -> int:
        """Return the last direction of the wheels: 1 forward, -1 backward, 0 no motion."""

    def mass(self) -> tuple[float, float]:
        """Return (reading, standard deviation) of a kitchen scale under the car [kg]."""
