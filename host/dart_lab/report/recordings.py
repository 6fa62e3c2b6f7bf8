"""Pictures of recordings: path, speeds, throttle, steering, yaw rate; bad samples in orange.

``plot_check`` draws one recording, ``plot_overview`` a small panel of each.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.core.figures import (
    BLUE,
    GREEN,
    GREY,
    INK,
    LEGEND_ABOVE,
    ORANGE,
    finish,
    new_figure,
    save_figure,
)
from dart_hal.core.types import FloatArray
from dart_hal.recording.check import RecordingCheck, folder_of, stem_of

WHEEL_COLOUR = BLUE
MOCAP_COLOUR = INK
BAD_COLOUR = ORANGE
# Throttle behind the gate of the radio's switch, and as it is in the log.
GATED_COLOUR = "#56b4e9"
RAW_COLOUR = GREY
STEERING_COLOUR = GREEN
# Panels in a row of an overview, and panels in all.
OVERVIEW_COLUMNS = 6
MAX_RECORDINGS = 120


def plot_check(c: RecordingCheck, path: str | Path) -> Path:
    """Draw one recording. Errors: UsageError without matplotlib or for an unknown suffix."""
    figure = new_figure((11.0, 7.6), path)
    mocap = c.motion.grid is not None
    grid = figure.add_gridspec(4, 2 if mocap else 1, width_ratios=[1.0, 1.5] if mocap else None)
    if mocap:
        _path(figure.add_subplot(grid[:, 0]), c)
    right = -1
    first = figure.add_subplot(grid[0, right])
    rows = [first, *(figure.add_subplot(grid[i, right], sharex=first) for i in (1, 2, 3))]
    for axes, draw in zip(rows, (_speed, _throttle, _steering, _yaw_rate), strict=True):
        draw(axes, c)
        _shade_bad(axes, c)
        axes.grid(alpha=0.3)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
        if axes is not rows[-1]:
            axes.tick_params(labelbottom=False)
    rows[-1].set_xlabel("time [s]")
    figure.suptitle(f"{c.name}  (schema {c.recording.schema})\n{_short(c.verdict, 110)}",
                    fontsize=10, x=0.01, ha="left")
    return save_figure(figure, path)


def plot_overview(checks: Sequence[RecordingCheck], path: str | Path) -> Path:
    """Draw speed and throttle of each recording in a small panel. Errors: as ``plot_check``."""
    plotted = checks[:MAX_RECORDINGS]
    rows = -(-len(plotted) // OVERVIEW_COLUMNS)
    figure = new_figure((2.5 * OVERVIEW_COLUMNS, 1.65 * rows + 0.6), path)
    panels = np.atleast_2d(figure.subplots(rows, OVERVIEW_COLUMNS, squeeze=False))
    for axes in panels.flat[len(plotted):]:
        axes.set_visible(False)
    for axes, c in zip(panels.flat, plotted, strict=False):
        _draw_panel(axes, c)
    for axes in panels[:, 0]:
        axes.set_ylabel("m/s", fontsize=7)
    omitted = f" (the first {MAX_RECORDINGS})" if len(checks) > MAX_RECORDINGS else ""
    figure.suptitle(f"{len(checks)} recording(s){omitted}: speed over time [s]; blue wheels, black "
                    "mocap, shaded throttle (0 to 1 of the height), orange bad", fontsize=9)
    return save_figure(figure, path)


def _draw_panel(axes: Any, c: RecordingCheck) -> None:
    a = c.recording.messages
    t = _time(c)
    top = 1.05 * max([0.5, *(r[1] for r in (c.facts.speed, _ground(c)) if r)])
    axes.fill_between(t, 0.0, top * a.throttle, step="post", color=GATED_COLOUR, alpha=0.35, lw=0)
    axes.plot(t, a.speed, color=WHEEL_COLOUR, lw=0.8)
    g = c.motion.grid
    if g is not None:
        axes.plot(g.t, np.where(g.bad, np.nan, g.v_x), color=MOCAP_COLOUR, lw=0.7)
    _shade_bad(axes, c)
    axes.set_ylim(0.0, top)
    axes.tick_params(labelsize=6)
    path = c.recording.path
    axes.set_title(f"{c.recording.schema} {_short(folder_of(path), 34)}\n"
                   f"{_short(stem_of(path), 36)}", fontsize=5.5, loc="left")


def _path(axes: Any, c: RecordingCheck) -> None:
    g = c.motion.grid
    assert g is not None
    axes.plot(np.where(g.bad, np.nan, g.x), np.where(g.bad, np.nan, g.y), color=MOCAP_COLOUR,
              lw=0.9, label="centre of mass")
    if g.bad.any():
        axes.plot(g.x[g.bad], g.y[g.bad], ".", color=BAD_COLOUR, ms=2.5, label="bad samples")
    axes.plot(g.x[:1], g.y[:1], "o", color=STEERING_COLOUR, ms=6, label="start")
    axes.set_aspect("equal")
    finish(axes, "x [m]", "y [m]", fontsize=7, ncols=3, **LEGEND_ABOVE)


def _speed(axes: Any, c: RecordingCheck) -> None:
    if np.isfinite(c.recording.messages.speed).any():
        axes.plot(_time(c), c.recording.messages.speed, color=WHEEL_COLOUR, lw=1.2, label="encoder")
    elif c.recording.encoder == "dead":
        axes.set_title("encoder dead", fontsize=8, loc="right", color=BAD_COLOUR)
    g = c.motion.grid
    if g is not None:
        axes.plot(g.t, np.where(g.bad, np.nan, g.v_x), color=MOCAP_COLOUR, lw=0.9,
                  label="mocap v_x")
    axes.set_ylabel("speed [m/s]")


def _throttle(axes: Any, c: RecordingCheck) -> None:
    a = c.recording.messages
    t = _time(c)
    axes.fill_between(t, 0.0, a.throttle, step="post", color=GATED_COLOUR, alpha=0.6, lw=0,
                      label="behind the gate")
    axes.step(t, a.throttle_raw, where="post", color=RAW_COLOUR, lw=0.8, label="as logged")
    axes.set_ylabel("throttle")


def _steering(axes: Any, c: RecordingCheck) -> None:
    axes.step(_time(c), c.recording.messages.steering, where="post", color=STEERING_COLOUR, lw=1.0)
    axes.set_ylim(-1.1, 1.1)
    axes.set_ylabel("steering")


def _yaw_rate(axes: Any, c: RecordingCheck) -> None:
    if np.isfinite(c.recording.messages.yaw_rate).any():
        axes.plot(_time(c), c.recording.messages.yaw_rate, color=WHEEL_COLOUR, lw=1.0, label="gyro")
    g = c.motion.grid
    if g is not None:
        axes.plot(g.t, np.where(g.bad, np.nan, g.omega), color=MOCAP_COLOUR, lw=0.8, label="mocap")
    axes.set_ylabel("yaw rate [rad/s]")


def _shade_bad(axes: Any, c: RecordingCheck) -> None:
    g = c.motion.grid
    if g is None or not g.bad.any():
        return
    # Starts and ends of the runs of bad samples: where the flag, padded by zeros, changes.
    edge = np.flatnonzero(np.diff(np.concatenate([[0], g.bad.astype(int), [0]])))
    for start, end in zip(edge[::2], edge[1::2], strict=True):
        axes.axvspan(g.t[start], g.t[min(end, len(g) - 1)], color=BAD_COLOUR, alpha=0.18, lw=0,
                     zorder=0)


def _time(c: RecordingCheck) -> FloatArray:
    """Return the times of the messages [s]: on the clock of the mocap, else since the first."""
    arrival = c.recording.messages.arrival
    return arrival if c.motion.grid is not None else arrival - arrival[0]


def _ground(c: RecordingCheck) -> tuple[float, float] | None:
    return c.facts.mocap.v_x if c.facts.mocap else None


def _short(text: str, most: int) -> str:
    return text if len(text) <= most else text[:most // 2 - 2] + "..." + text[-most // 2 + 1:]
