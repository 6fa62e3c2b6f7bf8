"""Recordings of two cars in one set: how often are they found, and does one car ever alarm?

    python -m studies.diagnosis.mixed_cars [--sets N]    about a minute of CPU

Sets of recordings without names: those of one car on several days (controls), and mixtures. Real
ones are drawn from $DART_DATA and $OTHER_CARS_DATA. A simulated car has another trim, floor and
battery in each drive, and the other one differs from it in one quantity by a stated share.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dart_hal.car.runs import read_any
from dart_hal.recording.dart.model import Recording, freeze
from dart_hal.recording.dart.response import (
    Response,
    compare_pair,
    compare_responses,
    measure_response,
)
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.sets import PAPER
from dart_lab.diagnosis.split import hold_out
from studies.diagnosis import hidden_drive
from studies.diagnosis.known_frame import read
from studies.diagnosis.other_car import DATA

DART_DATA = Path(os.environ.get("DART_DATA", DATA.parent / "dart"))
CAR_DIFFERENCES = {"steering": (-0.5, -0.4, -0.3, -0.2, -0.1, 0.1, 0.2, 0.3, 0.4, 0.5),
           "motor": (-0.4, -0.2, 0.4), "encoder": (0.1, 0.2, 0.3)}
DRIVES_OF_CAR = 8  # of each simulated car
DRIVE_DURATION = 60.0  # s


def simulate_drive(seed: int, steering: float = 0.0, motor: float = 0.0, encoder: float = 0.0
                   ) -> Response:
    """Simulate a drive with its own trim, floor and battery; return its response."""
    rng = np.random.default_rng([seed, 1])
    p = apply(PAPER, "steering_gain", k=steering)
    p = apply(p, "steering_trim", k=float(rng.normal(0.0, 0.02)))
    p = apply(p, "grip", k=float(rng.uniform(-0.3, 0.1)))
    p = apply(p, "motor_gain", k=motor + float(rng.uniform(-0.1, 0.1)))
    with tempfile.TemporaryDirectory() as folder:
        made = read(hidden_drive.write(Path(folder) / f"{seed}.csv", p, seed=seed,
                                       plan=hidden_drive.Plan(seconds=DRIVE_DURATION)))
    messages = replace(made.messages, speed=freeze(made.messages.speed * (1.0 + encoder)))
    return measure_response(replace(made, messages=messages))


def simulate_car(number: int, **change: float) -> list[Response]:
    """Simulate all drives of a car; number: of the car, for other seeds."""
    return [simulate_drive(100 * number + k, **change) for k in range(DRIVES_OF_CAR)]


def read_responses(folder: Path) -> list[Response]:
    """Read all recordings below a folder, and measure them."""
    files = [f for f in sorted(folder.rglob("*")) if f.name.endswith((".csv", ".csv.gz"))]
    return [measure_response(r) for r in read_any(files)[0]]


def halve(recordings: Sequence[Recording]) -> list[Response]:
    """Return the responses of both halves of each recording."""
    return [measure_response(part) for r in recordings
            for side in hold_out([r], 0.5) for part in side]


def draw_sets(rng: np.random.Generator, cars: Sequence[Sequence[Response]], number: int
              ) -> Iterator[list[Response]]:
    """Draw sets of one to four recordings of each car, at least two in total."""
    for _ in range(number):
        parts = [rng.choice(len(car), min(int(rng.integers(1, 5)), len(car)), replace=False)
                 for car in cars]
        chosen = [car[k] for car, part in zip(cars, parts, strict=True) for k in part]
        yield chosen if len(chosen) > 1 else [cars[0][0], cars[0][1]]


def count_alarms(sets: Sequence[Sequence[Response]]) -> tuple[int, int, int]:
    """Return (alarms, sets, sets in which two recordings can be compared at all)."""
    kinds = ("steering_poses", "steering_sensors", "throttle_poses", "throttle_sensors", "encoder")
    comparable = sum(any(compare_pair(a, b, kind) is not None for kind in kinds
                         for i, a in enumerate(part) for b in part[i + 1:]) for part in sets)
    return sum(compare_responses(part) is not None for part in sets), len(sets), comparable


def list_sets(number: int) -> Mapping[str, list[list[Response]]]:
    """Return the sets of each row of the table."""
    rng = np.random.default_rng(0)
    dart = read_responses(DART_DATA) + read_responses(DATA / "dart_unused")
    f1tenth = read_responses(DATA / "f1tenth_upenn2022")
    zheng = halve(read_any([DATA / "zheng2022" / "day1.csv.gz"])[0])
    base = simulate_car(0)

    def mix(*cars: Sequence[Response]) -> list[list[Response]]:
        return list(draw_sets(rng, cars, number))

    out = {"DART, all 88 recordings of 2024 and 2025": [dart], "DART, drawn": mix(dart, dart),
           "F1TENTH, both recordings": [f1tenth], "1:10 car, both halves": [zheng],
           "simulated car": mix(base, base),
           "DART, 1:10 car": mix(dart, zheng), "DART, F1TENTH": mix(dart, f1tenth),
           "1:10 car, F1TENTH": mix(zheng, f1tenth)}
    changes = [{what: k} for what, sizes in CAR_DIFFERENCES.items() for k in sizes]
    for i, change in enumerate(changes, 1):
        other = simulate_car(i, **change)
        what, size = next(iter(change.items()))
        out[f"simulated, {what} {size:+.0%}"] = mix(base, other)
    return out


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=40, help="sets of each row")
    print("| recordings of | sets | comparable | refused |")
    print("|---|---:|---:|---:|")
    for name, sets in list_sets(parser.parse_args().sets).items():
        alarms, total, comparable = count_alarms(sets)
        print(f"| {name} | {total} | {comparable} | {alarms} |", flush=True)


if __name__ == "__main__":
    main()
