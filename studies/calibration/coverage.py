"""How often the 90 % intervals of the calibrations hold the hidden truth.

    make coverage                                 both campaigns on 100 hidden cars, gone on with
    python -m studies.calibration.coverage --seeds 30 --jobs 2 --plot coverage.png
    python -m studies.calibration.coverage --seeds 40 throttle circle       one verb by itself
    python -m studies.calibration.coverage --cluster tcp://192.168.1.5:8786 throttle

"all" is calibrate all, a minute of CPU a car; "joint" is identify --joint on four drives of a car
that "all" has measured, another minute. Each car of "latency" by itself, and of "lagging", which
is esc, has a delay and a lag of its motor drawn from its seed; "steering" by itself is of a car
that nothing has measured before. One row per quantity: the share of its intervals that hold the
truth, rms of error by standard error, worst of both. In the pooled share every quantity of every
car weighs the same, the 20 numbers of a ring as one. Host crystal, filter of the gyro and rear tyre
are drawn from the seed as well (``real_parts``). The workers of a cluster start in a checkout that
all of them share: "joint" reads what "all" has written.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dart_hal.core.errors import DartHalError
from dart_hal.core.process.cluster import use_cluster
from dart_hal.core.process.jobs import each
from dart_hal.core.types import INTERVAL_90
from studies.calibration.hidden_errors import VERBS, Errors, errors
from studies.calibration.joint_errors import calibrated, joint_errors

RESULTS = Path(__file__).resolve().parents[2] / "build" / "coverage" / "results.jsonl"
CARS = RESULTS.parent / "cars"
"""A folder for each seed: what ``calibrate all`` found of its car, and the drives of "joint"."""
Line = dict[str, Any]
"""verb, seed and errors of a car by quantity; failed: why there are none."""
KEPT = ("all", "joint")
EACH, POOLED = (0.82, 0.97), (0.87, 0.93)
"""Shares that are wanted of each quantity and of all."""


class Row(NamedTuple):
    """One quantity over ``cars`` cars: share of intervals inside, rms and worst of z, and the
    worst error."""

    name: str
    cars: int
    share: float
    rms: float
    worst_z: float
    worst: float


def measure_car(job: tuple[int, Sequence[str]]) -> list[Line]:
    """Return the lines of the results of one car; job: (seed, verbs).

    The verbs of a car run one after another, "all" first: "joint" reads what "all" has written, and
    would find another car if both ran at the same time.
    """
    seed, verbs = job
    return [measure(verb, seed) for verb in sorted(verbs, key=lambda verb: verb != "all")]


def measure(verb: str, seed: int) -> Line:
    """Return a line of the results: a verb on a car of a seed."""
    folder = CARS / str(seed)
    try:
        found = (errors(verb, seed) if verb not in KEPT
                 else joint_errors(seed, folder) if verb == "joint" else calibrated(seed, folder))
        return {"verb": verb, "seed": seed, "errors": found}
    except DartHalError as error:
        return {"verb": verb, "seed": seed, "errors": {}, "failed": str(error)}


def rows_of(found: list[Errors]) -> list[Row]:
    """One for each quantity, and the last for all of them."""
    z: dict[str, list[np.ndarray]] = defaultdict(list)
    worst: dict[str, float] = defaultdict(float)
    for car in found:
        for name, pairs in car.items():
            error, std = np.array(pairs).T
            z[name].append(error / std)
            worst[name] = max(worst[name], float(np.max(np.abs(error))))
    rows = [Row(name, len(of), share_of(of), float(np.sqrt(np.mean(np.concatenate(of) ** 2))),
                float(np.max(np.abs(np.concatenate(of)))), worst[name]) for name, of in z.items()]
    every = [one for of in z.values() for one in of]
    return [*rows, Row("pooled", len(found), share_of(every), np.nan, np.nan, np.nan)]


def share_of(z: list[np.ndarray]) -> float:
    """Of intervals that hold the truth, the numbers of one quantity of one car counted as one."""
    return float(np.mean([np.mean(np.abs(one) < INTERVAL_90) for one in z]))


def plot(rows: list[Row], path: Path) -> None:
    """Shares of all quantities beside what is wanted, with what chance does to as many cars."""
    from dart_hal.core.figures import BLUE, INK, ORANGE, finish, new_figure, save_figure

    figure = new_figure((7.2, 0.27 * len(rows) + 1.3), path)
    axis = figure.subplots()
    axis.axvspan(*EACH, color="0.9", label="wanted of each")
    axis.axvspan(*POOLED, color="0.78", label="wanted of all")
    axis.axvline(0.9, color=INK, lw=0.8)
    for k, row in enumerate(rows):
        pooled = row.name == "pooled"
        chance = np.sqrt(0.9 * 0.1 / row.cars)      # of honest intervals
        axis.errorbar(row.share, k, xerr=None if pooled else chance, fmt="o", ms=5,
                      color=ORANGE if pooled else BLUE, capsize=2)
    axis.set_yticks(range(len(rows)), [row.name for row in rows], fontsize=8)
    axis.invert_yaxis()
    axis.set_xlim(min(0.6, min(row.share for row in rows) - 0.05), 1.02)
    finish(axis, "share of the 90 % intervals that hold the truth, +- one sigma of chance", "",
           f"calibrate all on {rows[-1].cars} hidden cars")
    save_figure(figure, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("verbs", nargs="*", default=["all"], metavar="VERB",
                        help=f"{', '.join(KEPT)}, {', '.join(VERBS)}")
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--cluster", metavar="ADDRESS",
                        help="of a dask scheduler, in place of --jobs")
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--plot", type=Path)
    given = parser.parse_args()
    cases = [(verb, seed) for seed in range(given.first, given.first + given.seeds)
             for verb in given.verbs]
    given.results.parent.mkdir(parents=True, exist_ok=True)
    lines = given.results.read_text().splitlines() if given.results.is_file() else []
    done = {(line["verb"], line["seed"]): line for line in map(json.loads, lines)}
    left: dict[int, list[str]] = {}
    for verb, seed in cases:
        if (verb, seed) not in done:
            left.setdefault(seed, []).append(verb)
    with use_cluster(given.cluster), given.results.open("a") as file:
        for car in each(measure_car, list(left.items()), given.jobs, parts=len(left)):
            for line in car:
                done[line["verb"], line["seed"]] = line
                file.write(json.dumps(line) + "\n")
            file.flush()
    # Lines come in any order, and are the same file on one machine and on a cluster.
    ordered = sorted(done.values(), key=lambda line: (line["seed"], line["verb"]))
    part = given.results.with_name(f"{given.results.name}.part")
    part.write_text("".join(json.dumps(line) + "\n" for line in ordered))
    part.replace(given.results)
    for verb in given.verbs:
        found = [done[case] for case in cases if case[0] == verb]
        rows = rows_of([line["errors"] for line in found if line["errors"]])
        report(verb, rows, found)
        if given.plot and verb == given.verbs[0]:
            plot(rows, given.plot)


def report(verb: str, rows: list[Row], found: list[dict[str, Any]]) -> None:
    """Print a line for each quantity of a verb, and one for each car that failed."""
    print(f"\n{verb}")
    for row in rows:
        print(f"{row.name:30s} {row.cars:4d} cars {100 * row.share:5.1f} % inside, "
              f"z rms {row.rms:.2f}, worst {row.worst_z:.1f} sigma, worst error {row.worst:.3g}")
    for line in found:
        if "failed" in line:
            print(f"{verb} of car {line['seed']}: {line['failed']}")


if __name__ == "__main__":
    main()
