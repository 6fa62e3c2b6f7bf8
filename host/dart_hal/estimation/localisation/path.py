"""Odometry for the localiser: motion between two times, corrected by the errors it estimates.

The steps of the odometry are stored as received, in the axes of the car in the middle of each. A
stretch of them is recomputed for each scan, because scale, bias and slip are then known better.

    along     (1 + k) dx                          k travel scale
    sideways  (1 + k) dy - s v w dx               s slip gain: the rear slips outwards by s v w
    turn      (1 + g) dw - b dt                   g gyro scale, b gyro bias
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from math import cos, sin

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.estimation.spin import AVERAGED_STEPS, SpinDetector

# s of stored steps: a scan, and the longest gap without one that is bridged.
STEP_HISTORY = 6.0
# s for which the last step is continued beyond the newest State.
MAX_EXTRAPOLATION = 0.1


@dataclass(frozen=True, slots=True)
class Stretch:
    """Motion of the car over several steps.

    t (n + 1,) [s]: nodes; pose (n + 1, 3): x, y [m], yaw [rad] there, in the axes of the car at
    the first; jacobian (3, 4): of the last pose by k, b, g, s; spin_jacobian (3,) [s]: by the speed
    while the wheels were in doubt; distance [m], turn [rad]: driven, without sign;
    rate (3,): vx, vy [m/s], yaw rate [rad/s] at the end, in the same axes.
    """

    t: FloatArray
    pose: FloatArray
    jacobian: FloatArray
    spin_jacobian: FloatArray
    distance: float
    turn: float
    rate: FloatArray

    def interpolate(self, t: FloatArray) -> FloatArray:
        """Interpolate poses (m, 3) linearly at times (m,) within."""
        return np.column_stack([np.interp(t, self.t, column) for column in self.pose.T])


class OdometrySteps:
    """Odometry of the last seconds: ``add`` for each State."""

    def __init__(self) -> None:
        self._t: list[float] = []
        self._steps: list[tuple[float, float, float, float]] = []
        self._spin = SpinDetector()
        self._last: tuple[float, float, float] | None = None

    def add(self, t: float, x: float, y: float, yaw: float, accel: float | None = None) -> None:
        """Add the dead reckoning at t [s]; ignored if not later than the last.

        accel [m/s2]: acceleration along the nose, if known.
        """
        if self._t and t <= self._t[-1]:
            return
        step = (0.0, 0.0, 0.0, 0.0)
        if self._last is not None:
            x0, y0, yaw0 = self._last
            middle = 0.5 * (yaw + yaw0)
            c = cos(middle)
            s = sin(middle)
            step = (c * (x - x0) + s * (y - y0), c * (y - y0) - s * (x - x0), yaw - yaw0,
                    0.0)
            ground = self._spin.update(step[0], t - self._t[-1], accel, step[2])
            if ground is not None:
                step = self._correct_spin(ground, t, step)
        self._last = (x, y, yaw)
        self._t.append(t)
        self._steps.append(step)
        if len(self._t) > 200 and self._t[len(self._t) // 2] < t - STEP_HISTORY:
            half = len(self._t) // 2
            del self._t[:half], self._steps[:half]

    def _correct_spin(self, ground: float, t: float, step: tuple[float, float, float, float]
                      ) -> tuple[float, float, float, float]:
        """Return the step at a ground speed [m/s]; correct the steps before its detection, too."""
        dt = t - self._t[-1]
        for k in range(-min(AVERAGED_STEPS - 1, len(self._steps) - 1), 0):
            _, sideways, turn, _ = self._steps[k]
            before = self._t[k] - self._t[k - 1]
            self._steps[k] = (ground * before, sideways, turn, before)
        return ground * dt, step[1], step[2], dt

    def covers(self, start: float, end: float) -> bool:
        """Whether there are steps from ``start`` to ``end`` [s]."""
        return len(self._t) > 1 and self._t[0] <= start <= end <= self._t[-1] + MAX_EXTRAPOLATION

    def stretch(self, start: float, end: float, known: FloatArray) -> Stretch:
        """Return the motion from ``start`` to ``end`` [s]; known (4,): k, b, g, s."""
        newest = len(self._t) - 1
        a = min(max(bisect_left(self._t, start), 1), newest)
        b = max(min(bisect_left(self._t, end), newest), a)
        node = np.array(self._t[a - 1:b + 1])
        raw = np.array(self._steps[a:b + 1])
        long = node[1:] - node[:-1]
        node[0] = start
        node[-1] = end
        raw *= ((node[1:] - node[:-1]) / long)[:, None]
        return _integrate(node, raw, known)


def _integrate(t: FloatArray, raw: FloatArray, known: FloatArray) -> Stretch:
    """Correct and add up steps (n, 4); t (n + 1,) [s]."""
    k, b, g, s = known.tolist()
    # 1. Corrected steps.
    dt = np.maximum(t[1:] - t[:-1], 1e-9)
    dx, dy, dw, spin_time = raw.T
    slips = dx * dw * dx / (dt * dt)
    along = (1.0 + k) * dx
    sideways = (1.0 + k) * dy - s * slips
    turn = (1.0 + g) * dw - b * dt
    # 2. Poses at the nodes.
    yaw = np.concatenate(((0.0,), np.cumsum(turn)))
    middle = yaw[:-1] + 0.5 * turn
    c = np.cos(middle)
    n = np.sin(middle)
    ex = c * along - n * sideways
    ey = n * along + c * sideways
    pose = np.zeros((len(t), 3))
    np.cumsum(ex, out=pose[1:, 0])
    np.cumsum(ey, out=pose[1:, 1])
    pose[:, 2] = yaw
    # 3. Derivatives by k, b, g, s.
    elapsed = np.cumsum(dt) - 0.5 * dt
    heading_change = np.cumsum(dw) - 0.5 * dw
    jacobian = np.array((
        (c @ dx - n @ dy, ey @ elapsed, -(ey @ heading_change), n @ slips),
        (n @ dx + c @ dy, -(ex @ elapsed), ex @ heading_change, -(c @ slips)),
        (0.0, -dt.sum(), dw.sum(), 0.0)))
    rate = np.array((ex[-1], ey[-1], turn[-1])) / dt[-1]
    spin_jacobian = np.array((c @ spin_time, n @ spin_time, 0.0))
    return Stretch(t, pose, jacobian, spin_jacobian, float(np.abs(dx).sum()),
                   float(np.abs(dw).sum()), rate)
