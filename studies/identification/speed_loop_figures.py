"""The speed loop on an F1TENTH car: figures of docs/results/speed_loop.md.

    python -m studies.identification.speed_loop_figures [FOLDER]

FOLDER holds ds3.csv.gz, ds4.csv.gz and base.toml of the recordings of Pennsylvania, 2022; default
$OTHER_CARS_DATA/f1tenth_upenn2022. Their column ``throttle`` is a speed command in unknown units,
and ds3 was driven behind a speed limit. Both are estimated here, from steady driving.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dart_hal.core.config import ModelFile
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording, read, with_marker_frames
from dart_hal.recording.dart.model import freeze
from dart_hal.vehicle.load import find_model, vehicle_of
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evaluation import Evaluation, evaluate
from dart_lab.identification.outcome import Identification, identify_jointly
from dart_lab.identification.write import SECTIONS, build_model

STEADY_S = 0.4  # s in which the command is constant
STEADY_COMMAND = 0.15  # relative change of the command in that time, at most
STEADY_SPEED = 0.1  # relative change of the encoder in SETTLED messages, at most
SETTLED = 5
MIN_COMMAND = 0.05  # of the column; its noise is 0.005


def steady_driving(r: Recording) -> tuple[FloatArray, FloatArray]:
    """Return command (n,) of the column and encoder [m/s] (n,) where both are constant."""
    m = r.messages
    commands, speeds = [], []
    for i in range(SETTLED, len(m)):
        window = m.throttle[np.searchsorted(m.t, m.t[i] - STEADY_S):i + 1]
        last = m.speed[i - SETTLED + 1:i + 1]
        if (len(window) > SETTLED and window[-1] > MIN_COMMAND and last[-1] > 0.0
                and np.ptp(window) < STEADY_COMMAND * window[-1]
                and np.ptp(last) < STEADY_SPEED * last[-1]):
            commands.append(float(np.mean(window)))
            speeds.append(float(last[-1]))
    return np.array(commands), np.array(speeds)


def find_scale(r: Recording) -> float:
    """Estimate the speed [m/s] of the full command: median of encoder over command."""
    commands, speeds = steady_driving(r)
    return float(np.median(speeds / commands))


def find_limit(r: Recording) -> float:
    """Estimate the speed limit [m/s] of a recording that drives at it: median of the encoder."""
    return float(np.median(steady_driving(r)[1]))


def with_throttle(r: Recording, throttle: FloatArray, drive: str) -> Recording:
    """Return the recording with another throttle (m,) and its meaning."""
    held = freeze(throttle)
    return replace(r, drive=drive, messages=replace(r.messages, throttle=held, throttle_raw=held))


def with_speeds(r: Recording, scale: float, limit: float = np.inf) -> Recording:
    """Return the recording with the commanded speed: the column times scale, within the limit."""
    return with_throttle(r, np.clip(scale * r.messages.throttle, -limit, limit), "speed")


def read_pair(folder: Path) -> tuple[Recording, Recording]:
    """Read ds3 and ds4 with one fitted marker frame."""
    slow, fast = with_marker_frames([read(folder / f"{name}.csv.gz") for name in ("ds3", "ds4")])
    return slow, fast


def speed_pair(slow: Recording, fast: Recording) -> tuple[Recording, Recording]:
    """Return ds3 and ds4 with commanded speeds: scale of ds4, limit of ds3."""
    scale = find_scale(fast)
    return with_speeds(slow, scale, find_limit(slow)), with_speeds(fast, scale)


def fit(train: Recording, base: ModelFile) -> tuple[Vehicle, Identification]:
    """Return the model of a joint fit, and the fit."""
    found, _ = identify_jointly([train], [], SECTIONS, base, "speed_loop_figures")
    written = build_model(found.fits, found.over(base), found.source, joint=found.joint)
    assert written.model is not None, written.left_out
    return vehicle_of(written.model), found


def speed_error(e: Evaluation, horizon: str = "1.0") -> tuple[float, float]:
    """Return the rms error of v_x [m/s] at a horizon: of the model, of constant velocity."""
    model, constant = (float(s.to_json()[horizon]["pooled"]["vx"]) for s in (e.model, e.ctrv))
    return model, constant


def main(arguments: Sequence[str]) -> None:
    data = os.environ.get("OTHER_CARS_DATA", "")
    folder = Path(arguments[0]) if arguments else Path(data) / "f1tenth_upenn2022"
    columns = read_pair(folder)
    slow, fast = speed_pair(*columns)
    base, _ = find_model(folder / "base.toml")
    scale, limit = find_scale(columns[1]), find_limit(columns[0])
    counts = [len(steady_driving(r)[0]) for r in columns]
    print(f"scale {scale:.2f} m/s ({counts[1]} messages), limit {limit:.2f} m/s ({counts[0]})")
    limited = tuple(with_throttle(r, r.messages.throttle / scale, "duty") for r in (slow, fast))
    forms = {"duty, column as recorded": columns, "duty, within the limit": limited,
             "speed loop": (slow, fast)}
    for form, (first, second) in forms.items():
        for train, test in ((first, second), (second, first)):
            p, found = fit(train, base)
            errors = [speed_error(evaluate(p, [test], limit=False), h) for h in ("0.5", "1.0")]
            motor = ", ".join(f"{key} {e.value:.3g} +- {e.std:.2g}"
                              + ("" if e.identifiable else " (prior)")
                              for key, e in found.fits["motor"].parameters.items())
            print(f"{form}: {train.path.name} -> {test.path.name}: v_x "
                  + ", ".join(f"{m:.3f} (constant velocity {c:.3f})" for m, c in errors)
                  + f"; {motor}")


if __name__ == "__main__":
    main(sys.argv[1:])
