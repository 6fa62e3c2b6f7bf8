"""What wheels and gyro say between two times, corrected by what the filter knows of them.

Steps of the odometry are kept as they came, in the axes of the car in the middle of each; a
stretch of them is made anew with every scan, for what is known of scale, bias and slip has grown.

    along  (1 + k) dx                          k travel scale
    aside  (1 + k) dy - s v w dx               s slip gain: the rear slips outwards by s v w
    turn   (1 + g) dw - b dt                   g gyro scale, b gyro bias
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from math import cos, sin

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.estimation.spin import AVERAGED_STEPS, SpinDetector

KEPT = 6.0
"""s of steps: a scan, and the longest gap without one that is bridged."""
AHEAD = 0.1
"""s for which the last step goes on beyond the newest State."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """t (n + 1,) [s]: nodes; pose (n + 1, 3): x, y [m], yaw [rad] there, in the axes of the car at
    the first; by (3, 4): how the last goes with k, b, g, s; loose (3,) [s]: with the speed while
    the wheels were not believed; way [m], turn [rad]: driven, without sign;
    rate (3,): vx, vy [m/s], yaw rate [rad/s] at the end, in the same axes."""

    t: FloatArray
    pose: FloatArray
    by: FloatArray
    loose: FloatArray
    way: float
    turn: float
    rate: FloatArray

    def at(self, t: FloatArray) -> FloatArray:
        """Poses (m, 3) at times within, linear between nodes."""
        return np.column_stack([np.interp(t, self.t, column) for column in self.pose.T])


class Steps:
    """Odometry of the last seconds: ``moved`` for each State."""

    def __init__(self) -> None:
        self._t: list[float] = []
        self._steps: list[tuple[float, float, float, float]] = []
        self._spin = SpinDetector()
        self._last: tuple[float, float, float] | None = None

    def moved(self, t: float, x: float, y: float, yaw: float, accel: float | None = None) -> None:
        """The car by dead reckoning at t [s], and its acceleration [m/s2] along the nose where one
        is known; what is not later than the last is no news."""
        if self._t and t <= self._t[-1]:
            return
        step = (0.0, 0.0, 0.0, 0.0)
        if self._last is not None:
            x0, y0, yaw0 = self._last
            middle = 0.5 * (yaw + yaw0)
            c, s = cos(middle), sin(middle)
            step = (c * (x - x0) + s * (y - y0), c * (y - y0) - s * (x - x0), yaw - yaw0,
                    0.0)
            ground = self._spin.update(step[0], t - self._t[-1], accel, step[2])
            if ground is not None:
                step = self._slipped(ground, t, step)
        self._last = (x, y, yaw)
        self._t.append(t)
        self._steps.append(step)
        if len(self._t) > 200 and self._t[len(self._t) // 2] < t - KEPT:
            half = len(self._t) // 2
            del self._t[:half], self._steps[:half]

    def _slipped(self, ground: float, t: float, step: tuple[float, float, float, float]
                 ) -> tuple[float, float, float, float]:
        """The step at a speed [m/s] over ground, and those in which it was not noticed yet."""
        dt = t - self._t[-1]
        for k in range(-min(AVERAGED_STEPS - 1, len(self._steps) - 1), 0):
            _, aside, turn, _ = self._steps[k]
            before = self._t[k] - self._t[k - 1]
            self._steps[k] = (ground * before, aside, turn, before)
        return ground * dt, step[1], step[2], dt

    def covers(self, start: float, end: float) -> bool:
        """Whether there are steps from ``start`` to ``end`` [s]."""
        return len(self._t) > 1 and self._t[0] <= start <= end <= self._t[-1] + AHEAD

    def stretch(self, start: float, end: float, known: FloatArray) -> Stretch:
        """From ``start`` to ``end`` [s], which are covered; known (4,): k, b, g, s."""
        newest = len(self._t) - 1
        a = min(max(bisect_left(self._t, start), 1), newest)
        b = max(min(bisect_left(self._t, end), newest), a)
        node = np.array(self._t[a - 1:b + 1])
        raw, long = np.array(self._steps[a:b + 1]), np.diff(node)
        node[0], node[-1] = start, end
        raw *= (np.diff(node) / long)[:, None]
        return _laid(node, raw, known)


def _laid(t: FloatArray, raw: FloatArray, known: FloatArray) -> Stretch:
    """Steps (n, 4) one behind the other, corrected; t (n + 1,) [s]."""
    k, b, g, s = known.tolist()
    dt = np.maximum(np.diff(t), 1e-9)
    dx, dy, dw, doubted = raw.T
    slips = dx * dw * dx / (dt * dt)
    along, aside, turn = (1.0 + k) * dx, (1.0 + k) * dy - s * slips, (1.0 + g) * dw - b * dt
    yaw = np.concatenate(((0.0,), np.cumsum(turn)))
    middle = yaw[:-1] + 0.5 * turn
    c, n = np.cos(middle), np.sin(middle)
    ex, ey = c * along - n * aside, n * along + c * aside
    pose = np.zeros((len(t), 3))
    np.cumsum(ex, out=pose[1:, 0])
    np.cumsum(ey, out=pose[1:, 1])
    pose[:, 2] = yaw
    spent = np.cumsum(dt) - 0.5 * dt
    turned = np.cumsum(dw) - 0.5 * dw
    by = np.array((
        ((c * dx - n * dy).sum(), (ey * spent).sum(), -(ey * turned).sum(),
         (n * slips).sum()),
        ((n * dx + c * dy).sum(), -(ex * spent).sum(), (ex * turned).sum(),
         -(c * slips).sum()),
        (0.0, -dt.sum(), dw.sum(), 0.0)))
    rate = np.array((ex[-1], ey[-1], turn[-1])) / dt[-1]
    loose = np.array(((c * doubted).sum(), (n * doubted).sum(), 0.0))
    return Stretch(t, pose, by, loose, float(np.abs(dx).sum()), float(np.abs(dw).sum()), rate)
