"""Plan the pulses of a steering calibration, and predict the floor and time they need.

The path on the floor is a sequence of arcs. Before each sweep the car circles until the sweep will
stay near the start. This is predicted for cars with different trim, gain and backlash.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Steering
from dart_hal.vehicle.sets import PAPER
from dart_hal.vehicle.steering import make_steering

# m/s; low, and different enough to show the slip.
SWEEP_SPEEDS = (0.35, 0.55)
LEVEL_COUNT = 13
# s; delay 0.15, five servo lags, response of the speed loop to the new drag.
SETTLE_TIME = 0.8
# s; about 5 revolutions of the ring.
MEASURE_TIME = 0.7
# s at rest for the gyro bias.
BIAS_TIME = 3.0
# s to reach the first speed.
START_TIME = 3.0
# m; half a car, and the error of the predicted path.
PATH_MARGIN = 1.0
# Possible cars: trim as a share of the command range, gain, and backlash with servo lag [rad].
POSSIBLE_TRIMS = (-0.06, -0.03, 0.0, 0.03, 0.06)
POSSIBLE_GAINS = (0.9, 1.1)
POSSIBLE_PLAYS = (0.01, 0.03, 0.05)
# s between points of a predicted path.
PATH_STEP = 0.1
# Headings that are tried on one circle.
CANDIDATE_HEADINGS = 36


@dataclass(frozen=True, slots=True)
class SteeringStep:
    """One window: command -1..1 and its pulse, direction of approach, reference speed [m/s]."""

    command: float
    pulse_us: float
    direction: int
    speed: float


@dataclass(frozen=True, slots=True)
class SteeringPlan:
    """Plan of the procedure, shown before anything moves.

    time [s] at most; radius [m] of the free floor around the start; speed [m/s] and path [m] at
    most.
    """

    steps: tuple[SteeringStep, ...]
    time: float
    radius: float
    speed: float
    path: float
    wheelbase: float
    tools: tuple[str, ...] = ()

    def __str__(self) -> str:
        return (f"drives about {self.path:.0f} m of slow arcs in at most {self.time:.0f} s at up "
                f"to {self.speed:.2f} m/s, from full right to full left and back; needs a free "
                f"floor of {self.radius:.1f} m around the car")

    @property
    def forth(self) -> tuple[SteeringStep, ...]:
        """The sweep from right to left."""
        return self.steps[:len(self.steps) // 2]

    @property
    def back(self) -> tuple[SteeringStep, ...]:
        """The sweep from left to right."""
        return self.steps[len(self.steps) // 2:]


def make_steps(*, center_us: float, span_us: float, direction: int, count: float,
               levels: int = LEVEL_COUNT, speeds: tuple[float, float] = SWEEP_SPEEDS
               ) -> tuple[SteeringStep, ...]:
    """Make the steps from full right to full left at low speed, and back at higher speed.

    Every pulse is a whole number of counts, so that the servo is not dithered within its backlash.
    """
    grid = []
    for i in range(levels):
        target = -1.0 + 2.0 * i / (levels - 1)
        ticks = round((center_us + direction * span_us * target) / count)
        pulse = ticks * count
        grid.append(((pulse - center_us) / (direction * span_us), pulse))
    steps: list[SteeringStep] = []
    last = 0.0
    for rising, speed in ((True, speeds[0]), (False, speeds[1])):
        for command, pulse in grid if rising else grid[::-1]:
            sign = (command > last) - (command < last)
            direction = sign or (steps[-1].direction if steps else 0)
            steps.append(SteeringStep(command, pulse, direction, speed))
            last = command
    return tuple(steps)


def possible_cars() -> list[tuple[Steering, float]]:
    """(map, backlash [rad]) of cars that differ in trim, gain and backlash."""
    base = PAPER.steering
    return [(replace(base, s0=base.s0 + trim, a_left_rad=base.a_left_rad * gain,
                     a_right_rad=base.a_right_rad * gain), play)
            for trim in POSSIBLE_TRIMS for gain in POSSIBLE_GAINS for play in POSSIBLE_PLAYS]


def make_legs(steps: tuple[SteeringStep, ...], wheelbase: float, car: tuple[Steering, float]
              ) -> list[Leg]:
    """Arcs of a sweep of a car whose wheels lag by half the backlash. wheelbase [m]."""
    steering, play = car
    curve = make_steering(steering)
    return [Leg(s.speed, s.speed * math.tan(curve(s.command) - 0.5 * play * s.direction)
                / wheelbase, SETTLE_TIME + MEASURE_TIME) for s in steps]


def return_futures(back: tuple[SteeringStep, ...], yaw_per_metre: list[float], wheelbase: float
                   ) -> list[list[Leg]]:
    """Arcs of the sweep back for each possible backlash, by the curvature of the first sweep.

    yaw_per_metre [rad/m] of the levels in the order of ``back``.
    """
    return [[Leg(s.speed, s.speed * (k + play / wheelbase), SETTLE_TIME + MEASURE_TIME)
             for s, k in zip(back, yaw_per_metre, strict=True)] for play in POSSIBLE_PLAYS]


@lru_cache(maxsize=8)
def make_plan(steps: tuple[SteeringStep, ...], wheelbase: float) -> SteeringPlan:
    """Compute time, path and floor: the largest over all possible cars."""
    plan = SteeringPlan(steps, 0.0, 0.0, max(s.speed for s in steps), 0.0, wheelbase)
    time = radius = path = 0.0
    futures = [make_legs(plan.forth, wheelbase, car) for car in possible_cars()]
    for car in possible_cars():
        legs = _rehearse(plan, car, futures)
        points, _ = trace(Spot(0.0, 0.0, 0.0), legs)
        radius = max(radius, float(np.hypot(points[:, 0], points[:, 1]).max()))
        time = max(time, sum(g.seconds for g in legs))
        path = max(path, sum(g.seconds * g.speed for g in legs))
    return replace(plan, time=BIAS_TIME + time + 1.0, radius=radius + PATH_MARGIN, path=path)


def _rehearse(plan: SteeringPlan, car: tuple[Steering, float], futures: list[list[Leg]]
              ) -> list[Leg]:
    """Arcs of the whole drive of a car: start, wait, sweep, wait, sweep."""
    forth = make_legs(plan.forth, plan.wheelbase, car)
    back = make_legs(plan.back, plan.wheelbase, car)
    start = Leg(forth[0].speed, forth[0].yaw_rate, START_TIME + SETTLE_TIME)
    centre = (0.0, 0.0)
    _, spot = trace(Spot(0.0, 0.0, 0.0), [start])
    first = waiting_time(spot, forth[0].speed, forth[0].yaw_rate, futures, centre)
    legs = [start, Leg(forth[0].speed, forth[0].yaw_rate, first), *forth,
            Leg(back[0].speed, back[0].yaw_rate, SETTLE_TIME)]
    _, spot = trace(Spot(0.0, 0.0, 0.0), legs)
    curvature = [g.yaw_rate / g.speed for g in forth[::-1]]
    second = waiting_time(spot, back[0].speed, back[0].yaw_rate,
                          return_futures(plan.back, curvature, plan.wheelbase), centre)
    return [*legs, Leg(back[0].speed, back[0].yaw_rate, second), *back]


class Leg(NamedTuple):
    """An arc: speed [m/s], yaw rate [rad/s], seconds."""

    speed: float
    yaw_rate: float
    seconds: float


class Spot(NamedTuple):
    """Place [m] and heading [rad] on the floor."""

    x: float
    y: float
    yaw: float


def trace(start: Spot, legs: Sequence[Leg]) -> tuple[FloatArray, Spot]:
    """Predict a sequence of arcs; return (points (n, 2) [m], last spot)."""
    counts = [max(round(g.seconds / PATH_STEP), 0) for g in legs]
    turns = np.repeat([g.yaw_rate for g in legs], counts)
    speeds = np.repeat([g.speed for g in legs], counts)
    yaw = start.yaw + np.concatenate([[0.0], np.cumsum(turns * PATH_STEP)])
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    x = start.x + np.concatenate([[0.0], np.cumsum(speeds * np.cos(middle) * PATH_STEP)])
    y = start.y + np.concatenate([[0.0], np.cumsum(speeds * np.sin(middle) * PATH_STEP)])
    return np.column_stack([x, y]), Spot(float(x[-1]), float(y[-1]), float(yaw[-1]))


def waiting_time(spot: Spot, speed: float, yaw_rate: float, futures: Sequence[Sequence[Leg]],
                 centre: tuple[float, float]) -> float:
    """Time [s] to stay on the circle (speed, yaw_rate) before the next sweep; at most one turn.

    futures: the next sweep for each possible car. The result is the heading whose largest distance
    from ``centre`` [m] over all futures is smallest.
    """
    if abs(yaw_rate) < 0.1:
        return 0.0
    times = np.arange(CANDIDATE_HEADINGS) * (2.0 * math.pi / abs(yaw_rate) / CANDIDATE_HEADINGS)
    yaw = spot.yaw + yaw_rate * times
    radius = speed / yaw_rate
    x = spot.x + radius * (np.sin(yaw) - math.sin(spot.yaw)) - centre[0]
    y = spot.y - radius * (np.cos(yaw) - math.cos(spot.yaw)) - centre[1]
    c = np.cos(yaw)[:, None]
    s = np.sin(yaw)[:, None]
    worst = np.zeros(CANDIDATE_HEADINGS)
    for legs in futures:
        local, _ = trace(Spot(0.0, 0.0, 0.0), legs)
        px = x[:, None] + c * local[:, 0] - s * local[:, 1]
        py = y[:, None] + s * local[:, 0] + c * local[:, 1]
        worst = np.maximum(worst, np.hypot(px, py).max(axis=1))
    return float(times[int(np.argmin(worst))])
