"""The best plan of one car around the plans of the others, by dynamic programming.

The state is (arc length, level of the speed) on the grid of ``timed_plan``; from knot to knot the
level changes by -1, 0 or 1. Among all sequences that keep the distance and end at rest in a place
where the car may rest, the one with the largest mean of the arc lengths is found: the global
optimum of the grid, before or behind each other car.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import inf
from typing import NamedTuple

import numpy as np

from dart_hal.control.paths import Path
from dart_hal.control.shared_plans.timed_plan import (
    LENGTH_STEP,
    MAX_LEVEL,
    TIME_STEP,
    TimedPlan,
    arc_lengths,
)
from dart_hal.core.types import BoolArray, FloatArray, IntArray

# Knots of the horizon: 10 s, within which a car gets from one place to rest to the next.
HORIZON_KNOTS = 40
# Comparisons between two knots: each 0.05 s.
CHECKS_PER_KNOT = 5
# Distance that the rounding of a position to the grid can hide [m].
ROUNDING = 0.5 * LENGTH_STEP
# Distance of the last place of a plan from the end of the path [m].
END_MARGIN = 0.1
LEVELS = np.arange(MAX_LEVEL + 1)
CHANGES = (-1, 0, 1)


class FoundPlan(NamedTuple):
    """score: mean of the arc lengths at the knots, from the start [m]; levels from the start on."""

    score: float
    levels: tuple[int, ...]


def comparison_times(t: float) -> FloatArray:
    """Return the times [s] at which positions of others are needed for a plan from t [s] on.

    The last one is after the end of every plan.
    """
    times = t + TIME_STEP / CHECKS_PER_KNOT * np.arange(HORIZON_KNOTS * CHECKS_PER_KNOT + 1)
    return np.append(times, inf)


def score(plan: TimedPlan) -> float:
    """Return the score of a plan as in ``FoundPlan``, from its first knot on."""
    times = np.asarray(plan.t + TIME_STEP * np.arange(1, HORIZON_KNOTS + 1), dtype=np.float64)
    return float((arc_lengths(plan, times) - plan.s).mean())


def find_plan(
    path: Path,
    rests: BoolArray,
    s: float,
    level: int,
    others: Sequence[FloatArray],
    min_distance: float,
) -> FoundPlan | None:
    """Return the best plan from s [m] and a level on, None if there is none.

    rests: places to rest at the points of the path; others: positions (2, n) [m] of each other plan
    at ``comparison_times``.

    1. Mark the places of the grid that are free at each time.
    2. Allow a change of level where all places on its course are free.
    3. Forward dynamic programming over the knots; the last one is at rest, for ever.
    4. Trace the best sequence back.
    """
    size = min(
        int((path.length - END_MARGIN - s) / LENGTH_STEP + 1e-6) + 1, 2 * MAX_LEVEL * HORIZON_KNOTS
    )
    if size < 1:
        return None
    grid = s + LENGTH_STEP * np.arange(size)
    x = np.interp(grid, path.s, path.x).astype(np.float32)
    y = np.interp(grid, path.s, path.y).astype(np.float32)
    free = np.ones((HORIZON_KNOTS * CHECKS_PER_KNOT + 2, size), dtype=bool)
    limit = (min_distance + ROUNDING) ** 2
    for other in others:
        dx = x - other[0, :, None].astype(np.float32)
        dy = y - other[1, :, None].astype(np.float32)
        free &= dx * dx + dy * dy >= limit
    penalties = np.where(_allow_changes(free[:-1]), np.float32(0.0), np.float32(-inf))
    values = np.full((MAX_LEVEL + 1) * size, -inf, dtype=np.float32)
    values[level * size] = 0.0
    progress = np.tile(np.arange(size, dtype=np.float32), MAX_LEVEL + 1)
    sources = _source_indices(size)
    choices = np.empty((HORIZON_KNOTS, values.size), dtype=np.int8)
    # The last element of each row is the source of states that have none.
    reachable = np.full((len(CHANGES), values.size + 1), -inf, dtype=np.float32)
    for k in range(HORIZON_KNOTS):
        np.add(values, penalties[:, k], out=reachable[:, :-1])
        down, same, up = reachable.take(sources)
        slow = np.maximum(down, same)
        choices[k] = np.where(up > slow, 2, same > down)
        values = np.maximum(slow, up) + progress
    changes = choices.reshape(HORIZON_KNOTS, MAX_LEVEL + 1, size)
    ends = (rests[np.minimum(np.rint(grid / path.spacing).astype(int), len(rests) - 1)]
            & free[-1] & free[-2])
    last = np.where(ends, values[:size], -inf)
    place = int(last.argmax())
    if last[place] == -inf:
        return None
    levels = [0]
    for k in range(HORIZON_KNOTS - 1, -1, -1):
        low = levels[-1] - CHANGES[changes[k, levels[-1], place]]
        place -= low + levels[-1]
        levels.append(low)
    # The list is in reverse: remove the knots at rest after the first one at the end.
    while len(levels) > 1 and levels[0] == levels[1] == 0:
        levels.pop(0)
    return FoundPlan(float(last.max()) * LENGTH_STEP / HORIZON_KNOTS, tuple(reversed(levels)))


def _allow_changes(free: BoolArray) -> BoolArray:
    """Return (changes, knots, levels x places): whether all places on the course are free."""
    size = free.shape[1]
    reach = 2 * MAX_LEVEL + 1
    padded = np.zeros((free.shape[0], size + reach), dtype=bool)
    padded[:, :size] = free
    allowed = np.zeros((len(CHANGES), HORIZON_KNOTS, MAX_LEVEL + 1, size), dtype=bool)
    for i, change in enumerate(CHANGES):
        for level in LEVELS:
            if not 0 <= level + change <= MAX_LEVEL:
                continue
            course = np.ones((HORIZON_KNOTS, size), dtype=bool)
            for m in range(CHECKS_PER_KNOT + 1):
                # s = v x + a x^2 / 2 in units of the grid, x in 0..1.
                part = m / CHECKS_PER_KNOT
                shift = round(2 * level * part + change * part * part)
                rows = slice(m, m + (HORIZON_KNOTS - 1) * CHECKS_PER_KNOT + 1, CHECKS_PER_KNOT)
                course &= padded[rows, shift : shift + size]
            allowed[i, :, level] = course
    return allowed.reshape(len(CHANGES), HORIZON_KNOTS, -1)


@lru_cache(maxsize=512)
def _source_indices(size: int) -> IntArray:
    """Return the index in all rows of the state before each change (changes, levels x places)."""
    levels = LEVELS[:, None]
    places = np.arange(size)
    missing = (MAX_LEVEL + 1) * size
    indices = []
    for row, change in enumerate(CHANGES):
        low = levels - change
        source = places - (low + levels)
        is_known = (low >= 0) & (low <= MAX_LEVEL) & (source >= 0)
        index = np.where(is_known, low * size + source, missing).ravel()
        indices.append(row * (missing + 1) + index)
    return np.array(indices)
