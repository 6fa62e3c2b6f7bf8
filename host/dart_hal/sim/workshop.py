"""Chalk and tape in the virtual world: what a person could measure, as well as one can."""

from __future__ import annotations

import math

import numpy as np

from dart_hal.sim.world import World

TAPE = 0.002
"""m, one sigma of a tape along the floor."""

SIGHT = math.radians(0.5)
"""rad, one sigma of sighting along the car's side."""


class SimWorkshop:
    """Answers from the true motion with a person's errors, repeatable by the seed."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._rng = np.random.default_rng([world.car.seed, 400])
        self.mark()

    def mark(self) -> None:
        """Chalk the spot and the heading."""
        here = self._world.truth()
        self._distance, self._yaw = here.distance, here.yaw

    def distance(self) -> float:
        """Path rolled since the mark [m], forward positive."""
        return self._world.truth().distance - self._distance + TAPE * float(self._rng.normal())

    def turns(self) -> float:
        """Yaw since the mark [rad], left positive."""
        return self._world.truth().yaw - self._yaw + SIGHT * float(self._rng.normal())
