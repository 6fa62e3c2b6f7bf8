"""The joint fit on test days: each day left out once, the rest fitted.

    python benchmarks/bench_joint.py
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial

import numpy as np
from bench_evaluate import folder
from figures import Figure

from dart_hal.car.runs import read_any
from dart_hal.core.process.jobs import cores, each
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording
from dart_hal.vehicle.sets import PAPER
from dart_lab.identification.evaluation import errors, measured, predict, predict_ctrv, prepare
from dart_lab.identification.shooting import fit_from_recordings

SECOND = 1
"""Index of the horizon of 1 s."""
SHOWN = ("v_x", "yaw rate", "position", "yaw")
UNITS = ("m/s", "rad/s", "m", "deg")


def days(recordings: Sequence[Recording]) -> dict[str, list[Recording]]:
    """Recordings with motion capture by day; without a date each is a day of its own."""
    out: dict[str, list[Recording]] = {}
    for r in recordings:
        if r.mocap is not None:
            out.setdefault(f"{r.when:%Y-%m-%d}" if r.when else r.path.name, []).append(r)
    return out


def left_out() -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Errors (5, windows) at 1 s of holding, the paper and joint fits; CPU of one fit [s]."""
    by_day = days(read_any([folder()])[0])
    held, paper, joint, spent = zip(*each(partial(_without, by_day), list(by_day), cores(),
                                          parts=len(by_day)), strict=True)
    return (*(np.concatenate(part, axis=1) for part in (held, paper, joint)),
            float(np.median(spent)))


def _without(by_day: dict[str, list[Recording]],
             day: str) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """The same of one day, fitted on all others."""
    train = [r for other, rs in by_day.items() if other != day for r in rs]
    begin = time.process_time()
    fit, _, _ = fit_from_recordings(train, PAPER)
    spent = time.process_time() - begin
    cases = prepare(by_day[day]).cases
    held, paper, joint = (errors(states, measured(cases))[SECOND] for states in (
        predict_ctrv(cases), predict(PAPER, cases), predict(fit.vehicle, cases)))
    return held, paper, joint, spent


def figures(scale: float = 1.0) -> list[Figure]:
    """RMSE at 1 s on left-out days, against the paper's model and constant velocity."""
    if scale < 1.0:
        return []  # nine fits of all recordings are the whole of it
    held, paper, joint, cpu = left_out()
    rows = [0, 2, 3, 4]
    rms = [np.sqrt(np.mean(part[rows]**2, axis=1)) for part in (joint, paper, held)]
    note = "paper {:.3g}, CTRV {:.3g}; " + f"{held.shape[1]} windows"
    return [Figure(f"joint fit, left-out days, {name} at 1 s", own, unit,
                   note=note.format(other, ctrv))
            for name, unit, own, other, ctrv in zip(SHOWN, UNITS, *rms, strict=True)] + [
        Figure("joint fit of all recordings with motion capture, CPU", cpu, "s")]


if __name__ == "__main__":
    for figure in figures():
        print(f"{figure.name:58} {figure.measured:>12}  {figure.note}")
