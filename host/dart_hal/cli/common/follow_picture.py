"""Pictures of ``dart-hal follow`` and ``lane``: driven line, offset and speed over distance."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.control.follow import Follower
from dart_hal.control.lane_follow import LaneFollower
from dart_hal.control.mpc.tracker import Contouring
from dart_hal.core.figures import BLUE, GREEN, GREY, INK, ORANGE, finish, new_figure, save_figure
from dart_hal.core.types import FloatArray


def draw_follow(follower: Follower, name: str, file: Path) -> Path:
    """Draw a drive along a path and write the picture.

    Raises UsageError without matplotlib or for another suffix.
    """
    figure = new_figure((11.0, 4.6), file)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.25))
    _draw_path(figure.add_subplot(grid[:, 0]), follower, name)
    above = figure.add_subplot(grid[0, 1])
    _draw_over_distance(above, figure.add_subplot(grid[1, 1], sharex=above), follower.driven.table,
                        follower.begun_at)
    return save_figure(figure, file)


def draw_lane(follower: LaneFollower, file: Path) -> Path:
    """Draw a drive in a lane; boards and middle are those that each scan measured."""
    figure = new_figure((11.0, 4.6), file)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.25, 1.0))
    axes = figure.add_subplot(grid[:, 0])
    driven = follower.driven.table
    if follower.lane_history:
        x, y, yaw, half = np.array(follower.lane_history).T
        for side, name in ((1.0, "boards"), (-1.0, None)):
            axes.plot(x - side * half * np.sin(yaw), y + side * half * np.cos(yaw), color=INK,
                      lw=1.4, label=name)
        axes.plot(x, y, color=ORANGE, lw=1.4, label="middle of the lane")
    if len(driven):
        axes.plot(driven[:, 1], driven[:, 2], color=BLUE, lw=1.0, label="driven")
    axes.set_aspect("equal", adjustable="datalim")
    finish(axes, "x [m]", "y [m]", follower.why)
    above = figure.add_subplot(grid[0, 1])
    _draw_over_distance(above, figure.add_subplot(grid[1, 1], sharex=above), driven, 0.0)
    above.set_ylabel("left of the middle [cm]")
    return save_figure(figure, file)


def _draw_path(axes: Any, follower: Follower, name: str) -> None:
    path = follower.path
    driven = follower.driven.table
    sin, cos = np.sin(path.heading), np.cos(path.heading)
    # Both edges of the lane: the path, shifted along its normal (-sin, cos).
    for offset in (-follower.rules.lane, follower.rules.lane):
        _plot_closed(axes, path.x - offset * sin, path.y + offset * cos, path.closed, color=GREY,
                     lw=0.6)
    _plot_closed(axes, path.x, path.y, path.closed, color=ORANGE, lw=1.4, label="path")
    if len(driven):
        axes.plot(driven[:, 1], driven[:, 2], color=BLUE, lw=1.0, label="driven")
        axes.plot(driven[0, 1], driven[0, 2], "o", color=INK, ms=5, label="start")
    if isinstance(follower.tracker, Contouring):
        _draw_plans(axes, follower.tracker)
    axes.set_aspect("equal", adjustable="datalim")
    finish(axes, "x [m]", "y [m]", f"{Path(name).name}: {follower.why}", loc="center")


def _draw_plans(axes: Any, tracker: Contouring[Any]) -> None:
    """Draw each tenth plan with two standard deviations, and the obstacles.

    A moving obstacle is drawn hollow, at its start.
    """
    for k, (x, y, std) in enumerate(tracker.predictions):
        # Outline of the band: two standard deviations to the left, then back on the right.
        yaw = np.arctan2(np.gradient(y), np.gradient(x))
        band_x = -2.0 * std * np.sin(yaw)
        band_y = 2.0 * std * np.cos(yaw)
        axes.fill(np.append(x + band_x, (x - band_x)[::-1]),
                  np.append(y + band_y, (y - band_y)[::-1]),
                  color=GREEN, alpha=0.15, lw=0.0, label=None if k else "plans, two std")
        axes.plot(x, y, color=GREEN, lw=0.6)
    for disc in tracker.discs:
        angle = np.linspace(0.0, 2.0 * np.pi, 40)
        axes.fill(disc.x + disc.radius * np.cos(angle), disc.y + disc.radius * np.sin(angle),
                  color=INK, alpha=0.6, fill=disc.speed == 0.0)


def _plot_closed(axes: Any, x: Any, y: Any, closed: bool, **style: Any) -> None:
    axes.plot(np.append(x, x[:1]) if closed else x, np.append(y, y[:1]) if closed else y, **style)


def _draw_over_distance(above: Any, below: Any, driven: FloatArray, begun_at: float) -> None:
    if len(driven):
        distance = driven[:, 6] - begun_at
        above.plot(distance, 100.0 * driven[:, 3], color=BLUE, lw=1.0)
        below.plot(distance, driven[:, 5], color=ORANGE, lw=1.4, label="setpoint")
        below.plot(distance, driven[:, 4], color=BLUE, lw=1.0, label="driven")
    finish(above, "", "left of the path [cm]", legend=False)
    finish(below, "distance [m]", "speed [m/s]")
