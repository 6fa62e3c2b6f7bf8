"""How sure plans are, against what comes of their inputs when nobody corrects them.

    python -m studies.control.mpc_spread [--cars 10]

rms of the true error across the planned way, the standard deviation that the plan has, and the
share within two of them, after so many stages, for light cars whose parameters are 5 % off.
"""

from __future__ import annotations

import argparse
from copy import deepcopy
from math import cos, sin

import numpy as np

from dart_hal.control.mpc.model import STAGE_PERIOD
from dart_hal.control.mpc.planner import MpcPlan
from dart_hal.control.mpc.spread import lateral_std
from dart_hal.control.tracks import track_named
from studies.control.mpc_loop import LATE, Loop, P, around, controller

COV = np.diag(np.square((0.01, 0.01, 0.005, 0.02, 0.02)))
"""Of the noise in ``Loop.seen``."""


def uncorrected(loop: Loop, plan: MpcPlan) -> np.ndarray:
    """Error [m] across each state but the last of a plan, of a car that drives its inputs."""
    car, l_r, rows = deepcopy(loop.car), loop.true.body.l_r, []
    for tau, st, _ in plan.inputs.T:
        command = min(max(loop.disturbance.command(float(st)), -1.0), 1.0)
        for _ in range(round(STAGE_PERIOD / car.config.step)):
            car.advance(float(tau), command)
            x, y, yaw = car.state[:3]
            rows.append((car.t, x - l_r * cos(yaw), y - l_r * sin(yaw)))
    t, x, y = np.array(rows).T
    at, psi = plan.t + STAGE_PERIOD * np.arange(len(plan.states) - 1), plan.states[:-1, 2]
    left = np.cos(psi) * (np.interp(at, t, y) - plan.states[:-1, 1])
    return left - np.sin(psi) * (np.interp(at, t, x) - plan.states[:-1, 0])


def errors(seed: int, speed: float, each: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """(errors, standard deviations) [m] of every fifth plan of a lap, (plans, stages)."""
    path = track_named("racetrack_vicon_2")
    loop = Loop(controller(P, path, speed), around(seed), LATE, noise=np.random.default_rng(seed))
    found, told, k = [], [], 0
    while loop.s < path.length:
        plan = loop.planned()
        k += 1
        if k > 15 and k % each == 0:
            found.append(uncorrected(loop, plan))
            told.append(lateral_std(plan, COV)[:-1])
        loop.move()
    return np.array(found), np.array(told)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cars", type=int, default=10)
    cars = parser.parse_args().cars
    for speed in (1.0, 2.0):
        found, told = (np.vstack(each) for each in zip(
            *(errors(k, speed) for k in range(cars)), strict=True))
        within = (np.abs(found) < 2.0 * told).mean(axis=0)
        for k in (0, 5, 10, 15, 19):
            print(f"{speed:g} m/s, stage {k}: {100.0 * np.sqrt((found[:, k]**2).mean()):.1f} cm "
                  f"rms, {100.0 * told[:, k].mean():.1f} told; {within[k]:.2f} within two",
                  flush=True)


if __name__ == "__main__":
    main()
