"""Errors of ``identify all``, with and without ``--joint``, in the standard errors that it states.

    python -m studies.identification.coverage                     20 cars, two minutes of CPU
    python -m studies.identification.coverage --cars 4 --first-seed 50
    python -m studies.identification.coverage --any-car           another body, grip, motor
    python -m studies.identification.coverage --joint             all in one fit

Each simulated car has other tyres, another steering map and other delays than the base, the paper's
car. It drives three minutes with commands that change all the time, measured by motion capture
(``studies.diagnosis.hidden_drive``). Mass and yaw inertia are known. The table has the root mean
square of (fitted - true) / standard error over the cars, once for all parameters and once for those
that are stated as identified.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from dart_hal.recording.dart import Recording, Reference, read, with_marker_frames
from dart_hal.vehicle import PAPER, PaperTyres, Steering, Vehicle
from dart_lab.identification.fit import FittedParameter
from dart_lab.identification.shooting import fit_from_recordings
from dart_lab.identification.submodels import SUBMODELS, fit_submodels
from studies.diagnosis import hidden_drive

FRAME = Reference(hidden_drive.LX, hidden_drive.THETA, hidden_drive.LY, "known")
FAST = (0.22, 0.42)
"""Throttle while the car drives: from 1 to 3 m/s."""
DRIVES = 3
LOGGED_LATER = {"steering_s": 0.0085, "throttle_s": 0.0085}
"""s from a command to the row that has it, in the mean: 1 to 6 ms to the recorder, and up to 10 ms
to the next row. A delay that is counted from the row is shorter by it."""


def draw_car(rng: np.random.Generator) -> Vehicle:
    """Draw tyres of any shape, a steering map and delays around those of the paper's car."""
    def vary(value: float, spread: float) -> float:
        return value * float(np.exp(spread * rng.normal()))

    t = PAPER.tyres
    assert isinstance(t, PaperTyres)
    s = PAPER.steering
    return replace(
        PAPER,
        tyres=PaperTyres(front_D=vary(t.front_D, 0.25), front_C=float(rng.uniform(0.6, 1.6)),
                         front_B=vary(12.0, 0.2), front_E=float(rng.uniform(-3.0, 0.8)),
                         rear_cornering_stiffness=vary(t.rear_cornering_stiffness, 0.2)),
        steering=Steering(k_left=vary(s.k_left, 0.05), a_left_rad=vary(s.a_left_rad, 0.05),
                          s0=s.s0 + 0.02 * float(rng.normal()),
                          a_right_rad=vary(s.a_right_rad, 0.05), k_right=vary(s.k_right, 0.05)),
        delay=replace(PAPER.delay, throttle_s=0.02, throttle_lag_s=0.05,
                      steering_s=float(rng.uniform(0.05, 0.1)),
                      steering_lag_s=float(rng.uniform(0.04, 0.1))))


def draw_any_car(rng: np.random.Generator) -> Vehicle:
    """Draw a car of 1 to 4 kg and 15 to 35 cm, with a motor and friction in proportion or not."""
    car = draw_car(rng)
    wheelbase = float(rng.uniform(0.15, 0.35))
    mass = float(rng.uniform(1.0, 4.0))
    l_f = wheelbase * float(rng.uniform(0.42, 0.58))
    inertia = mass * wheelbase**2 * float(rng.uniform(0.12, 0.25))
    force = mass / PAPER.body.mass
    grip = force * float(rng.uniform(0.8, 2.5))

    def vary(value: float, spread: float) -> float:
        return force * value * float(np.exp(spread * rng.normal()))

    assert isinstance(car.tyres, PaperTyres)
    return replace(
        car,
        body=replace(car.body, wheelbase=wheelbase, l_f=l_f, l_r=wheelbase - l_f, mass=mass,
                     yaw_inertia=inertia),
        tyres=replace(car.tyres, front_D=grip * car.tyres.front_D,
                      rear_cornering_stiffness=grip * car.tyres.rear_cornering_stiffness),
        motor=replace(car.duty_motor, d=vary(car.duty_motor.d, 0.3), e=vary(car.duty_motor.e, 0.3),
                      g=car.duty_motor.g * float(np.exp(0.2 * rng.normal()))),
        friction=replace(car.friction, a=vary(car.friction.a, 0.4), c=vary(car.friction.c, 0.4)))


def record_drives(seed: int, any_car: bool, count: int = DRIVES) -> tuple[Vehicle, list[Recording]]:
    """Draw a car, and return it with recordings of drives of a minute each."""
    car = (draw_any_car if any_car else draw_car)(np.random.default_rng(seed))
    plan = hidden_drive.Plan(seconds=60.0, fast=FAST)
    with tempfile.TemporaryDirectory() as folder:
        files = [hidden_drive.write(Path(folder) / f"drive_{i}.csv", car, 1000 * seed + i, plan)
                 for i in range(count)]
        return car, list(with_marker_frames([read(f) for f in files], FRAME))


def compare(seed: int, any_car: bool, joint: bool) -> dict[str, tuple[float, bool]]:
    """Identify one car; return (error in standard errors, identified) by parameter."""
    car, recordings = record_drives(seed, any_car)
    base = replace(PAPER, body=car.body)
    fits = (fit_from_recordings(recordings, base, reference=FRAME)[0].fits if joint
            else fit_submodels(recordings, base=base, reference=FRAME)[0])
    out = {}
    for name, fit in fits.items():
        for key, parameter in fit.parameters.items():
            truth = float(getattr(getattr(car, name), key)) - LOGGED_LATER.get(key, 0.0)
            out[f"{name}.{key}"] = (_relative_error(parameter, truth), parameter.identifiable)
    return out


def _relative_error(parameter: FittedParameter, truth: float) -> float:
    if not 0.0 < parameter.std < np.inf:
        return float("nan")
    return (parameter.value - truth) / parameter.std


def parse_options(description: str | None) -> argparse.Namespace:
    """Parse the options of a study of drawn cars."""
    parser = argparse.ArgumentParser(description=description,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cars", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--any-car", action="store_true")
    parser.add_argument("--joint", action="store_true")
    return parser.parse_args()


def main() -> None:
    """Print the table."""
    options = parse_options(__doc__)
    found = [compare(options.first_seed + i, options.any_car, options.joint)
             for i in range(options.cars)]
    table = Table(title=f"{', '.join(SUBMODELS)} of {options.cars} cars")
    for column in ("parameter", "rms, all", "identified", "rms of these", "largest"):
        table.add_column(column, justify="left" if column == "parameter" else "right")
    for name in found[0]:
        z = np.array([car[name][0] for car in found])
        known = np.array([car[name][1] for car in found])
        table.add_row(name, _rms(z), f"{known.sum()} of {len(z)}", _rms(z[known]),
                      f"{np.nanmax(np.abs(z)):.1f}" if np.isfinite(z).any() else "-")
    Console().print(table)


def _rms(z: np.ndarray) -> str:
    finite = z[np.isfinite(z)]
    return f"{np.sqrt(np.mean(finite**2)):.2f}" if len(finite) else "-"


if __name__ == "__main__":
    main()
