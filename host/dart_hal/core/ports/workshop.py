"""The person beside the car."""

from __future__ import annotations

from math import radians
from typing import Protocol

TAPE = 0.002
"""m, one sigma of a tape along the floor, with what the chalk is wide."""
SIGHT = radians(0.5)
"""rad, one sigma of sighting along the car's side."""
SCALE = 0.002
"""kg, one sigma of a kitchen scale: its last digit is a gram, and it repeats to two."""


class Workshop(Protocol):
    """What a person with chalk, a tape, a scale and a stand does; a simulated car brings its own.

    ``mark`` chalks the spot and the heading; the others are measured from there.
    """

    def mark(self) -> None: ...

    def distance(self) -> float:
        """Path rolled since the mark [m], forward positive, +- ``TAPE``."""

    def turns(self) -> float:
        """Yaw since the mark [rad], left positive, full turns counted, +- ``SIGHT``."""

    def lift(self) -> None:
        """Puts the car on a stand, all wheels off the ground and free to spin."""

    def set_down(self) -> None:
        """Puts the car back on the floor."""

    def push(self) -> bool:
        """Turns the wheels by hand, on the floor by pushing the car; whether they turn freely.

        They may turn for a second after the answer.
        """

    def wheels_turned(self) -> int:
        """Which way the wheels turned when they last did: 1 forward, -1 backward, 0 not at all."""

    def mass(self) -> tuple[float, float]:
        """(reading, one sigma) of a kitchen scale under the car [kg]."""

    def axle_loads(self) -> tuple[float, float, float]:
        """(front, rear, one sigma) [kg]: one axle on the scale at a time, the car level."""
