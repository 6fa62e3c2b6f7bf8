"""How ``drive_speed`` follows steps, a sine and a change of direction on hidden cars.

    python benchmarks/bench_speed_control.py            cars 1 to 8, with the paper's model
    python benchmarks/bench_speed_control.py 30         cars 1 to 30

Nothing of the hidden car is known to the controller; its true speed is what counts.
Overshoot as a share of the step, settling to 5 % of it [s], rms error on
1.2 + 0.4 sin(2 pi 0.5 t) [m/s], and the time [s] from the command until the car does 90 % of the
new speed, backward from 0.8 m/s and forward again.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from math import pi, sin

import numpy as np

from dart_hal import Car
from dart_hal.links.base import open_backend
from dart_hal.sim.truth import world_of
from dart_hal.types import FloatArray

STEP, SINE, TURN = 0.8, 0.4, -0.5  # m/s


def driven(seed: int, reference: Callable[[float], float], seconds: float
           ) -> tuple[FloatArray, FloatArray]:
    """(t, true speed) of a car that is asked for reference(t)."""
    backend, rows, start = open_backend(f"sim://?seed={seed}&nano=mock"), [], None
    world = world_of(backend)
    with Car.over(backend) as car:
        car.arm()
        for state in car.states(duration=seconds):
            start = state.t if start is None else start
            rows.append((state.t - start, world.truth(state.t).v_x))
            car.drive_speed(steering=0.3, speed=reference(state.t - start))
    t, speed = np.array(rows).T
    return t, speed


def figures(seed: int) -> tuple[float, ...]:
    """(overshoot, settling, rms on the sine, backward, forward) of one car."""
    t, v = driven(seed, lambda t: STEP if t < 3.0 else 1.2 + SINE * sin(pi * (t - 3.0)), 9.0)
    step, sine = t < 3.0, t > 4.0
    off = t[step][np.abs(v[step] - STEP) > 0.05 * STEP]
    wanted = np.array([1.2 + SINE * sin(pi * (one - 3.0)) for one in t[sine]])
    rms = float(np.sqrt(np.mean((v[sine] - wanted)**2)))
    s, u = driven(seed, lambda t: STEP if t < 2.0 else TURN if t < 4.0 else STEP, 5.5)
    turns = [s[(s > at) & (u * way > 0.9 * abs(goal))] - at
             for at, way, goal in ((2.0, -1.0, TURN), (4.0, 1.0, STEP))]
    return (float(v[step].max()) / STEP - 1.0, float(off.max(initial=0.0)), rms,
            *(float(one.min(initial=np.inf)) for one in turns))


def main() -> None:
    """One line for each car, then median and worst."""
    cars = int(sys.argv[1]) if len(sys.argv) > 1 else 8
    print("car  overshoot  settling s  sine rms m/s  backward s  forward s")
    rows = []
    for seed in range(1, cars + 1):
        rows.append(figures(seed))
        print(f"{seed:3d}  " + "  ".join(f"{x:9.3f}" for x in rows[-1]))
    for name, of in (("median", np.median), ("worst", np.max)):
        print(f"{name:6} " + "  ".join(f"{x:.3f}" for x in of(np.array(rows), axis=0)))


if __name__ == "__main__":
    main()
