"""The pictures of ``dart-hal follow`` and ``lane``: driven line, offset and speed over the way."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.control.follow import Follower
from dart_hal.control.lane_follow import LaneFollower
from dart_hal.control.mpc.tracker import Contouring
from dart_hal.core.figures import BLUE, GREEN, GREY, INK, ORANGE, finish, new_figure, save_figure
from dart_hal.core.types import FloatArray


def draw(follower: Follower, name: str, file: Path) -> Path:
    """Write the picture. Raises UsageError without matplotlib or for another suffix."""
    figure = new_figure((11.0, 4.6), file)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.25))
    _draw_floor(figure.add_subplot(grid[:, 0]), follower, name)
    above = figure.add_subplot(grid[0, 1])
    _draw_way(above, figure.add_subplot(grid[1, 1], sharex=above), follower.driven.table,
              follower.begun_at)
    return save_figure(figure, file)


def draw_lane(follower: LaneFollower, file: Path) -> Path:
    """As ``draw``; boards and middle as each scan placed them beside the car."""
    figure = new_figure((11.0, 4.6), file)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.25, 1.0))
    axes, driven = figure.add_subplot(grid[:, 0]), follower.driven.table
    if follower.seen:
        x, y, yaw, half = np.array(follower.seen).T
        for side, name in ((1.0, "boards"), (-1.0, None)):
            axes.plot(x - side * half * np.sin(yaw), y + side * half * np.cos(yaw), color=INK,
                      lw=1.4, label=name)
        axes.plot(x, y, color=ORANGE, lw=1.4, label="middle of the lane")
    if len(driven):
        axes.plot(driven[:, 1], driven[:, 2], color=BLUE, lw=1.0, label="driven")
    axes.set_aspect("equal", adjustable="datalim")
    finish(axes, "x [m]", "y [m]", follower.why)
    above = figure.add_subplot(grid[0, 1])
    _draw_way(above, figure.add_subplot(grid[1, 1], sharex=above), driven, 0.0)
    above.set_ylabel("left of the middle [cm]")
    return save_figure(figure, file)


def _draw_floor(axes: Any, follower: Follower, name: str) -> None:
    path, driven = follower.path, follower.driven.table
    lane, (s, c) = follower.rules.lane, (np.sin(path.heading), np.cos(path.heading))
    for side in (-lane, lane):
        _closed(axes, path.x - side * s, path.y + side * c, path.closed, color=GREY, lw=0.6)
    _closed(axes, path.x, path.y, path.closed, color=ORANGE, lw=1.4, label="path")
    if len(driven):
        axes.plot(driven[:, 1], driven[:, 2], color=BLUE, lw=1.0, label="driven")
        axes.plot(driven[0, 1], driven[0, 2], "o", color=INK, ms=5, label="start")
    if isinstance(follower.tracker, Contouring):
        _draw_plans(axes, follower.tracker)
    axes.set_aspect("equal", adjustable="datalim")
    finish(axes, "x [m]", "y [m]", f"{Path(name).name}: {follower.why}", loc="center")


def _draw_plans(axes: Any, tracker: Contouring[Any]) -> None:
    """Each tenth plan within two standard deviations, and what was to be passed; hollow, where what
    moves began."""
    for k, (x, y, std) in enumerate(tracker.shown):
        yaw = np.arctan2(np.gradient(y), np.gradient(x))
        out_x, out_y = -2.0 * std * np.sin(yaw), 2.0 * std * np.cos(yaw)
        axes.fill(np.append(x + out_x, (x - out_x)[::-1]), np.append(y + out_y, (y - out_y)[::-1]),
                  color=GREEN, alpha=0.15, lw=0.0, label=None if k else "plans, two std")
        axes.plot(x, y, color=GREEN, lw=0.6)
    for disc in tracker.discs:
        round_ = np.linspace(0.0, 2.0 * np.pi, 40)
        axes.fill(disc.x + disc.radius * np.cos(round_), disc.y + disc.radius * np.sin(round_),
                  color=INK, alpha=0.6, fill=disc.speed == 0.0)


def _closed(axes: Any, x: Any, y: Any, closed: bool, **style: Any) -> None:
    axes.plot(np.append(x, x[:1]) if closed else x, np.append(y, y[:1]) if closed else y, **style)


def _draw_way(above: Any, below: Any, driven: FloatArray, begun_at: float) -> None:
    if len(driven):
        way = driven[:, 6] - begun_at
        above.plot(way, 100.0 * driven[:, 3], color=BLUE, lw=1.0)
        below.plot(way, driven[:, 5], color=ORANGE, lw=1.4, label="asked for")
        below.plot(way, driven[:, 4], color=BLUE, lw=1.0, label="driven")
    finish(above, "", "left of the path [cm]", legend=False)
    finish(below, "way [m]", "speed [m/s]")
