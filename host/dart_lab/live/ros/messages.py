"""ROS messages as plain values: a type and its fields, the same for ROS 1 and ROS 2."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import cos, nan, sin
from typing import Any

import numpy as np

from dart_hal.car.export.standard import MAX_RANGE, MIN_RANGE, Planar, laser_readings
from dart_hal.core.types import ExternalPose, Pose, Scan, State, nanoseconds
from dart_hal.estimation.localisation.grid import Grid
from dart_hal.recording.cdr import planar_covariance, twist_covariance

# Name in ROS 2. ROS 1 has another type with the same two numbers.
TIME_KIND = "builtin_interfaces/Time"
# Frame of the room: that of the external poses.
MAP_FRAME = "map"


@dataclass(frozen=True, slots=True)
class RosMessage:
    """kind: type such as "std_msgs/Float32". A field is a number, text, sequence or RosMessage."""

    kind: str
    fields: Mapping[str, Any]


def build_object(message: RosMessage, class_of: Callable[[str], Callable[..., Any]]) -> Any:
    """Return the message as an object of the middleware's classes, ``class_of(kind)``."""
    def value(field: Any) -> Any:
        if isinstance(field, RosMessage):
            return build_object(field, class_of)
        if isinstance(field, Sequence) and field and isinstance(field[0], RosMessage):
            return [build_object(one, class_of) for one in field]
        return field

    return class_of(message.kind)(**{k: value(v) for k, v in message.fields.items()})


def number(value: float) -> RosMessage:
    """Return a Float32."""
    return RosMessage("std_msgs/Float32", {"data": value})


def numbers(values: Sequence[float]) -> RosMessage:
    """Return a Float32MultiArray of one row, without a layout as in DART's software."""
    layout = RosMessage("std_msgs/MultiArrayLayout", {"dim": [], "data_offset": 0})
    return RosMessage("std_msgs/Float32MultiArray", {"layout": layout, "data": list(values)})


def odometry(state: State, stamp: float, frame: str, child: str) -> RosMessage:
    """Return pose of the rear axle in ``frame``, speed and yaw rate; stamp [s] since 1970."""
    return RosMessage("nav_msgs/Odometry", {
        "header": _header(stamp, frame), "child_frame_id": child, "pose": _pose(state.pose),
        "twist": RosMessage("geometry_msgs/TwistWithCovariance", {
            "twist": RosMessage("geometry_msgs/Twist", {
                "linear": _vector(state.speed), "angular": _vector(z=state.yaw_rate or 0.0)}),
            "covariance": twist_covariance(state)})})


def transforms(links: Sequence[tuple[str, str, Planar]], stamp: float) -> RosMessage:
    """Return the tf message of (frame, child, pose of the child in the frame); stamp [s]."""
    return RosMessage("tf2_msgs/TFMessage", {"transforms": [
        RosMessage("geometry_msgs/TransformStamped", {
            "header": _header(stamp, frame), "child_frame_id": child,
            "transform": RosMessage("geometry_msgs/Transform", {
                "translation": _vector(pose.x, pose.y), "rotation": _quaternion(pose.yaw)})})
        for frame, child, pose in links]})


def laser_scan(scan: Scan, readings: int, epoch: float, frame: str) -> RosMessage:
    """Return the LaserScan of ``laser_readings``; epoch [s]: zero of the scan's clock."""
    found = laser_readings(scan, readings)
    values = {name: value for name, value in found._asdict().items() if name != "start"}
    return RosMessage("sensor_msgs/LaserScan", {
        "header": _header(epoch + found.start, frame), **values, "range_min": MIN_RANGE,
        "range_max": MAX_RANGE, "ranges": found.ranges.tolist(), "intensities": []})


def occupancy_grid(grid: Grid, stamp: float, frame: str) -> RosMessage:
    """Return the map of a grid: 100 occupied, 0 free, -1 unknown."""
    rows, columns = grid.occupied.shape
    cells = np.where(grid.occupied, 100, np.where(grid.free, 0, -1))
    header = _header(stamp, frame)
    x, y = grid.origin.tolist()
    return RosMessage("nav_msgs/OccupancyGrid", {
        "header": header, "data": cells.ravel().tolist(),
        "info": RosMessage("nav_msgs/MapMetaData", {
            "map_load_time": header.fields["stamp"], "resolution": grid.cell, "width": columns,
            "height": rows, "origin": _plain_pose(x, y, 0.0)})})


def battery_state(voltage: float, stamp: float) -> RosMessage:
    """Return the BatteryState of a measured voltage [V]; what is not measured is NaN or unknown."""
    unknown = dict.fromkeys(("temperature", "current", "charge", "capacity", "design_capacity",
                             "percentage"), nan)
    kinds = dict.fromkeys(("power_supply_status", "power_supply_health",
                           "power_supply_technology"), 0)
    return RosMessage("sensor_msgs/BatteryState", {
        "header": _header(stamp, ""), "voltage": voltage, **unknown, **kinds, "present": True,
        "cell_voltage": [], "cell_temperature": [], "location": "", "serial_number": ""})


def clock(stamp: float) -> RosMessage:
    """Return the time for nodes with ``use_sim_time``; stamp [s]."""
    return RosMessage("rosgraph_msgs/Clock", {"clock": _time(stamp)})


def external_pose(pose: ExternalPose, stamp: float) -> RosMessage:
    """Return the pose of the marker frame in the frame of the motion capture: MAP_FRAME."""
    return RosMessage("geometry_msgs/PoseWithCovarianceStamped", {
        "header": _header(stamp, MAP_FRAME),
        "pose": _pose(Pose(pose.x, pose.y, pose.yaw, pose.cov))})


def _header(stamp: float, frame: str) -> RosMessage:
    return RosMessage("std_msgs/Header", {"stamp": _time(stamp), "frame_id": frame})


def _time(stamp: float) -> RosMessage:
    seconds, rest = divmod(nanoseconds(stamp), 10**9)
    return RosMessage(TIME_KIND, {"sec": seconds, "nanosec": rest})


def _pose(pose: Pose) -> RosMessage:
    return RosMessage("geometry_msgs/PoseWithCovariance", {
        "pose": _plain_pose(pose.x, pose.y, pose.yaw), "covariance": planar_covariance(pose.cov)})


def _plain_pose(x: float, y: float, yaw: float) -> RosMessage:
    place = RosMessage("geometry_msgs/Point", {"x": x, "y": y, "z": 0.0})
    return RosMessage("geometry_msgs/Pose", {"position": place, "orientation": _quaternion(yaw)})


def _vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> RosMessage:
    return RosMessage("geometry_msgs/Vector3", {"x": x, "y": y, "z": z})


def _quaternion(yaw: float) -> RosMessage:
    return RosMessage("geometry_msgs/Quaternion", {
        "x": 0.0, "y": 0.0, "z": sin(0.5 * yaw), "w": cos(0.5 * yaw)})
