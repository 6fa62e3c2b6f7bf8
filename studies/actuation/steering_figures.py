"""How far the road wheels are from the angle that was asked for, with and without the play.

    python -m studies.actuation.steering_figures --seeds 12

Hidden cars with a measured map, backlash and slew: the truth with the errors of a calibration.
Asked for: a slow wave, and levels to and fro once they are reached. The delay that fits best is
taken out, for a delay is no error of the map.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from dart_hal.car import Car
from dart_hal.core.config import Calibration, Quantity, SteeringTable, save_calibration
from dart_hal.core.config.calibration import SteeringCalibration
from dart_hal.devices.links.base import Backend, open_backend
from dart_lab.sim.truth import reveal, world_of

MAP_STD, PLAY_STD, SLEW_STD = 0.0015, 0.0006, 0.015
"""rad, rad and relative: what ``calibrate steering`` and ``latency`` leave."""
SECONDS = 12.0


def asked(t: float) -> float:
    """Road-wheel angle [rad]: a wave of 0.25 Hz, then levels of 0.5 s."""
    if t < 0.5 * SECONDS:
        return 0.15 * float(np.sin(0.5 * np.pi * t))
    return (0.1, -0.05, 0.15, 0.05, -0.1, 0.0)[int(2.0 * t) % 6]


def files_of(backend: Backend, seed: int, cars: Path) -> None:
    """calibration.toml as the procedures would write it."""
    true, rng = reveal(seed), np.random.default_rng([seed, 79])
    angle = np.array(true["steering"]["angle_rad"])[::25] + MAP_STD * rng.normal(size=17)
    pulse = 1500.0 + 375.0 * np.array(true["steering"]["command"])[::25]
    sensors = true["sensors"]
    table = SteeringTable(pulse_us=tuple(pulse.tolist()), angle_rad=tuple(np.sort(angle).tolist()),
                          std_rad=(MAP_STD,) * 17)
    steering = SteeringCalibration(
        map=table, slew_us_s=Quantity(float(sensors["steering.slew_us_s"]) * float(
            1.0 + SLEW_STD * rng.normal()), 50.0),
        backlash=Quantity(max(sensors["steering.backlash"] + PLAY_STD * float(rng.normal()), 1e-3),
                          PLAY_STD))
    folder = cars / f"sim-{seed}"
    save_calibration(Calibration(car=folder.name, steering=steering), folder)


def angle_error(seed: int, take_up: bool) -> float:
    """rms [rad] of road-wheel angle against what was asked for, the best delay taken out."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        backend = open_backend(f"sim://?seed={seed}&nano=mock")
        files_of(backend, seed, Path(folder))
        assert backend.car_toml is not None
        backend.car_toml = backend.car_toml.replace(
            "[steering]", f"[steering]\ntake_up_backlash = {str(take_up).lower()}")
        with Car.over(backend, cars=folder) as car:
            world = world_of(backend)
            car.arm()
            start = None
            for state in car.states(duration=SECONDS):
                start = state.t if start is None else start
                t = state.t - start
                car.drive(steering=asked(t))
                rows.append((t, world.servo.angle))
    t, angle = np.array(rows).T
    at_rest = (t > 1.0) & ((t < 0.5 * SECONDS) | ((2.0 * t) % 1.0 > 0.6))
    return min(float(np.sqrt(np.mean((angle - [asked(one - late) for one in t])[at_rest] ** 2)))
               for late in np.arange(0.0, 0.12, 0.005))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=12)
    given = parser.parse_args()
    pairs = np.array([[angle_error(seed, take_up) for take_up in (False, True)]
                      for seed in range(1, given.seeds + 1)])
    for seed, (before, after) in enumerate(np.degrees(pairs), 1):
        print(f"car {seed:2d}: {before:.3f} deg, with the play taken up {after:.3f} deg")
    print("median {:.3f} and {:.3f} deg".format(*np.degrees(np.median(pairs, axis=0))))


if __name__ == "__main__":
    main()
