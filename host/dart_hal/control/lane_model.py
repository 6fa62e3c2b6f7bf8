"""How the car moved since the last scan, by its model alone, and what the next one corrects.

Commands and the speed of the wheels give its way through ``plant``; no gyro and no pose is asked.
The lane of a new scan should lie where the last one lay. Where it does not,

    turned by b     the wheels stand by  -b L / way  more to the left than the map says: trim
    shifted by a    the lidar looks  a / way  more to the left than told: mount

are each taken in by a filter: the mean over the way so far, and over the last 4 m later. Scan noise
cancels from one pair of scans to the next, so that of a filter over 1 m 2 mm and 0.1 deg are left.
It never takes less than 1 s: quicker, it answers to the play of the linkage, and both swing.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from math import cos, exp, sin

import numpy as np

from dart_hal.control.paths import Path
from dart_hal.control.plant import BIAS_MOST, Plant, Prediction, Where
from dart_hal.core.types import FloatArray, MotionEstimate, Pose, Scan, Tracking

# m at the start and at the most, and s over which an error is learnt: whichever takes longer.
LEARN_FIRST = 0.7
LEARN_LATER = 4.0
LEARN_TIME = 1.0
# rad; 3 mm of play in holes 57 mm apart are 0.05.
MOUNT_MOST = 0.06
# m between two scans at least, and ahead of the car over which their lanes are compared.
MOVED = 0.02
COMPARED = 1.0
# Poses that are kept: 1 s of answers, a scan takes 0.13.
KEPT = 100
_UNKNOWN = np.zeros((5, 5))


class Reckoning:
    """Pose of the rear axle in a frame that begins where the drive does.

    ``go`` with every answer, ``sent`` with every command, ``compare`` with every new lane. mount
    [rad]: how much more to the left the lidar looks than its files say.
    """

    def __init__(self, plant: Plant) -> None:
        self.now = MotionEstimate(0.0, Pose(), 0.0, 0.0, _UNKNOWN, "lane", Tracking.DEAD_RECKONING)
        self.mount = 0.0
        self.way = 0.0
        self._plant = plant
        self._prediction = Prediction(plant, learns=False)
        self._poses: deque[tuple[float, float, float, float]] = deque(maxlen=KEPT)
        self._compared = (0.0, 0.0)

    @property
    def trim(self) -> float:
        """rad by which the wheels stand more to the left than the map says."""
        return self._prediction.bias

    def go(self, t: float, speed: float) -> MotionEstimate:
        """The motion at t [s], with the speed [m/s] of the wheels."""
        dt = t - self.now.t if self._poses else 0.0
        here = replace(self.now, t=t, speed=speed)
        steady = self._plant.steady
        pose = self.now.pose
        bend = steady.bend(self._prediction.at(here, t).angle, speed)
        turn = bend * speed * dt
        way = speed * dt
        course = pose.yaw + steady.turn(bend, speed).slip + 0.5 * turn
        pose = Pose(pose.x + way * cos(course), pose.y + way * sin(course), pose.yaw + turn)
        self.now = replace(here, pose=pose, yaw_rate=bend * speed)
        self.way += abs(way)
        self._poses.append((t, pose.x, pose.y, pose.yaw))
        return self.now

    def at(self, t: float) -> Where:
        """The motion at a later t [s]."""
        return self._prediction.at(self.now, t)

    def sent(self, angle: float) -> None:
        """An angle [rad] of the road wheels was commanded now."""
        self._prediction.sent(self.now.t, angle)

    def points(self, scan: Scan) -> FloatArray:
        """End points (n, 2) [m] of a scan, each by the pose at its own time."""
        t, x, y, yaw = np.array(self._poses).T
        turned = replace(scan.mount, yaw=scan.mount.yaw + self.mount)
        return scan.mounted(turned).points(lambda at: (
            np.interp(at, t, x), np.interp(at, t, y), np.interp(at, t, yaw)))

    def compare(self, before: Path, after: Path) -> None:
        """Learn from the lanes of two scans in a row."""
        t, s = self._compared
        self._compared = (self.now.t, self.way)
        way = self.way - s
        pose = self.now.pose
        (u, old), (v, new) = (_in_car(path, pose) for path in (before, after))
        at = np.linspace(0.0, min(COMPARED, u[-1], v[-1]), 11)
        if way < MOVED or at[-1] < 0.5 * COMPARED:
            return
        b, a = np.polyfit(at, np.interp(at, v, new) - np.interp(at, u, old), 1)
        over = min(max(self.way, LEARN_FIRST), LEARN_LATER)
        part = 1.0 - exp(-min(way / over, (self.now.t - t) / LEARN_TIME))
        trim = self.trim - part * float(b) * self._plant.vehicle.body.wheelbase / way
        mount = self.mount + part * float(a) / way
        self._prediction.bias = min(max(trim, -BIAS_MOST), BIAS_MOST)
        self.mount = min(max(mount, -MOUNT_MOST), MOUNT_MOST)


def _in_car(path: Path, pose: Pose) -> tuple[FloatArray, FloatArray]:
    """Points of a path ahead and left of a pose [m], as far as they lead on."""
    dx = path.x - pose.x
    dy = path.y - pose.y
    c = cos(pose.yaw)
    s = sin(pose.yaw)
    ahead = c * dx + s * dy
    back = np.flatnonzero(np.diff(ahead) <= 0.0)
    n = int(back[0]) + 1 if len(back) else len(ahead)
    left: FloatArray = c * dy - s * dx
    return ahead[:n], left[:n]
