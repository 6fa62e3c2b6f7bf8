"""A plan of a car: speeds along its path at equidistant times, and rest at its end.

The speeds are multiples of ``LEVEL_SPEED``. Between two times the acceleration is constant, so a
receiver has the same plan from a few bytes:

    s_{k+1} = s_k + (level_k + level_{k+1}) LENGTH_STEP
"""

from __future__ import annotations

from math import floor
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import FloatArray

# Time between two knots [s], and a level of the speed [m/s]: a level per knot is 0.8 m/s2, at which
# a car rolls out without its brake.
TIME_STEP = 0.25
LEVEL_SPEED = 0.2
# Distance of one level during one step, halved [m]: all knots are on this grid.
LENGTH_STEP = 0.5 * LEVEL_SPEED * TIME_STEP
# Largest level: 1 m/s.
MAX_LEVEL = 5
# Largest number of knots of a plan: 16 s.
MAX_KNOTS = 64


class TimedPlan(NamedTuple):
    """A plan that ends at rest.

    path: number of the path among those of its car; t [s]: of the first knot; s [m]: arc length
    there; levels: speed at each knot in ``LEVEL_SPEED``, the last is 0.
    """

    path: int
    t: float
    s: float
    levels: tuple[int, ...]

    @property
    def end_t(self) -> float:
        """Time from which the plan is at rest [s]."""
        return self.t + (len(self.levels) - 1) * TIME_STEP

    @property
    def end_s(self) -> float:
        """Arc length at the end [m]."""
        return self.s + LENGTH_STEP * (2 * sum(self.levels) - self.levels[0])


def rest_plan(path: int, t: float, s: float) -> TimedPlan:
    """Return the plan of a car that stays at s [m] of a path."""
    return TimedPlan(path, t, s, (0,))


def arc_lengths(plan: TimedPlan, times: FloatArray) -> FloatArray:
    """Return the arc lengths [m] of a plan at times [s] after its first knot."""
    levels = np.array((*plan.levels, 0), dtype=float)
    knots = np.append(0.0, np.cumsum(levels[:-1] + levels[1:])) * LENGTH_STEP
    x = np.clip((times - plan.t) / TIME_STEP, 0.0, len(plan.levels) - 1.0)
    k = np.minimum(x.astype(int), len(plan.levels) - 1)
    x = x - k
    low = levels[k]
    change = levels[np.minimum(k + 1, len(plan.levels))] - low
    result: FloatArray = plan.s + knots[k] + LENGTH_STEP * x * (2.0 * low + change * x)
    return result


def motion_at(plan: TimedPlan, t: float) -> tuple[float, float, float]:
    """Return arc length [m], speed [m/s] and acceleration [m/s2] at t [s]."""
    x = (t - plan.t) / TIME_STEP
    if x < 0.0:
        return plan.s, 0.0, 0.0
    if x >= len(plan.levels) - 1:
        return plan.end_s, 0.0, 0.0
    k = floor(x)
    low = plan.levels[k]
    change = plan.levels[k + 1] - low
    part = x - k
    levels = 2 * sum(plan.levels[: k + 1]) - plan.levels[0] - low
    s = plan.s + LENGTH_STEP * (levels + part * (2.0 * low + change * part))
    return s, LEVEL_SPEED * (low + change * part), LEVEL_SPEED * change / TIME_STEP


def cut_before(plan: TimedPlan, t: float) -> TimedPlan:
    """Return the same plan without the knots before the last one at or before t [s]."""
    k = max(floor((t - plan.t) / TIME_STEP), 0)
    if k >= len(plan.levels) - 1:
        return rest_plan(plan.path, plan.t + k * TIME_STEP, plan.end_s)
    head = plan.levels[: k + 1]
    s = plan.s + LENGTH_STEP * (2 * sum(head) - head[0] - head[-1])
    return TimedPlan(plan.path, plan.t + k * TIME_STEP, s, plan.levels[k:])


def replace_after(plan: TimedPlan, k: int, path: int, levels: tuple[int, ...]) -> TimedPlan:
    """Return the plan up to knot k, continued by ``levels``, whose first is that of knot k."""
    padded = plan.levels + (0,) * max(k + 1 - len(plan.levels), 0)
    return plan._replace(path=path, levels=(*padded[:k], *levels))
