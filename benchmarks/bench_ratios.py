"""Costs as ratios, measured in turn in one process, against those that were committed.

    python benchmarks/bench_ratios.py --write    commit the figures of this version

A ratio depends little on the machine and on its other work, so that a slower version shows.
``make bench ARGS="--only ratios --strict"`` fails if one is more than MAX_WORSE of the committed
one.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from bare_nano import BOOTED, BareNano
from bench_emulation import MOCK, SPEED, URL, drive
from figures import Figure

from dart_hal.car import Car
from dart_hal.vehicle.bicycle import make_acceleration
from dart_hal.vehicle.sets import PAPER

SECONDS = 4.0
"""s of the car in each round."""
ROUNDS = 7
"""Their median is little affected by a disturbance in up to three of them."""
MAX_WORSE = 1.15
REFERENCE = Path(__file__).with_name("ratios.json")
PYTHON_STEPS = 200_000
"""Evaluations of the equations of motion in pure Python, for what has no firmware in it."""


def figures(scale: float = 1.0) -> list[Figure]:
    """Rows of the table: each ratio, at most MAX_WORSE of the committed one; half a minute."""
    committed = json.loads(REFERENCE.read_text(encoding="utf-8"))
    return [Figure(name, value, "x", high=round(MAX_WORSE * committed[name], 3),
                   note=f"committed: {committed[name]:.3g}")
            for name, value in measure_ratios(SECONDS).items()]


def measure_ratios(seconds: float) -> dict[str, float]:
    """Measure all programs in turn, ROUNDS times; return the medians of their ratios."""
    with ExitStack() as open_until_end:
        folder = Path(open_until_end.enter_context(tempfile.TemporaryDirectory()))
        loop = open_until_end.enter_context(Car.open(URL))
        recorded = open_until_end.enter_context(Car.open(URL, record=folder / "run.mcap"))
        mock = open_until_end.enter_context(Car.open(MOCK))
        for car in (loop, recorded, mock):
            car.arm()
        bare = open_until_end.enter_context(BareNano())
        bare.run(BOOTED)
        bare.roll(SPEED)
        acceleration = make_acceleration(PAPER)
        programs: dict[str, Callable[[], object]] = {
            "firmware": lambda: bare.run(seconds, 1e-3),
            "loop": lambda: drive(loop, seconds),
            "recorded": lambda: drive(recorded, seconds),
            "mock": lambda: drive(mock, seconds),
            "python": lambda: [acceleration(1.0, 0.0, 0.5, 0.3, 0.1)
                               for _ in range(PYTHON_STEPS)],
        }
        rounds = [{name: measure_cpu(run) for name, run in programs.items()}
                  for _ in range(ROUNDS)]

    def ratio(one: str, other: str) -> float:
        return float(np.median([cpu[one] / cpu[other] for cpu in rounds]))

    return {"emulated car over firmware alone": ratio("loop", "firmware"),
            "emulated car, recorded, over not recorded": ratio("recorded", "loop"),
            "mock car, a second, over 100,000 evaluations of the model":
                ratio("mock", "python") * PYTHON_STEPS / 100_000 / seconds}


def measure_cpu(run: Callable[[], object]) -> float:
    """Return the CPU time [s] of one run."""
    begin = time.process_time()
    run()
    return time.process_time() - begin


if __name__ == "__main__":
    found = {name: round(value, 3) for name, value in measure_ratios(SECONDS).items()}
    print(json.dumps(found, indent=1))
    if "--write" in sys.argv:
        REFERENCE.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
