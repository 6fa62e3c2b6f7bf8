"""Convert States and scans into plain numbers that a page draws, short in JSON."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import numpy as np

from dart_hal.core.types import Scan, State

# Units: s, m, m, rad, m/s, rad/s, m/s2, m/s2, rad, -, rad, -, m2, m2, m2.
FIELDS = ("t", "x", "y", "yaw", "speed", "yaw_rate", "accel_x", "accel_y", "steering", "throttle",
          "asked_steering", "asked_throttle", "sxx", "sxy", "syy")
DIGITS = (3, 3, 3, 4, 3, 4, 3, 3, 4, 4, 4, 4, 7, 7, 7)
# m; points farther away are not drawn.
MAX_BEAM_RANGE = 40.0
Row = list[float | None]


def state_row(state: State, command: Sequence[float] | None) -> Row:
    """Return the row of a State, with None for unknown and non-finite values.

    command: steering [rad] and throttle of the last command, None without one.
    """
    estimate = state.estimate
    pose = estimate.pose
    cov = pose.cov
    values = (state.t, pose.x, pose.y, pose.yaw, state.speed, state.yaw_rate, state.accel_x,
              state.accel_y, state.applied.steering, state.applied.throttle,
              *(command or (None, None)), cov[0, 0], cov[0, 1], cov[1, 1])
    return [None if v is None or not isfinite(v) else round(float(v), n)
            for v, n in zip(values, DIGITS, strict=True)]


def scan_points(scan: Scan, state: State) -> list[float]:
    """Return x0, y0, x1, y1, ... [m] of the points of a scan, in the frame of the car's pose.

    The motion of the car during the revolution is ignored: an error of up to 0.2 m at 2 m/s.
    """
    pose = state.estimate.pose
    in_car = scan.in_car()
    # The comparison is false for NaN, which marks beams without a return.
    in_car = in_car[np.hypot(*in_car.T) < MAX_BEAM_RANGE]
    # Rotate by the yaw of the car and shift to its position.
    cos = np.cos(pose.yaw)
    sin = np.sin(pose.yaw)
    in_frame = in_car @ np.array([[cos, sin], [-sin, cos]]) + (pose.x, pose.y)
    flat: list[float] = np.round(in_frame.ravel(), 2).tolist()
    return flat
