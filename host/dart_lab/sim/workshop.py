"""Chalk, tape, scale and hands in the virtual world: what a person could measure and do."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np

from dart_hal.core.ports.workshop import SCALE_STD, SIGHT_STD, TAPE_STD
from dart_lab.sim.world import Truth, World

PUSH_CAR, PUSH_WHEEL, PUSHES = 4.0, 2.5, 0.3
"""N, and s: the car rolls by about 0.1 m, a wheel by about a turn."""


def _let_go(world: World) -> None:
    world.motion.drive.push = 0.0


class SimWorkshop:
    """Answers from the true motion with a person's errors, repeatable by the seed.

    ``held``: keeps a world still that another thread runs.
    """

    def __init__(self, world: World, held: AbstractContextManager[Any] | None = None) -> None:
        self._world = world
        self._held = held or nullcontext()
        self._rng = np.random.default_rng([world.car.seed, 400])
        # its own: weighing must not change what the tape says
        self._scale = np.random.default_rng([world.car.seed, 401])
        self.mark()

    def mark(self) -> None:
        """Chalk the spot and the heading."""
        here = self._truth()
        self._distance, self._yaw = here.distance, here.yaw

    def distance(self) -> float:
        """Path rolled since the mark [m], forward positive."""
        return self._truth().distance - self._distance + TAPE_STD * float(self._rng.normal())

    def turns(self) -> float:
        """Yaw since the mark [rad], left positive."""
        return self._truth().yaw - self._yaw + SIGHT_STD * float(self._rng.normal())

    def lift(self) -> None:
        """Put the car on a stand."""
        with self._held:
            self._world.lift()

    def set_down(self) -> None:
        """Put the car on the floor."""
        with self._held:
            self._world.set_down()

    def push(self) -> bool:
        """Turn the wheels by hand, or push the car; whether they turn."""
        with self._held:
            world = self._world
            if world.blocked:
                return False
            world.motion.drive.push = PUSH_WHEEL if world.stand is not None else PUSH_CAR
            world.at(world.t + PUSHES, _let_go)
        return True

    def wheels_turned(self) -> int:
        """The way of their last turning: 1 forward, -1 backward, 0 none."""
        with self._held:
            return self._world.turned

    def mass(self) -> tuple[float, float]:
        """(reading, one sigma) of the scale [kg], the car ready to drive."""
        return self._weigh(self._world.car.vehicle.body.mass), SCALE_STD

    def axle_loads(self) -> tuple[float, float, float]:
        """(front, rear, one sigma) [kg]: one axle on the scale, the other level beside it."""
        body = self._world.car.vehicle.body
        rear = body.mass * body.l_f / body.wheelbase
        return self._weigh(body.mass - rear), self._weigh(rear), SCALE_STD

    def _truth(self) -> Truth:
        with self._held:
            return self._world.truth()

    def _weigh(self, kilograms: float) -> float:
        return kilograms + SCALE_STD * float(self._scale.normal())
