"""How often the 90 % intervals of the measuring procedures hold the hidden truth.

    python -m tests.calibration.coverage --seeds 40 [--first 1] [clock] [encoder] [imu]
        [esc] [throttle] [circle]

Slow (1 to 10 s a car and verb). Prints one row per quantity: how many intervals
hold it, rms of error by standard error, worst error. The clock's intervals are wide
here: the crystal of a simulated host has no error.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import defaultdict
from collections.abc import Callable

import numpy as np
from scipy.optimize import brentq

from dart_hal.calibration.clock import calibrate_clock
from dart_hal.calibration.encoder import calibrate_encoder
from dart_hal.calibration.esc import calibrate_esc
from dart_hal.calibration.imu import calibrate_imu
from dart_hal.calibration.measured import Measured
from dart_hal.calibration.throttle import calibrate_throttle
from dart_hal.car import Car
from dart_hal.config import DriveTable, Quantity
from dart_hal.links.base import open_backend
from dart_hal.ports import Workshop
from dart_hal.sim.truth import reveal
from dart_hal.types import NINETY
from dart_hal.vehicle.motor import make_drive
from dart_hal.vehicle.parameters import Friction, Motor

VERBS: dict[str, Callable[[Car, Workshop], Measured]] = {
    "clock": lambda car, workshop: calibrate_clock(car),
    "encoder": calibrate_encoder, "imu": calibrate_imu, "esc": calibrate_esc,
    "throttle": calibrate_throttle,
    "circle": lambda car, workshop: calibrate_throttle(car, workshop, room=0.0)}


def errors(verb: str, seed: int) -> dict[str, tuple[float, float]]:
    """(error, standard error) of each scalar quantity of one hidden car."""
    backend = open_backend(f"sim://?seed={seed}&nano=mock")
    with tempfile.TemporaryDirectory() as folder, Car.over(backend, cars=folder) as car:
        found = VERBS[verb](car, backend.workshop)
    true = reveal(seed)["sensors"]
    scalars = {name: (q.value - true[name], q.std) for name, q in found.quantities.items()
               if isinstance(q, Quantity)}
    return scalars | drive_errors(seed, found)


def drive_errors(seed: int, found: Measured) -> dict[str, tuple[float, float]]:
    """(error, standard error) [us] of each point of a drive table, by its place in it."""
    table = found.others.get("throttle.drive")
    if not isinstance(table, DriveTable):
        return {}
    rows = zip(table.speed, table.pulse_us, table.std_us, strict=True)
    where = found.notes[0].rpartition(", ")[2]
    return {f"throttle.drive[{k}] {where}": (pulse - holding_pulse(seed, speed), std)
            for k, (speed, pulse, std) in enumerate(rows)}


def holding_pulse(seed: int, speed: float) -> float:
    """The pulse [us] that holds a speed [m/s] straight ahead on a hidden car."""
    shown = reveal(seed)
    motor, friction = ({key: q["value"] for key, q in shown["vehicle"][group].items()}
                       for group in ("motor", "friction"))
    drive = make_drive(Motor(**motor), Friction(**friction))
    throttle = brentq(lambda tau: drive(tau, speed), 0.1, 1.0)
    sensors = shown["sensors"]
    return float(sensors["throttle.neutral_us"] + sensors["throttle.saturation_us"] * throttle)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("verbs", nargs="*", default=list(VERBS), metavar="VERB")
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first", type=int, default=1)
    given = parser.parse_args()
    rows: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for seed in range(given.first, given.first + given.seeds):
        for verb in given.verbs:
            for name, pair in errors(verb, seed).items():
                rows[name].append(pair)
    for name, pairs in rows.items():
        error, std = np.array(pairs).T
        z = error / std
        print(f"{name:34s} {int(np.sum(np.abs(z) < NINETY)):3d} of {len(z)} inside 90 %, "
              f"z rms {np.sqrt(np.mean(z**2)):.2f}, worst {np.max(np.abs(z)):.1f} sigma, "
              f"worst error {np.max(np.abs(error)):.3g}")


if __name__ == "__main__":
    main()
