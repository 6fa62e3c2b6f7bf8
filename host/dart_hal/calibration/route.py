"""Where slow arcs lead, and how long to circle first so that they stay near the start.

The car waits on a full-lock circle until its heading is such that the sweep to
come ends least far from the middle of the floor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import FloatArray

DT = 0.1  # s between points of a predicted path
CANDIDATES = 36  # headings that are tried on one circle


class Leg(NamedTuple):
    """An arc: speed [m/s], yaw rate [rad/s], seconds."""

    speed: float
    yaw_rate: float
    seconds: float


class Spot(NamedTuple):
    """Place [m] and heading [rad] on the floor."""

    x: float
    y: float
    yaw: float


def trace(start: Spot, legs: Sequence[Leg]) -> tuple[FloatArray, Spot]:
    """(points (n, 2) m, last spot) of arcs driven one after the other."""
    turns = np.concatenate([np.full(max(round(g.seconds / DT), 0), g.yaw_rate) for g in legs])
    speeds = np.concatenate([np.full(len_, g.speed) for g, len_ in
                             ((g, max(round(g.seconds / DT), 0)) for g in legs)])
    yaw = start.yaw + np.concatenate([[0.0], np.cumsum(turns * DT)])
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    x = start.x + np.concatenate([[0.0], np.cumsum(speeds * np.cos(middle) * DT)])
    y = start.y + np.concatenate([[0.0], np.cumsum(speeds * np.sin(middle) * DT)])
    return np.column_stack([x, y]), Spot(float(x[-1]), float(y[-1]), float(yaw[-1]))


def waiting_time(at: Spot, speed: float, yaw_rate: float, futures: Sequence[Sequence[Leg]],
                 centre: tuple[float, float]) -> float:
    """Seconds to stay on the circle (speed, yaw_rate) before what follows; at most one turn.

    ``futures``: the sweep to come on each car that this one may be. The heading
    with the smallest largest distance from ``centre`` [m] over them all wins.
    """
    if abs(yaw_rate) < 0.1:
        return 0.0
    times = np.arange(CANDIDATES) * (2.0 * math.pi / abs(yaw_rate) / CANDIDATES)
    yaw = at.yaw + yaw_rate * times
    radius = speed / yaw_rate
    x = at.x + radius * (np.sin(yaw) - math.sin(at.yaw)) - centre[0]
    y = at.y - radius * (np.cos(yaw) - math.cos(at.yaw)) - centre[1]
    c, s = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    worst = np.zeros(CANDIDATES)
    for legs in futures:
        local, _ = trace(Spot(0.0, 0.0, 0.0), legs)
        px = x[:, None] + c * local[:, 0] - s * local[:, 1]
        py = y[:, None] + s * local[:, 0] + c * local[:, 1]
        worst = np.maximum(worst, np.hypot(px, py).max(axis=1))
    return float(times[int(np.argmin(worst))])
