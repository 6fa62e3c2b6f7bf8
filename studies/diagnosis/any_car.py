"""Unmodified emulated cars, each with its own identified model: is anything called wrong?

    python -m studies.diagnosis.any_car --cars 30 --first-seed 100 --jobs 2 [--calibrate] [--poses]
    python -m studies.diagnosis.any_car --calibrate --keep DRIVES --out FILE    resumed where it was

With ``--calibrate`` the car is measured as ``dart-hal calibrate all`` does. A first drive gives
each car its model, as ``dart-hal diagnose --out`` does, from ``--model measured`` if it is; two
more, by other draws, are diagnosed with it. ``--poses``: motion capture sees the drives. Right is
silence, or parameters alone. One line a car. ``--keep``: drives are filmed and stay below that
folder; asked again, with or without ``--poses``, they are not driven again.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from dart_hal.calibration import order
from dart_hal.calibration.procedure import agree, silent
from dart_hal.car import Car
from dart_hal.car.runs import read_run
from dart_hal.cli.common.calibrate_all import write
from dart_hal.core.config import ModelFile, save_model
from dart_hal.core.process.jobs import each
from dart_hal.devices.links.base import open_backend
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.load import find_model
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.demo.diagnosis import FRAME_WAIT_S, SERVO_S
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.inputs import check_inputs
from dart_lab.diagnosis.result import Diagnosis
from dart_lab.diagnosis.write import extended_model
from dart_lab.identification.measured import MEASURED, named_model

SILENT = ("nothing_wrong", "parameters_only")
DRIVES = {"first": 80.0, "train": 60.0, "test": 40.0}  # s


@dataclass(frozen=True)
class Answer:
    """found: the diagnosis of the later drives; seconds: of CPU."""

    seed: int
    found: Diagnosis
    seconds: float

    @property
    def right(self) -> bool:
        return self.found.verdict in SILENT

    def line(self) -> dict[str, Any]:
        d = self.found
        return {"seed": self.seed, "verdict": d.verdict, "right": self.right,
                "causes": [c.effect for c in d.causes], "claims": [c.group for c in d.claims],
                "unexplained": [(u.channel, u.along, round(u.share, 3)) for u in d.unexplained],
                "gain": {k: round(g.test, 3) for k, g in d.gain.items()},
                "seconds": round(self.seconds, 1)}


def asked(seed: int, options: str = "", calibrate: bool = False, poses: bool = False,
          keep: Path | None = None) -> Answer:
    """Drive a car of a seed, identify it, drive on and diagnose; options: more of its URL.

    keep: folder of drives that were filmed, of this car or to be.
    """
    with tempfile.TemporaryDirectory() as folder:
        home = (keep or Path(folder)) / f"{seed}{'_calibrated' * calibrate}{options}"
        runs = driven(home, seed, options, calibrate, poses or keep is not None)
        model = own_model(runs["first"], Path(folder) / "own.toml", poses, calibrate)
        began = time.process_time()
        file, p = find_model(model)
        sides = check_inputs([read_run(runs["train"], poses=poses)],
                        [read_run(runs["test"], poses=poses)], p)
        return Answer(seed, diagnose(file, p, sides.train, sides.test),
                      time.process_time() - began)


def driven(home: Path, seed: int, options: str, calibrate: bool, filmed: bool) -> dict[str, Path]:
    """The three runs of a car, in its folder ``home``; driven, where they are not there yet."""
    runs = {name: home / f"{name}.mcap" for name in DRIVES}
    done = home / "driven"
    if done.exists():
        return runs
    shutil.rmtree(home, ignore_errors=True)
    home.mkdir(parents=True)
    if calibrate:
        calibrated(f"sim://?seed={seed}&nano=mock", home)
    for draw, (name, seconds) in enumerate(DRIVES.items()):
        url = f"sim://?seed={seed}{options if name != 'first' else ''}{'&mocap=1' * filmed}"
        drive(url, runs[name], seconds, np.random.default_rng([draw, 7]), cars=home)
    done.touch()
    return runs


def calibrated(url: str, cars: Path) -> None:
    """All that ``calibrate all`` measures, written below the folder ``cars``."""
    with Car.open(url, cars=cars) as car:
        steps = order.make_steps(car.files)
    for step in steps:
        backend = open_backend(url)
        assert backend.workshop is not None
        with Car.over(backend, cars=cars) as car:
            write(car.files, step.run(car, backend.workshop, silent, agree))


def drive(url: str, run: Path, seconds: float, rng: np.random.Generator, held: float = 2.0,
          cars: Path | None = None) -> None:
    """Steps of steering (each at most ``held`` [s]) and throttle, after three s of standing."""
    with Car.open(url, cars=cars, record=run) as car:
        for _ in car.states(duration=3.0):
            pass
        car.arm()
        turn = pull = steering = throttle = 0.0
        for i, _ in enumerate(car.states(duration=seconds)):
            t = 0.01 * i
            if t >= pull:
                throttle, pull = rng.uniform(0.2, 0.3) * (rng.random() > 0.12), t + 1.5
            if t >= turn:
                steering, turn = rng.uniform(-0.9, 0.9), t + rng.uniform(0.4, held)
            car.drive(steering=steering, throttle=throttle)


def own_model(run: Path, target: Path, poses: bool = True, measured: bool = False) -> Path:
    """The paper's model with what was measured, or data sheets say, extended by a diagnosis."""
    sheet, p = named_model(MEASURED, [run]) if measured else of_data_sheets()
    sides = check_inputs([read_run(run, poses=poses)], [], p)
    found = diagnose(sheet, p, sides.train, sides.test)
    save_model(msgspec.structs.replace(extended_model(found, sheet, sides.train, "any car"),
                                       name="own"), target)
    return target


def of_data_sheets() -> tuple[ModelFile, Vehicle]:
    """The paper's model with waits for a frame of the PWM, and the slew of the servo."""
    file, p = find_model("paper")
    p = apply(replace(p, delay=replace(p.delay, steering_s=FRAME_WAIT_S, throttle_s=FRAME_WAIT_S)),
              "steering_rate_limit", k=SERVO_S)
    return model_of(p, file), p


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--cars", type=int, default=30)
    parser.add_argument("--first-seed", type=int, default=100)
    parser.add_argument("--options", default="", help="of the later drives' URL: &effect=grip:-0.2")
    parser.add_argument("--calibrate", action="store_true", help="measure the car first")
    parser.add_argument("--poses", action="store_true", help="motion capture sees the drives")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder of the drives, not driven again")
    parser.add_argument("--out", type=Path, help="lines of JSON, resumed")
    given = parser.parse_args()
    seeds = range(given.first_seed, given.first_seed + given.cars)
    before = given.out.read_text().splitlines() if given.out and given.out.exists() else []
    lines = [line for line in map(json.loads, before) if line["seed"] in seeds]
    left = sorted({*seeds} - {line["seed"] for line in lines})
    for answer in answers(left, given.jobs, options=given.options, calibrate=given.calibrate,
                          poses=given.poses, keep=given.keep):
        lines.append(answer.line())
        print(json.dumps(lines[-1]), flush=True)
        if given.out:
            with given.out.open("a") as out:
                out.write(json.dumps(lines[-1]) + "\n")
    print(f"{sum(line['right'] for line in lines)} of {given.cars} silent or parameters only")
    return 0


def answers(seeds: Sequence[int], jobs: int, **given: Any) -> Iterator[Answer]:
    return each(partial(asked, **given), seeds, jobs, parts=len(seeds))


if __name__ == "__main__":
    raise SystemExit(main())
