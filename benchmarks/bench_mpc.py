"""What a plan of contouring control costs: 20 stages on numpy and by generated C, one thread.

    OMP_NUM_THREADS=1 python benchmarks/bench_mpc.py
"""

from __future__ import annotations

import time

import numpy as np
from figures import Figure

from dart_hal.control.mpc.iteration import Mpcc
from dart_hal.control.mpc.model import STAGE_PERIOD
from dart_hal.control.mpc.obstacles import Obstacle
from dart_hal.control.mpc.problem import MpcLimits
from dart_hal.control.tracks import track_named
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.sets import UPSTREAM_2024

SPEED = 2.0
PLANS, ROUNDS = 400, 3
"""Of each plan the best round counts: they are the same to the bit."""
TARGETS = {False: 4.0, True: 1.2}
"""ms, p95 with obstacles: on numpy, by generated C (extra ``mpc``)."""
OBSTACLES = tuple(Obstacle(s, side, 0.15) for s, side in ((2.5, -0.15), (6.0, 0.15), (9.5, -0.15)))


def figures(scale: float = 1.0) -> list[Figure]:
    """Rows of the table: median and p95 [ms] of CPU time."""
    rows = []
    for compiled in (False, True):
        for name, obstacles in (("free lane", ()), ("obstacles", OBSTACLES)):
            try:
                median, p95 = cost(round(PLANS * scale), obstacles, compiled)
            except UsageError as why:
                print(f"generated C: left out, {why}")
                continue
            rows.append(Figure(f"contouring control, {'C' if compiled else 'numpy'}, {name}: "
                               "a plan, p95", p95, "ms",
                               note=f"median {median:.2f}; target: at most {TARGETS[compiled]:g}"))
    return rows


def cost(plans: int, obstacles: tuple[Obstacle, ...], compiled: bool) -> tuple[float, float]:
    """(median, p95) CPU time [ms] of plans in a closed loop on their own prediction."""
    ms = np.min([spent(plans, obstacles, compiled) for _ in range(ROUNDS)], axis=0)
    return float(np.median(ms)), float(np.percentile(ms, 95))


def spent(plans: int, obstacles: tuple[Obstacle, ...], compiled: bool) -> FloatArray:
    """CPU time [ms] of each plan but the first (n,)."""
    p, path = UPSTREAM_2024, track_named("racetrack_vicon_2")
    mpcc = Mpcc(p, path, lambda s: np.full(len(s), SPEED), MpcLimits((-p.motor.g, 0.6)),
                compiled=compiled)
    mpcc.obstacles = obstacles
    state, s, sent, times = np.zeros(8), 0.0, (-p.motor.g, 0.0), []
    state[:2] = path.x[0], path.y[0]
    for k in range(plans):
        begun = time.process_time()
        plan = mpcc.plan(STAGE_PERIOD * k, state, s, sent)
        times.append(time.process_time() - begun)
        sent = float(plan.inputs[0, 0]), float(plan.inputs[1, 0])
        state = np.array(mpcc.stage(*state, *sent))
        s = path.closest(state[0], state[1], s)
    return 1e3 * np.array(times[1:])


if __name__ == "__main__":
    for row in figures():
        print(f"{row.name}: {row.value:.2f} {row.unit} ({row.note})")
