"""What other robots' tools look for in a bag: LaserScan and transforms, made of a run's messages.

https://www.ros.org/reps/rep-0105.html names the frames; the types are ROS 2's own definitions.
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

SCAN, LIDAR_SCAN = "sensor_msgs/msg/LaserScan", "dart_msgs/msg/LidarScan"
TF = "tf2_msgs/msg/TFMessage"
ODOMETRY, POSE = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseWithCovarianceStamped"
RAW = "/scan/raw"
"""Where the scan goes as the unit told it: /scan is what other tools expect there."""
NEAREST, FURTHEST = 0.12, 12.0
"""m: data sheet of the X4; the furthest with a fifth to spare, for readers drop what is beyond."""
WHOLE = 0.9
"""Share of the median number of beams from which on a revolution is whole."""
KEPT = 200
"""Odometry messages, 2 s: a pose of the lidar's is told within one."""


class Planar(NamedTuple):
    """A frame in another: x, y [m], yaw [rad]."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def __matmul__(self, other: Planar) -> Planar:
        """``other``, which is told in this frame, in the one that this is told in."""
        c, s = cos(self.yaw), sin(self.yaw)
        return Planar(self.x + c * other.x - s * other.y, self.y + s * other.x + c * other.y,
                      self.yaw + other.yaw)

    def inverse(self) -> Planar:
        c, s = cos(self.yaw), sin(self.yaw)
        return Planar(-c * self.x - s * self.y, s * self.x - c * self.y, -self.yaw)


def add_types(store: Any, known: Any) -> None:
    """Let a type store know what is made here; known: the one of a ROS 2 distribution."""
    for kind in (SCAN, TF, "geometry_msgs/msg/TransformStamped", "geometry_msgs/msg/Transform",
                 "geometry_msgs/msg/Vector3", "geometry_msgs/msg/Quaternion",
                 "std_msgs/msg/Header", "builtin_interfaces/msg/Time"):
        if kind not in store.fielddefs:
            store.register({kind: known.fielddefs[kind]})


def messages(run: RunReader, store: Any) -> Iterator[Recorded]:
    """All of the run, in the order of time; ``store``: types that ``add_types`` has completed.

    Behind each odometry comes /tf: odom to base_link, base_link to laser of a car with a lidar,
    and the room's frame to odom from the first pose on. Errors: ConfigError.
    """
    files, kinds = _files(run), set(run.definitions)
    mount = mount_of(files) if files else Mount()
    marker = _marker_of(files)
    fixed = [("base_link", "laser", Planar(mount.x, mount.y, mount.yaw))] * (LIDAR_SCAN in kinds)
    readings = count_readings([len(scan) for scan in run.scans()]) if LIDAR_SCAN in kinds else 0
    odometry: list[tuple[int, Planar]] = []
    room: list[tuple[str, str, Planar]] = []
    for message in run.messages():
        if message.kind == LIDAR_SCAN:
            told = cdr.scan_of(message.data, 0.0).mounted(mount)
            raw = store.serialize_cdr(laser_scan(told, run.zero_ns, store, readings), SCAN)
            yield Recorded("/scan", SCAN, message.ns, bytes(raw))
            yield message._replace(topic=RAW)
            continue
        yield message
        if message.kind == ODOMETRY:
            told = store.deserialize_cdr(message.data, message.kind)
            here = _planar(told.pose.pose)
            odometry = [*odometry[1 - KEPT:], (message.ns, here)]
            links = [*room, (told.header.frame_id, told.child_frame_id, here), *fixed]
            yield Recorded("/tf", TF, message.ns, bytes(store.serialize_cdr(
                _transforms(links, told.header.stamp, store), TF)))
        elif message.kind == POSE and odometry:
            told = store.deserialize_cdr(message.data, message.kind)
            frame, stamp = told.header.frame_id, told.header.stamp
            ns = (run.zero_ns + stamp.sec * 10**9 + stamp.nanosec if frame == FRAME
                  else message.ns - round(1e9 * marker.latency))
            at = odometry[max(bisect(odometry, ns, key=lambda one: one[0]) - 1, 0)][1]
            axle = _planar(told.pose.pose) @ (Planar() if frame == FRAME else marker.axle)
            room = [(frame, "odom", axle @ at.inverse())]


def count_readings(lengths: Sequence[int]) -> int:
    """Return the number of readings of each LaserScan of a bag.

    lengths: beams of each scan. Readers take the number of the first message for all. It is the
    smallest number of beams of a whole revolution: then no step of the angle lacks a beam.
    Revolutions with less than ``WHOLE`` of the median have lost packets.
    """
    median = float(np.median(lengths)) if lengths else 0.0
    return min((n for n in lengths if n >= WHOLE * median), default=0)


def laser_scan(scan: Scan, zero_ns: int, store: Any, readings: int) -> Any:
    """Build a sensor_msgs/LaserScan in the frame ``laser``, as REP 117 defines it.

    The angles ascend in ``readings`` equal steps of one turn. Each beam goes to the nearest step,
    of several the nearest point. Infinity: nothing came back. NaN: no beam (lost packets).

    The stamp is that of the first reading. The time increment of a unit that turns clockwise is
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
        distance = np.where(np.isnan(scan.range), inf, scan.range).astype(np.float32)
        np.fmin.at(ranges, place, distance)
    if clockwise:
        ranges = ranges[::-1].copy()
    first = step if clockwise else 0.0
    start = scan.start + (period * (n - 1) / n if clockwise and n else 0.0)
    seconds, rest = divmod(zero_ns + round(1e9 * start), 10**9)
    increment = period / n if n else 0.0
    kinds = store.types
    return kinds[SCAN](
        header=_header(kinds, kinds["builtin_interfaces/msg/Time"](seconds, rest), "laser"),
        angle_min=first, angle_max=first + step * max(n - 1, 0), angle_increment=step,
        time_increment=-increment if clockwise else increment, scan_time=period,
        range_min=NEAREST, range_max=FURTHEST, ranges=ranges,
        intensities=np.zeros(0, np.float32))


class _Marker(NamedTuple):
    """axle: of the rear axle in the marker's frame; latency [s]."""

    axle: Planar
    latency: float


def _transforms(links: list[tuple[str, str, Planar]], stamp: Any, store: Any) -> Any:
    kinds = store.types
    return kinds[TF]([
        kinds["geometry_msgs/msg/TransformStamped"](
            _header(kinds, stamp, frame), child, kinds["geometry_msgs/msg/Transform"](
                kinds["geometry_msgs/msg/Vector3"](at.x, at.y, 0.0),
                kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, sin(0.5 * at.yaw),
                                                      cos(0.5 * at.yaw))))
        for frame, child, at in links])


def _planar(pose: Any) -> Planar:
    """Of a geometry_msgs/Pose in the plane."""
    turn = pose.orientation
    return Planar(pose.position.x, pose.position.y, 2.0 * atan2(turn.z, turn.w))


def _header(kinds: Any, stamp: Any, frame: str) -> Any:
    return kinds["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def _marker_of(files: CarFiles | None) -> _Marker:
    """As ``calibrate mocap`` has measured it, else the rear axle and no delay."""
    table = files.calibration.mocap if files and files.calibration else None
    found = (table.marker_x, table.marker_y, table.marker_yaw, table.latency) if table else ()
    x, y, theta, latency = (one.value if one else 0.0 for one in found or (None,) * 4)
    return _Marker(Planar(x, y, -theta).inverse(), latency)


def _files(run: RunReader) -> CarFiles | None:
    """What the car of the run was; a calibration that this version cannot read is not used."""
    text, name = run.files.get("car.toml"), "calibration.toml"
    if text is None:
        return None
    try:
        return parse_run_car(text, str(run.path), {name: run.files.get(name, "")})
    except ConfigError:
        return parse_run_car(text, str(run.path), {})
