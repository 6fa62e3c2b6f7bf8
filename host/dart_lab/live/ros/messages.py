"""ROS messages as values: a type and its fields, the same for ROS 1 and ROS 2."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import cos, sin
from typing import Any

from dart_hal.core.types import ExternalPose, Pose, State, nanoseconds
from dart_hal.recording.cdr import planar_covariance, twist_covariance

TIME = "builtin_interfaces/Time"
"""ROS 2's name; ROS 1 has a time of its own, with the same two numbers."""


@dataclass(frozen=True, slots=True)
class Message:
    """kind: "std_msgs/Float32"; a field is a number, a text, a sequence, or a Message."""

    kind: str
    fields: Mapping[str, Any]


def built(message: Message, class_of: Callable[[str], Callable[..., Any]]) -> Any:
    """An object of the middleware's own classes, which ``class_of(kind)`` names."""
    def value(field: Any) -> Any:
        if isinstance(field, Message):
            return built(field, class_of)
        if isinstance(field, Sequence) and field and isinstance(field[0], Message):
            return [built(one, class_of) for one in field]
        return field

    return class_of(message.kind)(**{k: value(v) for k, v in message.fields.items()})


def number(value: float) -> Message:
    return Message("std_msgs/Float32", {"data": value})


def numbers(values: Sequence[float]) -> Message:
    """One row, as upstream sends it: without a layout."""
    layout = Message("std_msgs/MultiArrayLayout", {"dim": [], "data_offset": 0})
    return Message("std_msgs/Float32MultiArray", {"layout": layout, "data": list(values)})


def odometry(state: State, stamp: float, frame: str, child: str) -> Message:
    """Pose of the rear axle in ``frame``, speed and yaw rate of ``child``; stamp [s] since 1970."""
    return Message("nav_msgs/Odometry", {
        "header": _header(stamp, frame), "child_frame_id": child, "pose": _pose(state.pose),
        "twist": Message("geometry_msgs/TwistWithCovariance", {
            "twist": Message("geometry_msgs/Twist", {
                "linear": _vector(state.speed), "angular": _vector(z=state.yaw_rate or 0.0)}),
            "covariance": twist_covariance(state)})})


def transform(pose: Pose, stamp: float, frame: str, child: str) -> Message:
    """tf: where ``child`` is in ``frame``."""
    moved = Message("geometry_msgs/Transform", {"translation": _vector(pose.x, pose.y),
                                                "rotation": _turned(pose.yaw)})
    one = Message("geometry_msgs/TransformStamped", {
        "header": _header(stamp, frame), "child_frame_id": child, "transform": moved})
    return Message("tf2_msgs/TFMessage", {"transforms": [one]})


def external_pose(pose: ExternalPose, stamp: float) -> Message:
    """The marker frame in the room's frame."""
    return Message("geometry_msgs/PoseWithCovarianceStamped", {
        "header": _header(stamp, pose.frame),
        "pose": _pose(Pose(pose.x, pose.y, pose.yaw, pose.cov))})


def _header(stamp: float, frame: str) -> Message:
    seconds, rest = divmod(nanoseconds(stamp), 10**9)
    return Message("std_msgs/Header", {
        "stamp": Message(TIME, {"sec": seconds, "nanosec": rest}), "frame_id": frame})


def _pose(pose: Pose) -> Message:
    place = Message("geometry_msgs/Point", {"x": pose.x, "y": pose.y, "z": 0.0})
    return Message("geometry_msgs/PoseWithCovariance", {
        "pose": Message("geometry_msgs/Pose", {"position": place,
                                               "orientation": _turned(pose.yaw)}),
        "covariance": planar_covariance(pose.cov)})


def _vector(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Message:
    return Message("geometry_msgs/Vector3", {"x": x, "y": y, "z": z})


def _turned(yaw: float) -> Message:
    return Message("geometry_msgs/Quaternion", {
        "x": 0.0, "y": 0.0, "z": sin(0.5 * yaw), "w": cos(0.5 * yaw)})
