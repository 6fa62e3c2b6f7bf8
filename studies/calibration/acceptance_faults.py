"""Which faults of a new car does ``dart-hal accept`` notice, and how often does a sound one fail?

    python -m studies.calibration.acceptance_faults --cars 10 --jobs 2

The hidden car of each seed is checked without a fault, and with each of ``FAULTS``. A fault is
noticed if the car does not open, a step fails, or the value that is named for the fault differs
from the emulated car's. A false alarm is the same of the sound car: a step that fails, or that
value differs. Values that are each car's own, such as the bias of the gyro, differ in sound cars
too; they are listed with their rates, and no fault is judged by them.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from tempfile import TemporaryDirectory
from typing import Any, cast

from dart_hal.calibration.acceptance import (
    STEP_NAMES,
    STEPS,
    AcceptanceBench,
    AcceptanceOutcome,
    Inspector,
    agrees,
    run_step,
)
from dart_hal.car import Car
from dart_hal.core.errors import DartHalError
from dart_hal.core.process.jobs import each
from dart_hal.devices.links.base import open_backend

EMULATED = "sim://?nano=mock"
NOT_OPENED = "open"


@dataclass(frozen=True)
class BuildFault:
    """A mistake in building a car: what it is, its part of the URL, the steps that may notice it.

    key: value that shows it; empty if a step fails.
    """

    title: str
    options: str
    steps: tuple[str, ...]
    key: str = ""


FAULTS = (
    BuildFault("encoder unplugged", "fail=enc:off@0", ("rotation",)),
    BuildFault("encoder sees every second mark", "fail=enc:wrong=0.5@0", ("rotation",),
               "edges_per_turn"),
    BuildFault("encoder with a loose contact", "fail=enc:intermittent=0.3@0", ("rotation", "esc"),
               "edges_per_turn"),
    BuildFault("noise on the encoder's wire", "fail=enc:garbage@0", ("rotation", "esc"),
               "edges_per_turn"),
    BuildFault("IMU unplugged", "fail=imu:off@0", ("rest",)),
    BuildFault("IMU repeats one sample", "fail=imu:stuck@0", ("rest", "gyro")),
    BuildFault("gyro reads twice the rate", "fail=imu:wrong@0", ("gyro",), "imu.gyro_scale"),
    BuildFault("IMU samples at 10 Hz", "fail=imu:slow@0", ("rest",), "imu_rate"),
    BuildFault("motor's leads swapped", "fail=esc:wrong@0", ("esc",)),
    BuildFault("controller without its battery", "fail=esc:off@0", ("esc",)),
    BuildFault("wheel blocked", "fail=wheel:stuck@0", ("esc",)),
    BuildFault("car not lifted", "fail=stand:off@0", ("esc",)),
    BuildFault("1 % of the line's bytes lost", "fail=line:wrong=0.01@0", ("rest",), "lost_frames"),
    BuildFault("line 50 ms late", "fail=line:delayed=0.05@0", ("rest", "delay"),
               "latency.sensor_to_host"),
    BuildFault("PCA9685 unplugged", "fail=pca:off@0", ("pwm", "cutoff"), "arming"),
    BuildFault("Nano at 4.0 V", "fail=power:droop=4.0@0", ("rest",), "nano_supply"),
    BuildFault("cut-off with a weak pull-up", "cutoff=oe-weak", ("cutoff",), "cutoff_test"),
    BuildFault("multiplexer's input floats", "cutoff=mux-floating", ("cutoff",), "cutoff_test"),
    BuildFault("controller 40 ms late", "effect=throttle_delay:0.04", ("delay", "wheel"),
               "latency.pulse_to_wheel"),
    BuildFault("three marks of the ring missing", "effect=encoder_ring:0.15", ("rotation",),
               "edges_per_turn"),
)
SOUND = BuildFault("sound", "", STEP_NAMES)


@dataclass(frozen=True)
class CheckedCar:
    """failed: steps that failed, or NOT_OPENED; differs: values that differ from the prediction."""

    failed: frozenset[str]
    differs: frozenset[str]

    def shows(self, fault: BuildFault) -> bool:
        """Whether the steps or the value of a fault show it."""
        return bool(self.failed & {*fault.steps, NOT_OPENED}) or fault.key in self.differs


def run_steps(url: str, names: Sequence[str]) -> list[AcceptanceOutcome]:
    """Run steps on a simulated car without files of its own. Errors: those of opening it."""
    backend = open_backend(url)
    with TemporaryDirectory() as folder, Car.over(backend, cars=folder) as car:
        bench = AcceptanceBench(car, cast("Inspector", backend.workshop))
        return [run_step(step, bench) for step in STEPS if step.name in names]


def check_car(job: tuple[int, BuildFault], predicted: dict[str, Any]) -> CheckedCar:
    """Check one car with one fault; job: (seed, fault). predicted: values of the emulated car."""
    seed, fault = job
    try:
        done = run_steps(f"{EMULATED}&seed={seed}&{fault.options}".rstrip("&"), fault.steps)
    except DartHalError:
        return CheckedCar(frozenset({NOT_OPENED}), frozenset())
    found = {value.key: agrees(value, predicted[value.key]) for outcome in done
             for value in outcome.findings if value.key in predicted}
    return CheckedCar(frozenset(o.step.name for o in done if o.status == "failed"),
                      frozenset(key for key, same in found.items() if same is False))


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--cars", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    seeds = range(given.first_seed, given.first_seed + given.cars)
    predicted = {value.key: value for outcome in run_steps(EMULATED, STEP_NAMES)
                 for value in outcome.findings}
    jobs = [(seed, fault) for fault in (SOUND, *FAULTS) for seed in seeds]
    checked = list(each(partial(check_car, predicted=predicted), jobs, given.jobs,
                        parts=len(jobs)))
    sound = checked[:len(seeds)]
    print("| fault | noticed | by | sound cars with the same |\n|---|---:|---|---:|")
    missed = 0
    for k, fault in enumerate(FAULTS, start=1):
        mine = checked[k * len(seeds):(k + 1) * len(seeds)]
        noticed = sum(one.shows(fault) for one in mine)
        missed += len(seeds) - noticed
        by = sorted({name for one in mine for name in (
            *one.failed, *(one.differs & {fault.key}))})
        alarms = sum(one.shows(fault) for one in sound)
        print(f"| {fault.title} | {noticed}/{len(seeds)} | {', '.join(by)} "
              f"| {alarms}/{len(seeds)} |")
    total = len(FAULTS) * len(seeds)
    print(f"{total - missed} of {total} noticed; "
          f"{sum(bool(one.failed) for one in sound)} of {len(seeds)} sound cars fail a step")
    own = sorted({key for one in sound for key in one.differs})
    print("values that differ in sound cars:", ", ".join(
        f"{key} {sum(key in one.differs for one in sound)}/{len(seeds)}" for key in own))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
