"""Pictures of an evaluation: errors against constant velocity (CTRV), and some windows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.figures import BLUE, FIGURE_FORMATS, INK, finish, new_figure, save_figure
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.batch import rollout
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.prediction.actuators import actuator_outputs
from dart_lab.identification.prediction.rollout import states
from dart_lab.identification.prediction.windows import HORIZONS, WINDOW_LENGTH

from .cases import Case, short
from .picture_limit import draw_limit
from .prediction import CHANNELS, ERROR_UNITS, constant_velocity
from .run import Evaluation

TITLES = dict(zip(CHANNELS, ("speed v_x", "lateral velocity v_y", "yaw rate", "position", "yaw"),
                  strict=True))
MODEL_COLOR = BLUE
BASELINE = "#e69f00"
TRUTH_COLOR = INK
BARS = ("yaw_rate", "position")
# The windows at these quantiles of the position error at 2 s are drawn.
ERROR_QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.9, 0.98)


def check_target(target: str | Path) -> bool:
    """Return whether ``target`` is a file (else a folder), before any work is done for it.

    Raises UsageError if matplotlib is missing or the suffix is unknown.
    """
    target = Path(target)
    new_figure((1.0, 1.0))
    if not target.suffix or target.is_dir():
        return False
    if target.suffix.lower() not in FIGURE_FORMATS:
        raise UsageError(f"no plot format {target.suffix!r}", found=str(target),
                         expected=f"a folder, or a file ending in {', '.join(FIGURE_FORMATS)}")
    return True


def draw(e: Evaluation, target: str | Path) -> list[Path]:
    """Draw the errors into a file, or all pictures into a folder; return the files.

    Raises as ``check_target``.
    """
    target = Path(target)
    if check_target(target):
        return [save_figure(draw_errors(e), target)]
    return [save_figure(figure, target / f"{name}.png") for name, figure in figures(e).items()]


def figures(e: Evaluation) -> dict[str, Any]:
    """Draw all pictures, by name. Raises UsageError if matplotlib is missing."""
    drawn = {"errors": draw_errors(e), "windows": draw_windows(e)}
    return drawn if e.limit is None else {**drawn, "kinematic_limit": draw_limit(e.limit)}


def draw_errors(e: Evaluation) -> Any:
    """Draw the RMSE over the horizon by channel, and at 1 s by recording."""
    files = list(e.model.slices)
    figure = new_figure((9.8, 4.6 + 0.24 * len(files)))
    top, bottom = figure.subfigures(2, 1, height_ratios=[3.2, 1.4 + 0.24 * len(files)])
    panels = top.subplots(1, len(CHANNELS))
    for axes, channel, unit in zip(panels, CHANNELS, ERROR_UNITS, strict=True):
        _draw_over_horizon(axes, e, channel, unit)
    top.legend(*panels[0].get_legend_handles_labels(), fontsize=8, ncols=4,
               loc="outside lower center")
    for i, (axes, channel) in enumerate(zip(bottom.subplots(1, len(BARS), sharey=True), BARS,
                                            strict=True)):
        _draw_by_file(axes, e, channel, files, legend=not i)
    figure.suptitle(f"{e.vehicle.name} ({e.vehicle.kind}), open loop, "
                    f"{e.prepared.windows} windows of {len(files)} recording(s)",
                    x=0.01, ha="left", fontsize=11)
    return figure


def draw_windows(e: Evaluation) -> Any:
    """Draw six windows from good to bad: the path of 2 s, predicted and measured."""
    figure = new_figure((11.0, 7.4))
    rows = figure.subplots(2, 3)
    error = e.model.errors[-1, CHANNELS.index("position")]
    order = np.argsort(error)
    for axes, q in zip(rows.flat, ERROR_QUANTILES, strict=True):
        index = int(order[min(int(q * len(order)), len(order) - 1)])
        case, start = _find_window(e, index)
        _draw_path(axes, e.vehicle, case, start)
        axes.set_title(f"{short(case.file, 16)}, {start * SAMPLE:.1f} s\n"
                       f"{error[index]:.2f} m off after 2 s, better than {1.0 - q:.0%}",
                       loc="left", fontsize=8)
    handles, labels = rows.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=9)
    figure.suptitle(f"{e.vehicle.name} ({e.vehicle.kind}): 2 s from the dot, axes in m along and "
                    "left of the start", x=0.01, ha="left", fontsize=11)
    return figure


def _draw_over_horizon(axes: Any, e: Evaluation, channel: str, unit: str) -> None:
    for score, color, label in ((e.model, MODEL_COLOR, e.vehicle.name[:24]),
                                (e.ctrv, BASELINE, "constant velocity (CTRV)")):
        rmse = [score.rmse(h)[channel] for h in HORIZONS]
        median = [score.median(h)[channel] for h in HORIZONS]
        axes.plot(HORIZONS, rmse, "o-", color=color, lw=2, ms=4, label=f"{label}, RMSE")
        axes.plot(HORIZONS, median, "o--", color=color, lw=1, ms=3, mfc="none",
                  label=f"{label}, median")
    axes.set_xticks(HORIZONS)
    axes.set_ylim(bottom=0.0)
    finish(axes, "horizon [s]", "", f"{TITLES[channel]} [{unit}]", legend=False)


def _draw_by_file(axes: Any, e: Evaluation, channel: str, files: list[str], legend: bool) -> None:
    at = np.arange(len(files), dtype=np.float64)
    for score, color, label, shift in ((e.model, MODEL_COLOR, e.vehicle.name[:24], -0.2),
                                       (e.ctrv, BASELINE, "constant velocity (CTRV)", 0.2)):
        values = [score.rmse(1.0, file)[channel] for file in files]
        axes.barh(at + shift, values, 0.38, color=color, label=label)
    axes.set_yticks(at, [f"{short(f)} ({e.model.slices[f].stop - e.model.slices[f].start})"
                         for f in files], fontsize=9)
    axes.set_ylim(len(files) - 0.4, -0.6)
    axes.set_xlabel(f"{TITLES[channel]}, RMSE at 1 s [{ERROR_UNITS[CHANNELS.index(channel)]}]")
    axes.grid(axis="x", alpha=0.3)
    if legend:
        axes.legend(fontsize=8, loc="best")


def _find_window(e: Evaluation, index: int) -> tuple[Case, int]:
    """Find (recording, first sample) of a window by its number over all recordings."""
    for case in e.prepared.cases:
        where = e.model.slices[case.file]
        if index < where.stop:
            return case, int(case.windows.start[index - where.start])
    raise IndexError(index)


def _draw_path(axes: Any, p: Vehicle, case: Case, start: int) -> None:
    g = case.grid
    samples = np.arange(start, start + WINDOW_LENGTH + 1)
    truth = states(g, samples)
    throttle, angle = (series[samples[:-1], None] for series in actuator_outputs(p, g))
    predicted = rollout(p, truth[:, :1].copy(), throttle, angle)[:, :, 0].T
    predicted = np.concatenate([truth[:, :1], predicted], axis=1)
    held = constant_velocity(truth[:, :1], SAMPLE * np.arange(WINDOW_LENGTH + 1.0))
    for track, color, label, width in ((truth, TRUTH_COLOR, "measured", 2.4),
                                       (held, BASELINE, "constant velocity (CTRV)", 1.4),
                                       (predicted, MODEL_COLOR, p.name[:24], 1.8)):
        along, left = _from_start(track, truth[:, 0])
        axes.plot(along, left, color=color, lw=width, label=label)
        axes.plot(along[::50], left[::50], ".", color=color, ms=5)
    axes.plot(0.0, 0.0, "o", color=TRUTH_COLOR, ms=6)
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.3)


def _from_start(track: FloatArray, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    c, s = np.cos(start[2]), np.sin(start[2])
    dx, dy = track[0] - start[0], track[1] - start[1]
    return c * dx + s * dy, c * dy - s * dx
