"""The paths of all cars: positions of plans, their separation, and where a car may rest."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from zlib import crc32

import numpy as np

from dart_hal.control.crossing.layout import MIN_CAR_DISTANCE, SAME_LANE_DISTANCE
from dart_hal.control.paths import Path
from dart_hal.control.shared_plans.timed_plan import TimedPlan, arc_lengths
from dart_hal.core.types import BoolArray, FloatArray

# Time between two comparisons of plans [s]: two cars of 1 m/s that cross at a right angle come 1 mm
# nearer in between.
CHECK_PERIOD = 0.05
# Paths of one lane differ in heading by less than this cosine: 6 deg.
SAME_LANE_COSINE = 0.995
# Points of a path from one to the next that is compared for places to rest.
REST_STRIDE = 4


class PlanSpace:
    """Paths of all cars, known to each of them.

    paths: for each car one path, or several that share their start, among which its first plan
    chooses; min_distance [m]: between the centres of two cars by their plans.

    ``rests``: for each car and path whether it may rest at the points of the path (n,): where no
    path of another car passes nearer than min_distance, except in the same lane. A car at rest
    there blocks at most those behind it in its lane. So if all cars are at rest, the first one of
    each lane has a free path, and no deadlock is possible.
    """

    def __init__(
        self, paths: Sequence[Sequence[Path]], min_distance: float = MIN_CAR_DISTANCE
    ) -> None:
        self.paths = tuple(tuple(own) for own in paths)
        self.min_distance = min_distance
        self.rests = tuple(
            tuple(self._rest_places(path, car) for path in own)
            for car, own in enumerate(self.paths)
        )

    @property
    def key(self) -> int:
        """Checksum of the paths; cars with other ones reject messages."""
        ends = [
            f"{path.length:.3f} {path.x[0]:.3f} {path.y[0]:.3f} {path.x[-1]:.3f} {path.y[-1]:.3f}"
            for own in self.paths
            for path in own
        ]
        return crc32("; ".join((f"{self.min_distance:.3f}", *ends)).encode())

    def positions(self, car: int, plan: TimedPlan, times: FloatArray) -> FloatArray:
        """Return the centres (2, n) [m] of a car by its plan at times [s]."""
        path = self.paths[car][plan.path]
        s = arc_lengths(plan, times)
        return np.stack([np.interp(s, path.s, path.x), np.interp(s, path.s, path.y)])

    def distance(
        self, a: int, plan_a: TimedPlan, b: int, plan_b: TimedPlan, t: float, end_t: float = inf
    ) -> float:
        """Return the least distance [m] of the centres of two cars by their plans from t [s] on.

        end_t [s]: until then; by default for ever, as both plans end at rest.
        """
        last = min(max(plan_a.end_t, plan_b.end_t, t), end_t)
        times = np.append(np.arange(t, last, CHECK_PERIOD), last)
        dx, dy = self.positions(a, plan_a, times) - self.positions(b, plan_b, times)
        return float(np.sqrt((dx * dx + dy * dy).min()))

    def _rest_places(self, path: Path, car: int) -> BoolArray:
        """Return at which points of a path the car may rest (n,)."""
        points = slice(None, None, REST_STRIDE)
        x = path.x[points, None]
        y = path.y[points, None]
        c = np.cos(path.heading[points, None])
        s = np.sin(path.heading[points, None])
        # A pass between two compared points is at most this much nearer.
        reach = np.hypot(self.min_distance, REST_STRIDE * path.spacing)
        blocks = np.zeros(len(x), dtype=bool)
        others = [p for other, paths in enumerate(self.paths) if other != car for p in paths]
        if others:
            other_x, other_y, heading = (
                np.concatenate([values[points] for values in part])
                for part in zip(*((p.x, p.y, p.heading) for p in others), strict=True)
            )
            dx = other_x - x
            dy = other_y - y
            is_near = dx * dx + dy * dy < reach * reach
            turn = c * np.cos(heading) + s * np.sin(heading)
            is_same_lane = (np.abs(c * dy - s * dx) < SAME_LANE_DISTANCE) & (
                turn > SAME_LANE_COSINE
            )
            blocks = (is_near & ~is_same_lane).any(axis=1)
        # A point between two compared ones is blocked by either.
        blocks[:-1] |= blocks[1:].copy()
        return ~np.repeat(blocks, REST_STRIDE)[: len(path.x)]
