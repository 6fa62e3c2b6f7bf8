"""Measurements and actions of a person at a simulated car: chalk, tape, scale and hands."""

from __future__ import annotations

import math
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np

from dart_hal.core.ports.workshop import SCALE_STD, SIGHT_STD, TAPE_STD
from dart_lab.sim.world import Truth, World

# Forces of a push at the car and at a wheel [N], and its duration [s]. The car rolls by about
# 0.1 m, a wheel by about a turn.
PUSH_CAR = 4.0
PUSH_WHEEL = 2.5
PUSH_TIME = 0.3
# rad/s at which the car is turned by hand, and seconds until the hand begins.
HAND_TURN_RATE = 1.5
HAND_TURN_DELAY = 0.2
# Turns of the driven wheels per turn of the gear with the marks, and one sigma of turns that are
# counted by a mark on the tyre.
GEAR_TURNS_PER_WHEEL_TURN = 39 / 11
WHEEL_TURN_STD = 0.05
# s, one sigma of a stopwatch.
STOPWATCH_STD = 0.1


def _release(world: World) -> None:
    world.motion.drive.push = 0.0


def _stop_turning(world: World) -> None:
    world.hand_rate = 0.0


class SimWorkshop:
    """Measures the true motion with the errors of a person, repeatable by the seed.

    ``lock``: stops a world that another thread runs.
    """

    def __init__(self, world: World, lock: AbstractContextManager[Any] | None = None) -> None:
        self._world = world
        self._lock = lock or nullcontext()
        self._rng = np.random.default_rng([world.car.seed, 400])
        # A generator of its own, so that weighing does not change the readings of the tape.
        self._scale = np.random.default_rng([world.car.seed, 401])
        self._instruments = np.random.default_rng([world.car.seed, 402])
        self.mark()

    def mark(self) -> None:
        """Chalk the spot and the heading."""
        here = self._truth()
        self._distance = here.distance
        self._yaw = here.yaw

    def distance(self) -> float:
        """Return the path rolled since the mark [m], forward positive."""
        return self._truth().distance - self._distance + TAPE_STD * float(self._rng.normal())

    def turns(self) -> float:
        """Return the yaw since the mark [rad], left positive."""
        return self._truth().yaw - self._yaw + SIGHT_STD * float(self._rng.normal())

    def lift(self) -> None:
        """Lift the wheels off the ground."""
        with self._lock:
            self._world.lift()

    def set_down(self) -> None:
        """Put the car on the floor."""
        with self._lock:
            self._world.set_down()

    def push(self) -> bool:
        """Turn the wheels by hand, or push the car; return whether they turn."""
        with self._lock:
            world = self._world
            if world.blocked:
                return False
            world.motion.drive.push = PUSH_WHEEL if world.lifted is not None else PUSH_CAR
            world.schedule(world.t + PUSH_TIME, _release)
        return True

    def wheels_turned(self) -> int:
        """Return the direction of the last turn of the wheels: 1 forward, -1 backward, 0 none."""
        with self._lock:
            return self._world.wheel_direction

    def wheel_turns(self) -> float:
        """Return the turns of a driven wheel since the car was lifted, forward positive."""
        with self._lock:
            lifted = self._world.lifted
            distance = lifted.distance if lifted is not None else 0.0
            per_turn = self._world.car.gear_revolution * GEAR_TURNS_PER_WHEEL_TURN
        return distance / per_turn + WHEEL_TURN_STD * float(self._instruments.normal())

    def rotate(self, turns: int) -> None:
        """Turn the car on the spot by full turns, left positive, and leave it at rest."""
        rate = math.copysign(HAND_TURN_RATE, turns)

        def start(world: World) -> None:
            world.hand_rate = rate

        with self._lock:
            world = self._world
            begin = world.t + HAND_TURN_DELAY
            world.schedule(begin, start)
            world.schedule(begin + 2.0 * math.pi * turns / rate, _stop_turning)

    def read_instrument(self, key: str, question: str) -> float | None:
        """Return what an instrument shows; None for what the simulation does not contain."""
        with self._lock:
            world = self._world
            if key == "pwm_frequency_scope":
                return 1.0 / world.pca.output.period
            if key == "neutral_pulse_scope":
                return world.esc.width_us
            if key == "esc_arm_time":
                return (world.car.esc.arm_time
                        + STOPWATCH_STD * float(self._instruments.normal()))
        return None

    def mass(self) -> tuple[float, float]:
        """Return (reading, standard deviation) of the scale [kg], for the car ready to drive."""
        return self._weigh(self._world.car.vehicle.body.mass), SCALE_STD

    def axle_loads(self) -> tuple[float, float, float]:
        """Return (front, rear, standard deviation) [kg], the other axle at the same height."""
        body = self._world.car.vehicle.body
        rear = body.mass * body.l_f / body.wheelbase
        return self._weigh(body.mass - rear), self._weigh(rear), SCALE_STD

    def _truth(self) -> Truth:
        with self._lock:
            return self._world.truth()

    def _weigh(self, kilograms: float) -> float:
        return kilograms + SCALE_STD * float(self._scale.normal())
