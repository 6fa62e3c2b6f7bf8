"""What slam_gmapping, amcl and laser_geometry do with a scan, written from their sources.

The numbers in brackets are the functions: slam_gmapping.cpp (initMapper, addScan), amcl_node.cpp
(laserReceived), laser_geometry.cpp (projectLaser_). A message that they would refuse or place
wrongly raises AssertionError here.
"""

from __future__ import annotations

from bisect import bisect
from math import atan2, fmod, isclose, pi

import numpy as np

from dart_hal.car.export.standard import Planar


def seconds(stamp):
    return stamp.fields["sec"] + 1e-9 * stamp.fields["nanosec"]


class Buffer:
    """tf2's buffer of planar frames: the last transform of each child before a time."""

    def __init__(self, messages):
        self.links = {}
        for topic, message in messages:
            if topic in ("/tf", "/tf_static"):
                for one in message.fields["transforms"]:
                    self._add(one, topic == "/tf_static")

    def _add(self, one, static):
        f = one.fields
        at, turn = (f["transform"].fields[k].fields for k in ("translation", "rotation"))
        pose = Planar(at["x"], at["y"], 2.0 * atan2(turn["z"], turn["w"]))
        parent, rows = self.links.setdefault(f["child_frame_id"],
                                             (f["header"].fields["frame_id"], []))
        assert parent == f["header"].fields["frame_id"], "a frame has one parent"
        t = -np.inf if static else seconds(f["header"].fields["stamp"])
        assert not rows or static or t > rows[-1][0], "tf2 ignores repeated and older data"
        rows.append((t, pose))

    def look_up(self, frame, child, t):
        """Pose of ``child`` in ``frame`` at t [s]; AssertionError where tf2 would extrapolate."""
        pose = Planar()
        while child != frame:
            assert child in self.links, f"{frame} is not above {child}"
            child, rows = self.links[child]
            k = bisect(rows, t, key=lambda row: row[0])
            assert k, f"no transform at {t}: extrapolation into the past"
            later = rows[min(k, len(rows) - 1)]
            assert later[0] >= t - 1e-9 or rows[0][0] == -np.inf, "extrapolation into the future"
            near = min(rows[k - 1], later, key=lambda row: abs(row[0] - t))
            pose = near[1] @ pose
        return pose


class Gmapping:
    """initMapper takes the geometry of the first scan for all."""

    def __init__(self, scan, buffer, number=1):
        f = scan.fields
        self.frames = f"odom_{number}", f"base_link_{number}"
        self.buffer = buffer
        self.count = len(f["ranges"])
        self.max_range = f["range_max"] - 0.01
        centre = 0.5 * (f["angle_min"] + f["angle_max"])
        self.reverse = f["angle_min"] > f["angle_max"]
        laser = buffer.look_up(self.frames[1], f["header"].fields["frame_id"],
                               seconds(f["header"].fields["stamp"]))
        self.laser = laser @ Planar(yaw=centre)
        half = 0.5 * abs(f["angle_max"] - f["angle_min"])
        self.angles = -half + abs(f["angle_increment"]) * np.arange(self.count)
        assert isclose(self.angles[-1], half, abs_tol=1e-6), "the angles are not symmetric"

    def points(self, scan):
        """Points (n, 2) in the car that addScan gives to the matcher."""
        f = scan.fields
        assert len(f["ranges"]) == self.count, "addScan drops a scan of another size"
        self.buffer.look_up(*self.frames, seconds(f["header"].fields["stamp"]))
        ranges = np.array(f["ranges"][::-1] if self.reverse else f["ranges"])
        ranges[ranges < f["range_min"]] = f["range_max"]
        with np.errstate(invalid="ignore"):
            good = ~((ranges > self.max_range) | (ranges == 0.0) | np.isnan(ranges))
        bearing = self.laser.yaw + self.angles[good]
        return np.column_stack((self.laser.x + ranges[good] * np.cos(bearing),
                                self.laser.y + ranges[good] * np.sin(bearing)))


def amcl_points(scan, buffer, number=1):
    """Points (n, 2) in the car that the likelihood field of amcl weighs."""
    f = scan.fields
    base = f"base_link_{number}"
    t = seconds(f["header"].fields["stamp"])
    laser = buffer.look_up(base, f["header"].fields["frame_id"], t)
    buffer.look_up(f"odom_{number}", base, t)
    assert f["range_max"] > 0.0
    first = laser.yaw + f["angle_min"]
    step = fmod(f["angle_increment"] + 5.0 * pi, 2.0 * pi) - pi
    ranges = np.array(f["ranges"])
    ranges[(ranges <= f["range_min"]) | (ranges > f["range_max"])] = f["range_max"]
    good = ranges < f["range_max"]
    bearing = first + step * np.arange(len(ranges))[good]
    return np.column_stack((laser.x + ranges[good] * np.cos(bearing),
                            laser.y + ranges[good] * np.sin(bearing)))


def reading_times(scan):
    """Time [s] of each reading, as laser_geometry takes it."""
    f = scan.fields
    return seconds(f["header"].fields["stamp"]) + f["time_increment"] * np.arange(len(f["ranges"]))
