"""One figure of a suggestion: what is driven, what either hypothesis would show, what it is worth.

Needs matplotlib (``pip install dart-hal[plot]``).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.report.figures import new_figure, save_figure
from dart_hal.types import FloatArray

from .result import ENOUGH, Prediction, Suggestion

TRUTH, RIVAL, SHADE, GREY = "#0072b2", "#d55e00", "#999999", "#555555"
STEERING, THROTTLE = "#0072b2", "#d55e00"
AROUND = 3.0
"""s to each side of the largest difference that are drawn."""
WORDS = {"v_x": "speed", "v_y": "lateral velocity", "omega": "yaw rate", "encoder": "encoder",
         "gyro": "gyro", "accel_x": "accelerometer x", "accel_y": "accelerometer y"}


def draw(suggestion: Suggestion) -> Any:
    """The figure; it has curves only where there is a prediction. Errors: UsageError."""
    figure = new_figure((9.0, 6.0))
    prediction = suggestion.prediction
    if prediction is None:
        _bars(figure.subplots(), suggestion)
        return figure
    grid = figure.add_gridspec(3, 2, height_ratios=[0.8, 1.3, 0.9], width_ratios=[1.6, 1.0])
    commands, curves = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0])
    _commands(commands, prediction)
    middle = _largest(prediction)
    commands.axvspan(middle - AROUND, middle + AROUND, color=SHADE, alpha=0.2, lw=0)
    _curves(curves, prediction, middle)
    _difference(figure.add_subplot(grid[2, 0], sharex=curves), prediction, middle)
    _bars(figure.add_subplot(grid[:, 1]), suggestion)
    figure.suptitle(suggestion.sentence(), fontsize=10, wrap=True)
    return figure


def plot(suggestion: Suggestion, path: str | Path) -> Path:
    """Write the figure; the suffix (.png, .svg, .pdf) picks the format. Errors: UsageError."""
    new_figure((1.0, 1.0), path)  # refuses the suffix before anything is drawn
    return save_figure(draw(suggestion), path)


def _commands(axes: Any, p: Prediction) -> None:
    axes.plot(p.t, p.steering, color=STEERING, lw=1.2, label="steering")
    axes.plot(p.t, p.throttle, color=THROTTLE, lw=1.2, label="throttle")
    axes.set_ylabel("command")
    axes.set_ylim(-1.1, 1.1)
    axes.set_title("what is driven", loc="left", fontsize=10)
    axes.legend(fontsize=8, loc="lower right", ncols=2)
    axes.grid(alpha=0.3)


def _curves(axes: Any, p: Prediction, middle: float) -> None:
    near = np.abs(p.at - middle) <= AROUND
    for (name, values), color, dashes in zip(p.says.items(), (TRUTH, RIVAL), ("-", "--"),
                                             strict=True):
        axes.plot(p.at[near], values[near], dashes, color=color, lw=1.8, label=name)
    axes.set_ylabel(f"{WORDS[p.channel]}, {p.unit}")
    axes.set_title("what each would show, where they differ most", loc="left", fontsize=10)
    axes.legend(fontsize=8, loc="best")
    axes.grid(alpha=0.3)
    axes.tick_params(labelbottom=False)


def _difference(axes: Any, p: Prediction, middle: float) -> None:
    near = np.abs(p.at - middle) <= AROUND
    axes.axhspan(-p.noise, p.noise, color=SHADE, alpha=0.3, lw=0, label="noise of one reading")
    axes.plot(p.at[near], _apart(p)[near], color=GREY, lw=1.5, label="difference")
    axes.set_xlabel("time, s")
    axes.set_ylabel(p.unit)
    axes.legend(fontsize=8, loc="best", ncols=2)
    axes.grid(alpha=0.3)


def _bars(axes: Any, suggestion: Suggestion) -> None:
    """Standard deviations of every pair, with the data at hand and with the drive."""
    names = [f"{p.effect}\n{p.rival}" for p in suggestion.pairs]
    rows = np.arange(len(names))
    axes.barh(rows - 0.2, [p.before for p in suggestion.pairs], 0.36, color=SHADE,
              label="data at hand")
    axes.barh(rows + 0.2, [p.after for p in suggestion.pairs], 0.36, color=TRUTH,
              label=suggestion.drive or "drive")
    axes.axvline(ENOUGH, color=GREY, lw=1.0, ls=":", label="enough")
    axes.set_yticks(rows, names, fontsize=8)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xlabel("standard deviations between the two")
    axes.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3,
                frameon=False)
    axes.grid(alpha=0.3, axis="x")


def _apart(p: Prediction) -> FloatArray:
    one, other = p.says.values()
    return np.asarray(one - other)


def _largest(p: Prediction) -> float:
    """When the two differ most [s], with room to both sides."""
    at = float(p.at[int(np.argmax(np.abs(_apart(p))))])
    return float(np.clip(at, p.at[0] + AROUND, max(p.at[-1] - AROUND, p.at[0] + AROUND)))
