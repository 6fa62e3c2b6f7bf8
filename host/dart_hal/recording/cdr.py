"""Hand-made CDR (little-endian XCDR1) of the few messages that a run holds.

Every layout is fixed but for the payload of byte arrays and strings, so one
``struct`` per message does. Alignment counts from behind the 4-byte header.
"""

from __future__ import annotations

from math import atan2, cos, sin
from struct import Struct

import numpy as np

from dart_hal.types import ExternalPose, State, nanoseconds

HEADER = b"\x00\x01\x00\x00"
_U32 = Struct("<I")
_PLANE = (0, 1, 5)
"""Rows of x, y and yaw among x, y, z, roll, pitch, yaw."""
_UNKNOWN = 1e6
"""Variance of what two-dimensional odometry does not say (z, roll, pitch)."""


def _text(value: str, at: int, align: int) -> bytes:
    """A string at offset ``at``, padded so that what follows is aligned."""
    raw = value.encode() + b"\0"
    end = at + 4 + len(raw)
    return _U32.pack(len(raw)) + raw + bytes(-end % align)


def _stamp(t: float) -> tuple[int, int]:
    return divmod(round(t * 1e9), 10**9)


_ODOM_IDS = _text("odom", 8, 4)
_ODOM_IDS += _text("base_link", 8 + len(_ODOM_IDS), 8)
_IMU_ID = _text("base_link", 8, 8)
_DRIVE_ID = _text("base_link", 8, 4)
_ODOMETRY = Struct(f"<4siI{len(_ODOM_IDS)}s85d")
_IMU = Struct(f"<4siI{len(_IMU_ID)}s37d")
_DRIVE = Struct(f"<4siI{len(_DRIVE_ID)}s5f")
_BYTES = Struct("<4sIII")
_TIME = Struct("<iI")
_POSE = Struct("<43d")


def byte_array(data: bytes) -> bytes:
    """std_msgs/UInt8MultiArray without a layout."""
    return _BYTES.pack(HEADER, 0, 0, len(data)) + data


def byte_array_of(payload: bytes) -> bytes:
    """Inverse of ``byte_array``; raises ValueError when the length does not fit."""
    *_, length = _BYTES.unpack_from(payload)
    if length != len(payload) - _BYTES.size:
        raise ValueError(f"{length} bytes announced, {len(payload) - _BYTES.size} there")
    return payload[_BYTES.size:]


def string(value: str) -> bytes:
    """std_msgs/String."""
    raw = value.encode() + b"\0"
    return HEADER + _U32.pack(len(raw)) + raw


def string_of(payload: bytes) -> str:
    """Inverse of ``string``."""
    return payload[8:-1].decode()


def odometry(state: State) -> bytes:
    """nav_msgs/Odometry: pose of the rear axle in ``odom``, speed in ``base_link``."""
    pose, cov = state.pose, state.pose.cov
    half = 0.5 * pose.yaw
    spread = [0.0] * 36
    for i, row in enumerate(_PLANE):
        for j, column in enumerate(_PLANE):
            spread[6 * row + column] = float(cov[i, j])
    spread[14] = spread[21] = spread[28] = _UNKNOWN
    twist = [0.0] * 36
    twist[0] = state.speed_std**2
    twist[7] = twist[14] = twist[21] = twist[28] = twist[35] = _UNKNOWN
    return _ODOMETRY.pack(
        HEADER, *_stamp(state.t), _ODOM_IDS, pose.x, pose.y, 0.0, 0.0, 0.0, sin(half), cos(half),
        *spread, state.speed, 0.0, 0.0, 0.0, 0.0, state.yaw_rate or 0.0, *twist)


def imu(state: State) -> bytes | None:
    """sensor_msgs/Imu in body axes; None while the IMU has no valid sample."""
    if state.yaw_rate is None or state.accel_x is None or state.accel_y is None:
        return None
    unknown = (-1.0, *[0.0] * 8)
    return _IMU.pack(HEADER, *_stamp(state.t), _IMU_ID, 0.0, 0.0, 0.0, 1.0, *unknown,
                     0.0, 0.0, state.yaw_rate, *[0.0] * 9,
                     state.accel_x, state.accel_y, 0.0, *[0.0] * 9)


def drive(state: State) -> bytes:
    """ackermann_msgs/AckermannDriveStamped: the steering angle that was applied."""
    return _DRIVE.pack(HEADER, *_stamp(state.t), _DRIVE_ID, state.applied.steering, 0.0,
                       state.speed, 0.0, 0.0)


def external_pose(pose: ExternalPose) -> bytes:
    """geometry_msgs/PoseWithCovarianceStamped: marker frame in the room, stamp of the source."""
    name = _text(pose.frame, 8, 8)
    spread = [0.0] * 36
    for i, row in enumerate(_PLANE):
        for j, column in enumerate(_PLANE):
            spread[6 * row + column] = float(pose.cov[i, j])
    spread[14] = spread[21] = spread[28] = _UNKNOWN
    half = 0.5 * pose.yaw
    return (HEADER + _TIME.pack(*divmod(nanoseconds(pose.stamp), 10**9)) + name
            + _POSE.pack(pose.x, pose.y, 0.0, 0.0, 0.0, sin(half), cos(half), *spread))


def external_pose_of(payload: bytes, arrival: float) -> ExternalPose:
    """Inverse of ``external_pose``. Raises ValueError or struct.error for other bytes."""
    seconds, rest = _TIME.unpack_from(payload, len(HEADER))
    (length,) = _U32.unpack_from(payload, len(HEADER) + _TIME.size)
    at = len(HEADER) + _TIME.size + _U32.size
    frame = payload[at:at + length - 1].decode()
    at += length
    at += -(at - len(HEADER)) % 8
    x, y, _, _, _, z, w, *spread = _POSE.unpack_from(payload, at)
    cov = np.array(spread).reshape(6, 6)[np.ix_(_PLANE, _PLANE)]
    cov.setflags(write=False)
    return ExternalPose((seconds * 10**9 + rest) / 10**9, arrival, x, y, 2.0 * atan2(z, w), cov,
                        frame)
