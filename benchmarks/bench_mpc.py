"""What a plan of contouring control costs: 20 stages on numpy, one thread.

    OMP_NUM_THREADS=1 python benchmarks/bench_mpc.py
"""

from __future__ import annotations

import time

import numpy as np
from figures import Figure

from dart_hal.control.mpc.iteration import Mpcc
from dart_hal.control.mpc.model import STAGE
from dart_hal.control.mpc.obstacles import Obstacle
from dart_hal.control.mpc.problem import Limits
from dart_hal.control.tracks import track_named
from dart_hal.vehicle.sets import UPSTREAM_2024

SPEED = 2.0
PLANS = 400
WANTED = 4.0
"""ms, p95 with obstacles."""


def figures(scale: float = 1.0) -> list[Figure]:
    """Rows of the table: median and p95 [ms] of CPU time."""
    rows = []
    for name, obstacles in (("free lane", ()), ("obstacles", tuple(
            Obstacle(s, side, 0.15) for s, side in ((2.5, -0.15), (6.0, 0.15), (9.5, -0.15))))):
        median, p95 = cost(round(PLANS * scale), obstacles)
        rows.append(Figure(f"contouring control, {name}: a plan, p95", p95, "ms",
                           note=f"median {median:.2f}; wanted at most {WANTED:g}"))
    return rows


def cost(plans: int, obstacles: tuple[Obstacle, ...]) -> tuple[float, float]:
    """(median, p95) CPU time [ms] of plans in a closed loop on their own prediction."""
    p, path = UPSTREAM_2024, track_named("racetrack_vicon_2")
    mpcc = Mpcc(p, path, lambda s: np.full(len(s), SPEED), Limits((-p.motor.g, 0.6)))
    mpcc.obstacles = obstacles
    state, s, sent, spent = np.zeros(8), 0.0, (-p.motor.g, 0.0), []
    state[:2] = path.x[0], path.y[0]
    for k in range(plans):
        begun = time.process_time()
        plan = mpcc.plan(STAGE * k, state, s, sent)
        spent.append(time.process_time() - begun)
        sent = float(plan.inputs[0, 0]), float(plan.inputs[1, 0])
        state = np.array(mpcc.stage(*state, *sent))
        s = path.closest(state[0], state[1], s)
    ms = 1e3 * np.array(spent[1:])
    return float(np.median(ms)), float(np.percentile(ms, 95))


if __name__ == "__main__":
    for row in figures():
        print(f"{row.name}: {row.value:.2f} {row.unit} ({row.note})")
