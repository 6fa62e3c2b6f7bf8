"""Motion of the car since the last scan by its model alone, and its correction by the next scan.

Commands and wheel speed give the motion through ``plant``, without gyro and poses. The lane of a
new scan should coincide with the last one. A difference

    rotation by b   the wheels are  -b L / distance  more to the left than by the map: trim
    shift by a      the lidar is turned  a / distance  more to the left than configured: mount

is averaged by a filter: over the distance so far, later over the last 4 m. Scan noise cancels from
one pair of scans to the next, so a filter over 1 m is off by 2 mm and 0.1 deg. Its time is at least
1 s: a faster filter reacts to the play of the linkage, and both oscillate.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from math import cos, exp, sin

import numpy as np

from dart_hal.control.paths import Path
from dart_hal.control.plant import MAX_BIAS, MotionPrediction, Plant, PredictedMotion
from dart_hal.core.types import FloatArray, MotionEstimate, Pose, Scan, Tracking

# Distance over which errors are averaged, at the start and later [m], and the shortest time [s].
MIN_LEARNING_DISTANCE = 0.7
MAX_LEARNING_DISTANCE = 4.0
MIN_LEARNING_TIME = 1.0
# Largest mounting error [rad]; 3 mm of play in holes 57 mm from each other are 0.05.
MAX_MOUNT_ERROR = 0.06
# Smallest distance between two scans [m], and length of the lanes that is compared [m].
MIN_TRAVEL = 0.02
COMPARED_LENGTH = 1.0
# Stored poses: 1 s of States, a scan takes 0.13 s.
MAX_QUEUED_POSES = 100
_UNKNOWN = np.zeros((5, 5))


class LaneReckoning:
    """Pose of the rear axle in a frame that begins at the start of the drive.

    Call ``advance`` with every State, ``record_command`` with every command, ``compare`` with every
    new lane. mount [rad]: by how much the lidar is turned more to the left than configured.
    """

    def __init__(self, plant: Plant) -> None:
        self.now = MotionEstimate(0.0, Pose(), 0.0, 0.0, _UNKNOWN, "lane", Tracking.DEAD_RECKONING)
        self.mount = 0.0
        self.distance = 0.0
        self._plant = plant
        self._prediction = MotionPrediction(plant, learns_bias=False)
        self._poses: deque[tuple[float, float, float, float]] = deque(maxlen=MAX_QUEUED_POSES)
        self._compared = (0.0, 0.0)

    @property
    def trim(self) -> float:
        """Angle by which the wheels are more to the left than by the map [rad]."""
        return self._prediction.bias

    def advance(self, t: float, speed: float) -> MotionEstimate:
        """Advance to t [s] with a wheel speed [m/s]; return the motion."""
        dt = t - self.now.t if self._poses else 0.0
        here = replace(self.now, t=t, speed=speed)
        steady = self._plant.steady
        pose = self.now.pose
        curvature = steady.curvature(self._prediction.predict(here, t).angle, speed)
        turn = curvature * speed * dt
        travel = speed * dt
        course = pose.yaw + steady.turn(curvature, speed).slip + 0.5 * turn
        pose = Pose(pose.x + travel * cos(course), pose.y + travel * sin(course), pose.yaw + turn)
        self.now = replace(here, pose=pose, yaw_rate=curvature * speed)
        self.distance += abs(travel)
        self._poses.append((t, pose.x, pose.y, pose.yaw))
        return self.now

    def predict(self, t: float) -> PredictedMotion:
        """Predict the motion at a later t [s]."""
        return self._prediction.predict(self.now, t)

    def record_command(self, angle: float) -> None:
        """Record an angle [rad] of the road wheels that is commanded now."""
        self._prediction.record_command(self.now.t, angle)

    def points(self, scan: Scan) -> FloatArray:
        """Return the end points (n, 2) [m] of a scan, each by the pose at its own time."""
        t, x, y, yaw = np.array(self._poses).T
        turned = replace(scan.mount, yaw=scan.mount.yaw + self.mount)
        return scan.mounted(turned).points(lambda time: (
            np.interp(time, t, x), np.interp(time, t, y), np.interp(time, t, yaw)))

    def compare(self, last_path: Path, path: Path) -> None:
        """Learn trim and mount from the lanes of two successive scans."""
        t, s = self._compared
        self._compared = (self.now.t, self.distance)
        travel = self.distance - s
        pose = self.now.pose
        (u, old), (v, new) = (_to_car_frame(path, pose) for path in (last_path, path))
        grid = np.linspace(0.0, min(COMPARED_LENGTH, u[-1], v[-1]), 11)
        if travel < MIN_TRAVEL or grid[-1] < 0.5 * COMPARED_LENGTH:
            return
        b, a = np.polyfit(grid, np.interp(grid, v, new) - np.interp(grid, u, old), 1)
        learning_distance = min(max(self.distance, MIN_LEARNING_DISTANCE), MAX_LEARNING_DISTANCE)
        gain = 1.0 - exp(-min(travel / learning_distance, (self.now.t - t) / MIN_LEARNING_TIME))
        trim = self.trim - gain * float(b) * self._plant.vehicle.body.wheelbase / travel
        mount = self.mount + gain * float(a) / travel
        self._prediction.bias = min(max(trim, -MAX_BIAS), MAX_BIAS)
        self.mount = min(max(mount, -MAX_MOUNT_ERROR), MAX_MOUNT_ERROR)


def _to_car_frame(path: Path, pose: Pose) -> tuple[FloatArray, FloatArray]:
    """Return the points of a path ahead and to the left of a pose [m], as far as they lead forward.
    """
    dx = path.x - pose.x
    dy = path.y - pose.y
    c = cos(pose.yaw)
    s = sin(pose.yaw)
    ahead = c * dx + s * dy
    reversals = np.flatnonzero(np.diff(ahead) <= 0.0)
    n = int(reversals[0]) + 1 if len(reversals) else len(ahead)
    left: FloatArray = c * dy - s * dx
    return ahead[:n], left[:n]
