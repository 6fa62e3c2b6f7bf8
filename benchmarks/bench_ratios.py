"""Costs as ratios to a reference in the same process, compared with the committed ones.

    python benchmarks/bench_ratios.py [--write]

A time depends on the machine and on its other work; the ratio of two times that were taken one
after the other depends little. A ratio more than 15 % above that of `ratios.json` is a regression.
`--write` replaces that file by the ratios of this run.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from statistics import median
from subprocess import run
from typing import NamedTuple

import numpy as np
from bare_nano import BOOTED, BareNano
from bench_decode import decode_bytewise, decode_live, draw_frames
from bench_emulation import MOCK, SPEED, URL, drive
from bench_lidar import BEAMS, SEED, draw_places, full_turn
from figures import Figure

from dart_hal.car import Car
from dart_hal.estimation.localisation.rays import LineIndex, fastest_cast
from dart_hal.vehicle import UPSTREAM_2024, Batch
from dart_hal.vehicle.native import make_native_step
from dart_hal.vehicle.native.build import compiler
from dart_hal.vehicle.native.library import is_switched_off
from dart_hal.vehicle.step import make_tick_step
from dart_lab.sim.lidar.maps import room_of

COMMITTED = Path(__file__).parent / "ratios.json"
# A ratio may be that many times the committed one. On two busy cores measurements of one ratio
# differ by 8 to 17 %, on another processor by more.
MAX_WORSE = 1.15
# A ratio above the limit is measured again, up to so many times in all, and the least counts: a
# disturbance passes, a regression stays.
TRIES = 5
ROUNDS = 15
# Of the ratios of the rounds the lower quartile counts: in four measurements its spread was 8 to
# 12 %, that of the ratio of the least times 15 to 24 %.
QUANTILE = 0.25
# Share of the frames that the pure Python loop of bench_decode decodes. It is the reference for
# the speed of the interpreter.
BYTEWISE_SHARE = 0.1
# Lengths of what is compared: drives and frames [s of the car], steps, scans.
DRIVE_S = 1.0
FRAMES_S = 100.0
TICKS = 4000
STEPS = 20
SCANS = 50

Work = Callable[[], object]
Clock = Callable[[], float]


class Pair(NamedTuple):
    """Two kinds of work whose costs are compared, and the clock of their CPU time [s]."""

    name: str
    work: Work
    reference: Work
    clock: Clock = time.process_time


def figures(scale: float = 1.0, max_worse: float = MAX_WORSE) -> list[Figure]:
    """Return one row per pair, with ``max_worse`` times its committed ratio as the limit.

    ``scale`` has no effect: a ratio depends on the lengths of what is compared.
    """
    committed = json.loads(COMMITTED.read_text(encoding="utf-8"))
    with ExitStack() as opened:
        return [judge(pair, committed[pair.name], max_worse) for pair in make_pairs(opened)]


def judge(pair: Pair, committed: float, max_worse: float = MAX_WORSE) -> Figure:
    """Return the row of a pair: the least ratio of up to ``TRIES`` measurements."""
    limit = max_worse * committed
    ratio = measure_ratio(pair)
    for _ in range(TRIES - 1):
        if ratio > limit:
            ratio = min(ratio, measure_ratio(pair))
    return Figure(f"ratio: {pair.name}", ratio, "x", high=limit, note=f"committed {committed:.3g}")


def measure_ratio(pair: Pair) -> float:
    """Return CPU time of the work over that of its reference, measured in turn."""
    ratios = []
    for _ in range(ROUNDS):
        begun = pair.clock()
        pair.work()
        middle = pair.clock()
        pair.reference()
        ratios.append((middle - begun) / (pair.clock() - middle))
    return float(np.quantile(ratios, QUANTILE))


def make_pairs(opened: ExitStack) -> list[Pair]:
    """Return the pairs; cars and folders stay open until ``opened`` is closed."""
    folder = Path(opened.enter_context(tempfile.TemporaryDirectory()))

    def open_car(url: str, record: str = "") -> Car:
        car = opened.enter_context(Car.open(url, record=folder / record if record else None))
        car.arm()
        return car

    emulated, recorded, mock = open_car(URL), open_car(URL, "run.mcap"), open_car(MOCK)
    bare = opened.enter_context(BareNano())
    bare.run(BOOTED)
    bare.roll(SPEED)
    frames = draw_frames(FRAMES_S)
    stream = b"".join(frames[:round(BYTEWISE_SHARE * len(frames))])

    def run_bare() -> None:
        bare.run(DRIVE_S, 1e-3)

    def read_bytewise() -> None:
        decode_bytewise(stream)

    return [
        Pair("emulated car over the firmware alone", lambda: drive(emulated, DRIVE_S), run_bare),
        Pair("the same, recorded", lambda: drive(recorded, DRIVE_S), run_bare),
        Pair("car on MockNano over the byte loop", lambda: drive(mock, DRIVE_S),
             read_bytewise),
        Pair("decoder over the byte loop", lambda: decode_live(frames),
             read_bytewise),
        *make_kernel_pairs(),
        Pair("import of Car over that of numpy", make_import("from dart_hal import Car"),
             make_import("import numpy"), measure_children)]


def make_kernel_pairs() -> list[Pair]:
    """Return the pairs of compiled code over Python and numpy; none without a compiler."""
    if is_switched_off() or compiler() is None:
        return []
    start = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 3.0, 1.0, 0.0, 0.98, 0.2
    ticks = [make(UPSTREAM_2024) for make in (
        lambda p: make_native_step(p, "tick", 1e-3), lambda p: make_tick_step(p, dt=1e-3))]
    many = [Batch(UPSTREAM_2024, 10_000, engine=engine) for engine in ("native", "numpy")]
    held = np.full(10_000, 0.3), np.full(10_000, 0.2)
    room = room_of("track", SEED)
    all_pairs = fastest_cast()
    index = LineIndex(room.lines)
    casts = [index.cast, lambda origin, direction: all_pairs(room.lines, origin, direction)]
    direction = full_turn()
    origins = [np.tile(place, (BEAMS, 1)) for place in draw_places(room.start, SCANS)]

    def repeat(step: Callable[..., object]) -> Work:
        return lambda: [step(*start) for _ in range(TICKS)]

    def advance(batch: Batch) -> Work:
        return lambda: batch.advance(*held, steps=STEPS)

    def cast(rays: Callable[..., object]) -> Work:
        return lambda: [rays(origin, direction) for origin in origins]

    return [Pair("tick of a car, compiled over Python", *map(repeat, ticks)),
            Pair("10,000 cars, compiled over numpy", *map(advance, many)),
            Pair("lidar on a track, index over all pairs of beams and lines", *map(cast, casts))]


def make_import(statement: str) -> Work:
    """Return the work of starting an interpreter that runs a statement."""
    return lambda: run([sys.executable, "-c", statement], check=True)


def measure_children() -> float:
    """Return the CPU time [s] of all ended child processes."""
    used = getrusage(RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Print the ratios, or write them to ``ratios.json``."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="commit the ratios of this run")
    write = parser.parse_args().write
    with ExitStack() as opened:
        ratios = {pair.name: round(median(measure_ratio(pair) for _ in range(TRIES)), 3)
                  for pair in make_pairs(opened)}
    text = json.dumps(ratios, indent=1) + "\n"
    if write:
        COMMITTED.write_text(text, encoding="utf-8")
    print(text, end="")


if __name__ == "__main__":
    main()
