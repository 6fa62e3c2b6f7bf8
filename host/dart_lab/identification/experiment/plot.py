"""Picture of a drive: its path on the floor, and the commands.

Needs matplotlib (the extra ``plot``).
"""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.core.figures import BLUE, GREY, INK, ORANGE, finish, new_figure, save_figure

from .runner import ExperimentDrive

PATH_COLOR = BLUE
TRANSFER_COLOR = "#bbbbbb"
FENCE_COLOR = ORANGE
FLOOR_COLOR = GREY
STEERING_COLOR = BLUE
THROTTLE_COLOR = ORANGE
SPEED_COLOR = INK


def plot_drive(drive: ExperimentDrive, path: str | Path) -> Path:
    """Write the figure to ``path``; the suffix (.png, .svg, .pdf) picks the format.

    Raises UsageError if matplotlib is missing or the suffix is unknown.
    """
    figure = new_figure((10.0, 5.0), path)
    grid = figure.add_gridspec(3, 2, width_ratios=[1.0, 1.25])
    _draw_path(figure.add_subplot(grid[:, 0]), drive)
    rows = [figure.add_subplot(grid[0, 1])]
    rows += [figure.add_subplot(grid[i, 1], sharex=rows[0]) for i in (1, 2)]
    _draw_commands(rows, drive)
    figure.legend(fontsize=8, loc="outside lower center", ncols=5)
    return save_figure(figure, path)


def _draw_path(axes: Any, drive: ExperimentDrive) -> None:
    plan = drive.plan
    fence = drive.plan.fence
    left = -plan.place.behind
    low = -plan.place.right
    floor = plan.floor
    _box(axes, left, left + floor.length, low, low + floor.width, FLOOR_COLOR, "-", "floor")
    _box(axes, fence.x_low, fence.x_high, fence.y_low, fence.y_high, FENCE_COLOR, ":",
         "rear axle stays inside")
    labelled: set[bool] = set()
    for measured, part in groupby(drive.frames, key=lambda f: f.measured):
        frames = list(part)
        axes.plot([f.pose.x for f in frames], [f.pose.y for f in frames],
                  color=PATH_COLOR if measured else TRANSFER_COLOR, lw=1.3, zorder=3 if measured
                  else 2, label=None if measured in labelled else "test" if measured
                  else "transfer")
        labelled.add(measured)
    axes.plot(0.0, 0.0, ">", color=SPEED_COLOR, ms=8, zorder=5, label="start")
    axes.set_aspect("equal", adjustable="datalim")
    finish(axes, "x [m]", "y [m]", f"{plan.name}: {drive.frames[-1].t:.0f} s on {floor}"
           + (", ended early" if drive.stopped else ""), legend=False)


def _box(axes: Any, x0: float, x1: float, y0: float, y1: float, color: str, style: str,
         label: str) -> None:
    axes.plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], color=color, ls=style, lw=1.2,
              label=label)


def _draw_commands(rows: list[Any], drive: ExperimentDrive) -> None:
    frames = drive.frames
    t = np.array([f.t for f in frames])
    measured = np.array([f.measured for f in frames])
    for axes, values, color, label in (
            (rows[0], [f.steering for f in frames], STEERING_COLOR, "steering command"),
            (rows[1], [f.throttle for f in frames], THROTTLE_COLOR, "throttle"),
            (rows[2], [f.speed for f in frames], SPEED_COLOR, "speed [m/s]")):
        axes.plot(t, values, color=color, lw=1.0)
        low, high = axes.get_ylim()
        axes.fill_between(t, low, high, where=measured, color=PATH_COLOR, alpha=0.08, lw=0)
        axes.set_ylim(low, high)
        finish(axes, "", label, legend=False)
    for axes in rows[:2]:
        axes.tick_params(labelbottom=False)
    rows[2].set_xlabel("time [s]")
