"""The best plans of all cars of an arrival together, by one computer that knows everything.

Over all orders of the cars, by branch and bound: each car in turn takes the best of its plans that
keeps the distance from those before it, on the grid of the distributed cars, from the same places,
at once. No latency, no errors, no message.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from dart_hal.control.shared_plans.search import comparison_times, find_plan
from dart_hal.control.shared_plans.timed_plan import TimedPlan, arc_lengths

TIMES = np.arange(0.0, 30.0, 0.01)


@dataclass
class Central:
    """mean: time to pass [s] of the cars of the best order; last: of its last car; alone: mean time
    of cars that are alone; nodes: searches."""

    mean: float = inf
    last: float = inf
    alone: float = 0.0
    nodes: int = 0


def passing_time(plan: TimedPlan, passed: float) -> float:
    """Time [s] at which a plan passes an arc length [m], inf: never."""
    k = int(np.searchsorted(arc_lengths(plan, TIMES), passed))
    return float(TIMES[k]) if k < len(TIMES) else inf


def best_plan(arrival, car: int, others, least: float = 0.0) -> tuple[float, TimedPlan] | None:
    """(time to pass [s], plan) of a car from its start, past plans of others (2, n).

    least [s]: no plan is faster."""
    space, s = arrival.space, arrival.starts[car].s
    best = None
    for path, (way, rests) in enumerate(zip(space.paths[car], space.rests[car], strict=True)):
        found = find_plan(way, rests, s, 0, others, space.min_distance)
        if found is None:
            continue
        plan = TimedPlan(path, 0.0, s, found.levels)
        t = passing_time(plan, arrival.passed[car])
        if best is None or t < best[0]:
            best = t, plan
        if t <= least:
            break
    return best


def optimise(arrival) -> Central:
    """The order with the least sum of the times to pass."""
    n = len(arrival.starts)
    times = comparison_times(0.0)
    alone = [best_plan(arrival, car, [])[0] for car in range(n)]
    result = Central(alone=float(np.mean(alone)))
    best = [inf]

    def search(done: tuple[int, ...], used: list[np.ndarray], passed: list[float]) -> None:
        if best[0] <= sum(alone) + 1e-6:
            return
        rest = [car for car in range(n) if car not in done]
        if not rest:
            if sum(passed) < best[0]:
                best[0] = sum(passed)
                result.mean, result.last = best[0] / n, max(passed)
            return
        result.nodes += len(rest)
        found = [(car, best_plan(arrival, car, used, alone[car])) for car in rest]
        if any(plan is None for _, plan in found):
            return
        # No car is faster with more cars before it.
        bound = sum(passed) + sum(plan[0] for _, plan in found)
        if bound >= best[0] - 1e-6:
            return
        for car, (t, plan) in sorted(found, key=lambda f: f[1][0] - alone[f[0]]):
            search((*done, car), [*used, arrival.space.positions(car, plan, times)],
                   [*passed, t])

    search((), [], [])
    return result
