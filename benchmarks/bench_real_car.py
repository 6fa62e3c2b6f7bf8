"""Benchmark on the real car: how well models predict recordings that they were not fitted to.

    python benchmarks/bench_real_car.py DATA --jobs 2

Twelve recordings are held out in four groups of three, each of another kind of driving; models are
fitted to all other recordings of the same car and season (--together 1: each alone, with three
times the work). A second split is by day. Four recordings on which nothing was developed are a
third, with all others for training. Errors are those of ``dart-hal evaluate`` 1 s ahead:

1. constant velocity: speed and yaw rate stay as they are (CTRV);
2. paper: the published parameters;
3. refit: the same equations, parameters estimated from the training recordings;
4. best predictor: with the physical effects of ``diagnose(predictor=True)``;
5. neural residual: the refit and a network that adds accelerations, see ``neural_residual``.

--check compares the best predictor with the figures of an earlier run, written by --json.
"""

from __future__ import annotations

import os

# as the command line: results do not depend on the number of processes
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false "
                      "intra_op_parallelism_threads=1")

import argparse
import json
import sys
import time
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from dart_hal.car.runs import read_any
from dart_hal.core.errors import DartHalError
from dart_hal.core.process.jobs import each
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.error_summaries import Ratio, geometric_mean
from dart_lab.identification.evaluation.cases import prepare, short
from dart_lab.identification.evaluation.prediction import CHANNELS, ERROR_UNITS

HELD_OUT = (
    "91_free_driving_16_sept_2024/car_1_Datarecording_09_16_2024_10_01_01.csv",
    "80_circles_rubbery_floor/car_1_Datarecording_09_04_2024_12_23_23.csv",
    "81_throttle_ramps/car_1_Datarecording_09_09_2024_15_46_50steer02_ramp.csv",
    "steering_identification_25_sept_2024/car_1_Datarecording_09_25_2024_09_57_26.csv",
    "60_racetrack_lap_v_060/racetrack_lap_v060.csv",
    "81_throttle_ramps/car_1_Datarecording_09_09_2024_16_15_13steeringneg02_ramp.csv",
    "91_free_driving_16_sept_2024/car_1_Datarecording_09_16_2024_10_12_05.csv",
    "circles_27_sept_2024_fast_ramp/car_1_Datarecording_09_27_2024_18_18_37.csv",
    "81_throttle_ramps/car_1_Datarecording_09_09_2024_16_05_28steer015_ramp.csv",
    "steering_identification_25_sept_2024/car_1_Datarecording_09_25_2024_09_50_18.csv",
    "80_circles_rubbery_floor/car_1_Datarecording_09_04_2024_11_00_46.csv",
    "81_throttle_ramps/car_1_Datarecording_09_09_2024_16_53_03steering_neg03_ramp.csv")
"""Recordings of at least a minute, July to September 2024: one car with the same tyres and weight.
In order of the groups: three kinds of driving in each, of which others remain in the training."""
GROUP = 3
"""Recordings held out at a time: five fits in all, with the split by day."""
TRAINING_ONLY = (
    "circles_27_sept_2024/car_1_Datarecording_09_27_2024_12_06_55.csv",
    "steering_identification_25_sept_2024/car_1_Datarecording_09_25_2024_09_54_57.csv",
    "steering_identification_25_sept_2024/car_1_Datarecording_09_25_2024_10_00_45.csv")
"""The shorter ones: 8, 50 and 34 windows are too few to judge by."""
NEVER_USED = tuple(
    f"other/dart_unused/car_1_Datarecording_{time}.csv.gz"
    for time in ("09_04_2024_12_11_23", "09_09_2024_14_12_45", "09_09_2024_15_34_53",
                 "09_27_2024_10_44_33"))
"""Circles to one side, of days on which other recordings train. A fifth has a single window."""
TRAIN_DAYS = ("80_", "81_", "steering_identification_25", "circles_27_sept_2024_fast")
TEST_DAYS = ("91_", "60_")
CTRV, PAPER, REFIT = "constant velocity", "paper", "refit"
BEST, NEURAL = "best predictor", "neural residual"
TITLES = ("held out", "split by day", "never used")
MAX_WORSE = 1.02
"""Geometric mean of the best predictor's errors over those of the reference."""
REFERENCE = Path(__file__).with_name("real_car_reference.json")


def judge(work: tuple[Sequence[Recording], Sequence[Recording], bool]) -> list[dict[str, Any]]:
    """Fit all models to training recordings; return their errors on each test recording.

    work: (training recordings, test recordings, with the neural residual).
    """
    train, test, neural = work
    began = time.process_time()
    model, vehicle = find_model("paper")
    # no search for causes: the one effect that is considered costs little
    d = diagnose(model, vehicle, train, test, max_causes=0, only=["gyro_bias"], predictor=True)
    assert d.predictor is not None
    found = {CTRV: d.ctrv, PAPER: d.stages[0].horizons, REFIT: d.stages[1].horizons,
             BEST: d.predictor.horizons}
    l_r = apply_parameter_effects(vehicle).body.l_r
    cases = prepare(test, l_r=l_r).cases
    rmse = {case.file: {name: [horizons["1.0"]["by_file"][case.file][c] for c in CHANNELS]
                        for name, horizons in found.items()} for case in cases}
    if neural:
        import neural_residual

        refit = d.stages[1].vehicle
        windows = neural_residual.make_windows(refit, prepare(train, l_r=l_r).cases)
        network, _ = neural_residual.train(refit, windows)
        scales = neural_residual.make_scales(windows)
        for case in cases:
            errors = neural_residual.compute_errors(refit, network, scales, [case])
            rmse[case.file][NEURAL] = errors.tolist()
    cpu = time.process_time() - began
    return [{"held_out": case.file, "windows": len(case), "rmse": rmse[case.file],
             "effects": list(d.predictor.effects), "cpu_s_of_group": cpu} for case in cases]


def read(data: Path) -> dict[str, Recording]:
    """Read all recordings of the benchmark by folder and file; data: with or without ``other``."""
    root = data / "dart" if (data / "dart").is_dir() else data
    paths = [root / name for name in (*HELD_OUT, *TRAINING_ONLY)]
    paths += [path for path in (data / name for name in NEVER_USED) if path.is_file()]
    return {f"{r.path.parent.name}/{r.path.name}": r for r in read_any(paths)[0]}


def split_by_day(recordings: dict[str, Recording]) -> tuple[list[Recording], list[Recording]]:
    """Return (training, test) recordings of other days."""
    train, test = ([r for k, r in recordings.items() if k.startswith(days)]
                   for days in (TRAIN_DAYS, TEST_DAYS))
    return train, test


def splits(recordings: dict[str, Recording], count: int, together: int, neural: bool
           ) -> list[tuple[str, tuple[list[Recording], list[Recording], bool]]]:
    """Make the work of ``judge``, with the title of its tables.

    The first count recordings of the list are judged, and their whole groups are held out. If that
    is all of them, the split by day follows, and the recordings that were never used.
    """
    never_used = {k: r for k, r in recordings.items() if f"other/{k}" in NEVER_USED}
    used = {k: r for k, r in recordings.items() if k not in never_used}
    out = []
    for first in range(0, min(count, len(HELD_OUT)), together):
        group = HELD_OUT[first:first + together]
        out.append((TITLES[0], ([r for k, r in used.items() if k not in group],
                                [used[k] for k in group[:count - first]], neural)))
    if count >= len(HELD_OUT):
        out.append((TITLES[1], (*split_by_day(used), neural)))
        if never_used:
            out.append((TITLES[2], (list(used.values()), list(never_used.values()), neural)))
    return out


def log_errors(folds: Sequence[dict[str, Any]], model: str) -> FloatArray:
    """ln RMSE (recordings, channels) of a model."""
    return np.log([fold["rmse"][model] for fold in folds])


def compare(folds: Sequence[dict[str, Any]], reference: Sequence[dict[str, Any]],
            model: str = BEST) -> float:
    """Geometric mean over recordings and channels of a model's errors over the reference's.

    Raises KeyError for a recording that the reference lacks.
    """
    known = {fold["held_out"]: fold for fold in reference}
    before = [known[fold["held_out"]] for fold in folds]
    return float(np.exp(np.mean(log_errors(folds, model) - log_errors(before, model))))


def tables(folds: Sequence[dict[str, Any]], title: str) -> list[Table]:
    """Make the tables of some recordings held out."""
    heads = [f"{c} {u}".replace("yaw_deg deg", "yaw deg")
             for c, u in zip(CHANNELS, ERROR_UNITS, strict=True)]
    models = list(folds[0]["rmse"])
    weights = [fold["windows"] for fold in folds]
    n = len(folds)
    out = [Table("model", *heads, title=f"{title}: RMSE 1 s ahead, {sum(weights)} windows of {n} "
                 "recordings")]
    for name in models:
        square = np.exp(2.0 * log_errors(folds, name))
        out[-1].add_row(name, *_figures(np.sqrt(np.average(square, axis=0, weights=weights))))

    out.append(Table("model", *CHANNELS, "all", "90 % interval of all",
                     title="RMSE over that of the refit, geometric mean over recordings"))
    for name in models:
        ratio = log_errors(folds, name) - log_errors(folds, REFIT)
        by_recording = ratio.mean(axis=1)
        of_all = np.exp(by_recording.mean())
        interval = geometric_mean(np.exp(by_recording)) if n > 1 else Ratio(of_all, 0.0, np.inf)
        out[-1].add_row(name, *_figures(np.exp(ratio.mean(axis=0))), f"{of_all:.3f}",
                        f"{interval.low:.3f} to {interval.high:.3f}")

    out.append(Table("against", *CHANNELS, "all (geometric mean)",
                     title=f"recordings of {n} in which the best predictor is better"))
    for name in (m for m in models if m != BEST):
        gain = log_errors(folds, name) - log_errors(folds, BEST)
        out[-1].add_row(name, *(str(int(k)) for k in (gain > 0.0).sum(axis=0)),
                        str(int((gain.mean(axis=1) > 0.0).sum())))

    out.append(Table("recording held out", "windows", *(m for m in models if m != REFIT),
                     title="RMSE over that of the refit, geometric mean over channels"))
    for fold in folds:
        ratios = [np.exp((log_errors([fold], m) - log_errors([fold], REFIT)).mean())
                  for m in models if m != REFIT]
        out[-1].add_row(short(fold["held_out"]), str(fold["windows"]), *_figures(ratios))
    return out


def _figures(values: Sequence[float]) -> list[str]:
    return [f"{v:.3f}" for v in values]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; 1 if --check finds the best predictor worse than before."""
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("data", type=Path, help="folder of the recordings")
    p.add_argument("--recordings", type=int, default=len(HELD_OUT), metavar="N",
                   help="judge the first N of the list alone, without the other splits")
    p.add_argument("--together", type=int, default=GROUP, metavar="K",
                   help="recordings held out at a time")
    p.add_argument("--no-neural", action="store_true", help="without the black box (needs no JAX)")
    p.add_argument("--jobs", type=int, default=1, help="processes")
    p.add_argument("--json", type=Path, metavar="FILE",
                   help="write all figures, after each group those so far")
    p.add_argument("--check", action="store_true",
                   help=f"compare with {REFERENCE.name}; exit status 1 if worse by more than 2 %%")
    o = p.parse_args(arguments)
    if o.check and (o.together != GROUP or o.recordings < len(HELD_OUT)):
        p.error(f"--check compares all recordings in groups of {GROUP}: leave out --together and "
                "--recordings")
    reference = json.loads(REFERENCE.read_text(encoding="utf-8")) if o.check else None
    began = time.monotonic()
    found: dict[str, list[dict[str, Any]]] = {title: [] for title in TITLES}
    folds, days, never_used = found.values()
    try:
        work = splits(read(o.data), o.recordings, o.together, not o.no_neural)
        results = each(judge, [one for _, one in work], o.jobs, parts=len(work))
        titles = iter([title for title, _ in work])
        for result in track(results, "holding out", total=len(work),
                            console=Console(stderr=True)):
            found[next(titles)].extend(result)
            if o.json:
                document = {"date": date.today().isoformat(), "channels": list(CHANNELS),
                            "minutes": (time.monotonic() - began) / 60.0, "jobs": o.jobs,
                            "folds": folds, "days": days, "never_used": never_used}
                o.json.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    except DartHalError as err:
        print(err, file=sys.stderr)
        return 2
    console = Console(width=None if sys.stdout.isatty() else 160)
    for title, results_of_split in found.items():
        for table in tables(results_of_split, title) if results_of_split else ():
            console.print(table)
    print(f"{(time.monotonic() - began) / 60.0:.1f} minutes, {o.jobs} process(es)")
    if reference is None:
        return 0
    ratio = compare(folds, reference["folds"])
    refit = compare(folds, reference["folds"], REFIT)
    print(f"errors over those of {reference['date']}: best predictor {ratio:.4f} (limit "
          f"{MAX_WORSE}), refit {refit:.4f}")
    return int(not ratio <= MAX_WORSE)


if __name__ == "__main__":
    sys.exit(main())
