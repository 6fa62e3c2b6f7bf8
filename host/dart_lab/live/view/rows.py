"""States as the rows that a page draws: plain numbers, short in JSON."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import numpy as np

from dart_hal.core.types import Scan, State

FIELDS = ("t", "x", "y", "yaw", "speed", "yaw_rate", "accel_x", "accel_y", "steering", "throttle",
          "asked_steering", "asked_throttle", "sxx", "sxy", "syy")
"""s, m, m, rad, m/s, rad/s, m/s2, m/s2, rad, -, rad, -, m2, m2, m2."""
DIGITS = (3, 3, 3, 4, 3, 4, 3, 3, 4, 4, 4, 4, 7, 7, 7)
LONGEST_BEAM = 40.0
"""m; beyond it nothing of a room is drawn."""
Row = list[float | None]


def row(state: State, asked: Sequence[float] | None) -> Row:
    """Of one State; asked: steering [rad] and throttle of the last command, None: there was none.

    None stands for what is not known, and for what is no finite number."""
    estimate = state.estimate
    pose, cov = estimate.pose, estimate.pose.cov
    values = (state.t, pose.x, pose.y, pose.yaw, state.speed, state.yaw_rate, state.accel_x,
              state.accel_y, state.applied.steering, state.applied.throttle,
              *(asked or (None, None)), cov[0, 0], cov[0, 1], cov[1, 1])
    return [None if v is None or not isfinite(v) else round(float(v), n)
            for v, n in zip(values, DIGITS, strict=True)]


def points(scan: Scan, state: State) -> list[float]:
    """x0, y0, x1, y1, ... [m] of what a scan hit, in the frame of the car's pose.

    The car's motion within the revolution is left out: for the eye, at 2 m/s up to 0.2 m off."""
    pose = state.estimate.pose
    seen = scan.in_car()
    seen = seen[np.hypot(*seen.T) < LONGEST_BEAM]  # NaN, where nothing came back, is not
    c, s = np.cos(pose.yaw), np.sin(pose.yaw)
    room = seen @ np.array([[c, s], [-s, c]]) + (pose.x, pose.y)
    flat: list[float] = np.round(room.ravel(), 2).tolist()
    return flat
