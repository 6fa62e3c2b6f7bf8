"""LaserScan and transforms of a run, which ROS tools need in a bag.

https://www.ros.org/reps/rep-0105.html defines the frames; the types are those of ROS 2.
"""

from __future__ import annotations

from bisect import bisect
from collections.abc import Iterator, Sequence
from math import atan2, cos, inf, nan, sin, tau
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dart_hal.car.lidar import mount_of
from dart_hal.core.config import CarFiles
from dart_hal.core.config.folders import parse_run_car
from dart_hal.core.errors import ConfigError
from dart_hal.core.types import Mount, Scan
from dart_hal.estimation.localisation.source import FRAME
from dart_hal.recording import cdr
from dart_hal.recording.items import Recorded
from dart_hal.recording.run import RunReader

LASER_SCAN_TYPE = "sensor_msgs/msg/LaserScan"
LIDAR_SCAN_TYPE = "dart_msgs/msg/LidarScan"
TF_TYPE = "tf2_msgs/msg/TFMessage"
ODOMETRY_TYPE = "nav_msgs/msg/Odometry"
POSE_TYPE = "geometry_msgs/msg/PoseWithCovarianceStamped"
# Topic of the scan in our own type; ROS tools require a LaserScan at /scan.
RAW_SCAN_TOPIC = "/scan/raw"
# m: data sheet of the X4; MAX_RANGE with a fifth to spare, since tools drop what is beyond.
MIN_RANGE = 0.12
MAX_RANGE = 12.0
# Smallest share of the median number of beams of a complete revolution.
MIN_WHOLE_SHARE = 0.9
# Odometry messages that are kept, 2 s: a pose by the lidar arrives within one.
MAX_ODOMETRY_MESSAGES = 200


class Planar(NamedTuple):
    """A frame relative to another: x, y [m], yaw [rad]."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def __matmul__(self, other: Planar) -> Planar:
        """Return ``other``, given relative to this frame, relative to the parent of this one."""
        c = cos(self.yaw)
        s = sin(self.yaw)
        return Planar(self.x + c * other.x - s * other.y, self.y + s * other.x + c * other.y,
                      self.yaw + other.yaw)

    def inverse(self) -> Planar:
        """Return the parent frame relative to this one."""
        c = cos(self.yaw)
        s = sin(self.yaw)
        return Planar(-c * self.x - s * self.y, s * self.x - c * self.y, -self.yaw)


def add_types(store: Any, known: Any) -> None:
    """Add the ROS types of this module to a type store; known: store of a ROS 2 distribution."""
    for kind in (LASER_SCAN_TYPE, TF_TYPE, "geometry_msgs/msg/TransformStamped",
                 "geometry_msgs/msg/Transform", "geometry_msgs/msg/Vector3",
                 "geometry_msgs/msg/Quaternion",
                 "std_msgs/msg/Header", "builtin_interfaces/msg/Time"):
        if kind not in store.fielddefs:
            store.register({kind: known.fielddefs[kind]})


def messages(run: RunReader, store: Any) -> Iterator[Recorded]:
    """Yield all messages of a run in the order of time; ``store``: completed by ``add_types``.

    After each odometry follows /tf: odom to base_link; base_link to laser, for a car with a lidar;
    the frame of the external poses to odom, from the first pose on. Raises ConfigError.
    """
    files = _files(run)
    mount = mount_of(files) if files else Mount()
    marker = _marker_of(files)
    has_lidar = LIDAR_SCAN_TYPE in set(run.definitions)
    fixed = [("base_link", "laser", Planar(mount.x, mount.y, mount.yaw))] * has_lidar
    readings = count_readings([len(scan) for scan in run.scans()]) if has_lidar else 0
    odometry: list[tuple[int, Planar]] = []
    room: list[tuple[str, str, Planar]] = []
    for message in run.messages():
        if message.kind == LIDAR_SCAN_TYPE:
            scan = cdr.decode_scan(message.data, 0.0).mounted(mount)
            laser = laser_scan(scan, run.zero_ns, store, readings)
            raw = store.serialize_cdr(laser, LASER_SCAN_TYPE)
            yield Recorded("/scan", LASER_SCAN_TYPE, message.ns, bytes(raw))
            yield message._replace(topic=RAW_SCAN_TOPIC)
            continue
        if message.kind == POSE_TYPE:
            ros_pose = store.deserialize_cdr(message.data, message.kind)
            frame = ros_pose.header.frame_id
            stamp = ros_pose.header.stamp
            # The stamp of a motion capture is of another clock, and one of the lidar begins with
            # the car's. The time of the message is its arrival.
            ns = (run.zero_ns + stamp.sec * 10**9 + stamp.nanosec if frame == FRAME
                  else message.ns - round(1e9 * marker.latency))
            stamp.sec, stamp.nanosec = divmod(ns, 10**9)
            yield message._replace(data=bytes(store.serialize_cdr(ros_pose, message.kind)))
            if odometry:
                # Odometry at the time of the external pose: both give the frame of odom.
                at = odometry[max(bisect(odometry, ns, key=lambda one: one[0]) - 1, 0)][1]
                axle = _planar(ros_pose.pose.pose) @ (Planar() if frame == FRAME else marker.axle)
                room = [(frame, "odom", axle @ at.inverse())]
            continue
        yield message
        if message.kind == ODOMETRY_TYPE:
            ros_odometry = store.deserialize_cdr(message.data, message.kind)
            here = _planar(ros_odometry.pose.pose)
            odometry = [*odometry[1 - MAX_ODOMETRY_MESSAGES:], (message.ns, here)]
            header = ros_odometry.header
            links = [*room, (header.frame_id, ros_odometry.child_frame_id, here), *fixed]
            yield Recorded("/tf", TF_TYPE, message.ns, bytes(store.serialize_cdr(
                _transforms(links, header.stamp, store), TF_TYPE)))


def count_readings(lengths: Sequence[int]) -> int:
    """Return the number of readings of each LaserScan of a bag.

    lengths: beams of each scan. Readers take the number of the first message for all. It is the
    smallest number of beams of a whole revolution: then no step of the angle lacks a beam.
    Revolutions with less than ``MIN_WHOLE_SHARE`` of the median have lost packets.
    """
    median = float(np.median(lengths)) if lengths else 0.0
    return min((n for n in lengths if n >= MIN_WHOLE_SHARE * median), default=0)


class LaserReadings(NamedTuple):
    """Contents of a sensor_msgs/LaserScan.

    start [s]: time of the first reading, on the clock of the scan; angles [rad] of the first and
    the last; the steps of angle [rad] and time [s]; scan_time [s]: of a turn; ranges (n,) [m].
    """

    start: float
    angle_min: float
    angle_max: float
    angle_increment: float
    time_increment: float
    scan_time: float
    ranges: NDArray[np.float32]


def laser_readings(scan: Scan, readings: int) -> LaserReadings:
    """Sort the beams of a scan into readings in the frame ``laser``, as REP 117 defines them.

    The angles ascend in ``readings`` equal steps of one turn. Each beam goes to the nearest step,
    of several the nearest point. Infinity: nothing came back, or from beyond ``MAX_RANGE``; minus
    infinity: nearer than ``MIN_RANGE``; NaN: no beam (lost packets).

    The start is that of the first reading. The time increment of a unit that turns clockwise is
    negative, since its last beam has the smallest angle.
    https://www.ros.org/reps/rep-0117.html
    """
    n = readings
    clockwise = scan.mount.inverted
    period = 1.0 / scan.rate if scan.rate > 0.0 else 0.0
    step = tau / n if n else 0.0
    ranges: NDArray[np.float32] = np.full(n, nan, np.float32)
    if n and len(scan):
        # Steps from the unit's zero, in its own sense of rotation.
        place = np.rint(scan.angle / step).astype(int) % n
        distance = np.where(scan.range <= MAX_RANGE, scan.range, inf)
        distance[distance < MIN_RANGE] = -inf
        np.fmin.at(ranges, place, distance.astype(np.float32))
    if clockwise:
        ranges = ranges[::-1].copy()
    first = step if clockwise else 0.0
    start = scan.start + (period * (n - 1) / n if clockwise and n else 0.0)
    increment = period / n if n else 0.0
    return LaserReadings(start, first, first + step * max(n - 1, 0), step,
                         -increment if clockwise else increment, period, ranges)


def laser_scan(scan: Scan, zero_ns: int, store: Any, readings: int) -> Any:
    """Build a sensor_msgs/LaserScan of ``laser_readings``, with its time on the clock of ROS."""
    found = laser_readings(scan, readings)
    seconds, rest = divmod(zero_ns + round(1e9 * found.start), 10**9)
    kinds = store.types
    return kinds[LASER_SCAN_TYPE](
        header=_header(kinds, kinds["builtin_interfaces/msg/Time"](seconds, rest), "laser"),
        range_min=MIN_RANGE, range_max=MAX_RANGE, intensities=np.zeros(0, np.float32),
        **{name: value for name, value in found._asdict().items() if name != "start"})


class _Marker(NamedTuple):
    """axle: rear axle relative to the marker. latency [s]."""

    axle: Planar
    latency: float


def _transforms(links: list[tuple[str, str, Planar]], stamp: Any, store: Any) -> Any:
    """Return a tf2_msgs/TFMessage of (parent, child, frame)."""
    kinds = store.types
    return kinds[TF_TYPE]([
        kinds["geometry_msgs/msg/TransformStamped"](
            _header(kinds, stamp, frame), child, kinds["geometry_msgs/msg/Transform"](
                kinds["geometry_msgs/msg/Vector3"](at.x, at.y, 0.0),
                kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, sin(0.5 * at.yaw),
                                                      cos(0.5 * at.yaw))))
        for frame, child, at in links])


def _planar(pose: Any) -> Planar:
    """Return the planar frame of a geometry_msgs/Pose."""
    turn = pose.orientation
    return Planar(pose.position.x, pose.position.y, 2.0 * atan2(turn.z, turn.w))


def _header(kinds: Any, stamp: Any, frame: str) -> Any:
    return kinds["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def _marker_of(files: CarFiles | None) -> _Marker:
    """Return the marker of ``calibrate mocap``, else the rear axle and no latency."""
    table = files.calibration.mocap if files and files.calibration else None
    found = (table.marker_x, table.marker_y, table.marker_yaw, table.latency) if table else ()
    x, y, theta, latency = (one.value if one else 0.0 for one in found or (None,) * 4)
    return _Marker(Planar(x, y, -theta).inverse(), latency)


def _files(run: RunReader) -> CarFiles | None:
    """Return the files of the run's car, without a calibration that cannot be read."""
    text = run.files.get("car.toml")
    name = "calibration.toml"
    if text is None:
        return None
    try:
        return parse_run_car(text, str(run.path), {name: run.files.get(name, "")})
    except ConfigError:
        return parse_run_car(text, str(run.path), {})
