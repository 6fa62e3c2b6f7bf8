"""CDR serialisation (little-endian XCDR1) of the few messages of a run.

Every layout is fixed except for its end (bytes, texts, numbers), so one ``struct`` per message is
enough. Alignment counts from the end of the 4-byte header.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, prod, sin
from struct import Struct

import numpy as np

from dart_hal.core.types import Applied, ExternalPose, FloatArray, Image, Scan, State, nanoseconds
from dart_hal.recording import stamp

# Representation header: XCDR1, little-endian, no options.
HEADER = b"\x00\x01\x00\x00"
_U32 = Struct("<I")
# Rows of x, y and yaw among x, y, z, roll, pitch, yaw.
_PLANE = (0, 1, 5)
# Variance of the components that planar odometry does not estimate (z, roll, pitch).
_UNKNOWN_VARIANCE = 1e6


def _encode_text(value: str, offset: int, align: int) -> bytes:
    """Encode a string at an offset, padded so that the next field is aligned."""
    raw = value.encode() + b"\0"
    end = offset + 4 + len(raw)
    return _U32.pack(len(raw)) + raw + bytes(-end % align)


def _stamp(t: float, zero_ns: int) -> tuple[int, int]:
    """Return (s, ns) since 1970 of a time of the car's clock, which was 0 at ``zero_ns``."""
    return divmod(stamp.split(t)[0] + zero_ns, 10**9)


_ODOM_IDS = _encode_text("odom", 8, 4)
_ODOM_IDS += _encode_text("base_link", 8 + len(_ODOM_IDS), 8)
_IMU_ID = _encode_text("base_link", 8, 8)
_DRIVE_ID = _encode_text("base_link", 8, 4)
_ODOMETRY = Struct(f"<4siI{len(_ODOM_IDS)}s85d")
_IMU = Struct(f"<4siI{len(_IMU_ID)}s37d")
_DRIVE = Struct(f"<4siI{len(_DRIVE_ID)}s5f")
_BYTES = Struct("<4sIII")
_COMMAND = Struct("<4s2d")
_APPLIED = Struct("<4s4dI")
_FLOAT = Struct("<4sd")
_DIMENSION = Struct("<I4sII")  # an empty label with its padding, size, stride
_TIME_STRUCT = Struct("<iI")
_POSE_STRUCT = Struct("<43d")
_SCAN = Struct("<4s3d")
_TIMED = Struct("<4siI")
_IMAGE_IDS = _encode_text("camera", 8, 4)
_IMAGE_IDS += _encode_text("jpeg", 8 + len(_IMAGE_IDS), 4)


def encode_byte_array(data: bytes) -> bytes:
    """Encode std_msgs/UInt8MultiArray without a layout."""
    return _BYTES.pack(HEADER, 0, 0, len(data)) + data


def decode_byte_array(payload: bytes) -> bytes:
    """Decode ``encode_byte_array``. Raises ValueError if the length does not fit."""
    *_, length = _BYTES.unpack_from(payload)
    if length != len(payload) - _BYTES.size:
        raise ValueError(f"{length} bytes announced, {len(payload) - _BYTES.size} there")
    return payload[_BYTES.size:]


def decode_string(payload: bytes) -> str:
    """Decode std_msgs/String, the type of commands and pulses until format 3."""
    return payload[8:-1].decode()


def encode_command(steering: float, throttle: float, source: str) -> bytes:
    """Encode dart_msgs/Command."""
    return _COMMAND.pack(HEADER, steering, throttle) + _encode_texts([source])


def decode_command(payload: bytes) -> tuple[float, float, str]:
    """Decode ``encode_command``. Raises ValueError or struct.error for a wrong length."""
    _, steering, throttle = _COMMAND.unpack_from(payload)
    (source,) = _decode_texts(payload[_COMMAND.size:], 1)
    return steering, throttle, source


def encode_applied(value: Applied) -> bytes:
    """Encode dart_msgs/Applied."""
    limited = [str(name) for name in value.limited]
    return _APPLIED.pack(HEADER, value.steering, value.throttle, value.steering_us,
                         value.throttle_us, len(limited)) + _encode_texts(limited)


def decode_applied(payload: bytes) -> Applied:
    """Decode ``encode_applied``. Raises ValueError or struct.error for a wrong length."""
    _, steering, throttle, steering_us, throttle_us, count = _APPLIED.unpack_from(payload)
    return Applied(steering, throttle, steering_us, throttle_us,
                   _decode_texts(payload[_APPLIED.size:], count))


def _encode_texts(values: Sequence[str]) -> bytes:
    """Encode strings one after the other, from an offset that is a multiple of 4."""
    out = b""
    for value in values:
        raw = value.encode() + b"\0"
        out += bytes(-len(out) % 4) + _U32.pack(len(raw)) + raw
    return out


def _decode_texts(data: bytes, count: int) -> tuple[str, ...]:
    """Decode ``_encode_texts``. Raises ValueError or struct.error for a wrong length."""
    found = []
    at = 0
    for _ in range(count):
        # Padding to a multiple of 4 before each length, as XCDR1 aligns it.
        at += -at % 4
        (length,) = _U32.unpack_from(data, at)
        at += _U32.size + length
        if not length or at > len(data):
            raise ValueError(f"a text of {length} bytes, {len(data)} there")
        found.append(data[at - length:at - 1].decode())
    if at != len(data):
        raise ValueError(f"{len(data) - at} bytes too many")
    return tuple(found)


def encode_number(value: float) -> bytes:
    """Encode std_msgs/Float64."""
    return _FLOAT.pack(HEADER, value)


def decode_number(payload: bytes) -> float:
    """Decode ``encode_number``. Raises struct.error if the length does not fit."""
    value: float
    _, value = _FLOAT.unpack(payload)
    return value


def encode_numbers(values: FloatArray) -> bytes:
    """Encode std_msgs/Float64MultiArray, row by row, with the shape in its layout."""
    shape = values.shape
    layout = _U32.pack(len(shape)) + b"".join(
        _DIMENSION.pack(1, b"", size, prod(shape[i:])) for i, size in enumerate(shape))
    body = layout + bytes(4) + _U32.pack(values.size)
    gap = bytes(-len(body) % 8) if values.size else b""
    return HEADER + body + gap + values.astype("<f8").tobytes()


def decode_numbers(payload: bytes) -> FloatArray:
    """Decode ``encode_numbers``. Raises ValueError or struct.error for a wrong length."""
    (rank,) = _U32.unpack_from(payload, 4)
    shape = [_DIMENSION.unpack_from(payload, 8 + i * _DIMENSION.size)[2] for i in range(rank)]
    at = 8 + rank * _DIMENSION.size + 8  # after data_offset and the count
    at += -(at - 4) % 8 if prod(shape) else 0
    return np.frombuffer(payload[at:], "<f8").reshape(shape).astype(np.float64)


def encode_odometry(state: State, zero_ns: int = 0) -> bytes:
    """Encode nav_msgs/Odometry: pose of the rear axle in ``odom``, speed in ``base_link``."""
    pose = state.pose
    half = 0.5 * state.pose.yaw
    return _ODOMETRY.pack(
        HEADER, *_stamp(state.t, zero_ns), _ODOM_IDS,
        pose.x, pose.y, 0.0, 0.0, 0.0, sin(half), cos(half),
        *planar_covariance(pose.cov), state.speed, 0.0, 0.0, 0.0, 0.0, state.yaw_rate or 0.0,
        *twist_covariance(state))


def planar_covariance(cov: FloatArray) -> list[float]:
    """Return the covariance of x, y, yaw (3, 3) as the 36 numbers of ROS, row by row.

    Those are of x, y, z, roll, pitch, yaw.
    """
    covariance = [0.0] * 36
    for i, row in enumerate(_PLANE):
        for j, column in enumerate(_PLANE):
            covariance[6 * row + column] = float(cov[i, j])
    for diagonal in (14, 21, 28):
        covariance[diagonal] = _UNKNOWN_VARIANCE
    return covariance


def twist_covariance(state: State) -> list[float]:
    """Return the 36 numbers of a twist of which only the speed is known."""
    covariance = [0.0] * 36
    covariance[0] = state.speed_std**2
    for diagonal in (7, 14, 21, 28, 35):
        covariance[diagonal] = _UNKNOWN_VARIANCE
    return covariance


def encode_imu(state: State, zero_ns: int = 0) -> bytes | None:
    """Encode sensor_msgs/Imu in body axes; None while the IMU has no valid sample."""
    if state.yaw_rate is None or state.accel_x is None or state.accel_y is None:
        return None
    unknown = (-1.0, *[0.0] * 8)
    return _IMU.pack(HEADER, *_stamp(state.t, zero_ns), _IMU_ID, 0.0, 0.0, 0.0, 1.0, *unknown,
                     0.0, 0.0, state.yaw_rate, *[0.0] * 9,
                     state.accel_x, state.accel_y, 0.0, *[0.0] * 9)


def encode_drive(state: State, zero_ns: int = 0) -> bytes:
    """Encode ackermann_msgs/AckermannDriveStamped with the applied steering angle."""
    return _DRIVE.pack(HEADER, *_stamp(state.t, zero_ns), _DRIVE_ID, state.applied.steering, 0.0,
                       state.speed, 0.0, 0.0)


def encode_external_pose(pose: ExternalPose) -> bytes:
    """Encode geometry_msgs/PoseWithCovarianceStamped: marker frame, with the source's stamp."""
    name = _encode_text(pose.frame, 8, 8)
    half = 0.5 * pose.yaw
    return (HEADER + _TIME_STRUCT.pack(*divmod(nanoseconds(pose.stamp), 10**9)) + name
            + _POSE_STRUCT.pack(pose.x, pose.y, 0.0, 0.0, 0.0, sin(half), cos(half),
                         *planar_covariance(pose.cov)))


def decode_external_pose(payload: bytes, arrival: float) -> ExternalPose:
    """Decode ``encode_external_pose``. Raises ValueError or struct.error for other bytes."""
    seconds, rest = _TIME_STRUCT.unpack_from(payload, len(HEADER))
    (length,) = _U32.unpack_from(payload, len(HEADER) + _TIME_STRUCT.size)
    at = len(HEADER) + _TIME_STRUCT.size + _U32.size
    frame = payload[at:at + length - 1].decode()
    at += length
    at += -(at - len(HEADER)) % 8
    x, y, _, _, _, z, w, *covariance = _POSE_STRUCT.unpack_from(payload, at)
    cov = np.array(covariance).reshape(6, 6)[np.ix_(_PLANE, _PLANE)]
    cov.setflags(write=False)
    return ExternalPose((seconds * 10**9 + rest) / 10**9, arrival, x, y, 2.0 * atan2(z, w), cov,
                        frame)


def encode_image(value: Image, zero_ns: int = 0) -> bytes:
    """Encode sensor_msgs/CompressedImage, stamped with the time of exposure."""
    taken = divmod(round(value.t * 1e9) + zero_ns, 10**9)
    return (_TIMED.pack(HEADER, *taken) + _IMAGE_IDS + _U32.pack(len(value.jpeg)) + value.jpeg)


def decode_image(payload: bytes, arrival: float, zero_ns: int = 0) -> Image:
    """Decode ``encode_image``. Raises ValueError or struct.error for other bytes."""
    _, seconds, rest = _TIMED.unpack_from(payload)
    at = _TIMED.size + len(_IMAGE_IDS)
    (length,) = _U32.unpack_from(payload, at)
    if payload[_TIMED.size:at] != _IMAGE_IDS or at + _U32.size + length != len(payload):
        raise ValueError(f"{len(payload)} bytes that are no image of a car")
    return Image(arrival, (seconds * 10**9 + rest - zero_ns) / 1e9, payload[at + _U32.size:])


def encode_scan(value: Scan) -> bytes:
    """Encode dart_msgs/LidarScan as received; the mounting is in the files of the car."""
    columns = (value.after, value.angle, value.distance)
    return _SCAN.pack(HEADER, value.start, value.std, value.rate) + b"".join(
        _U32.pack(len(c)) + c.astype("<f4").tobytes() for c in columns)


def decode_scan(payload: bytes, arrival: float) -> Scan:
    """Decode ``encode_scan``. Raises ValueError or struct.error for other bytes."""
    _, start, std, rate = _SCAN.unpack_from(payload)
    columns = []
    at = _SCAN.size
    for _ in range(3):
        (count,) = _U32.unpack_from(payload, at)
        columns.append(np.frombuffer(payload, "<f4", count, at + _U32.size))
        at += _U32.size + 4 * count
    if at != len(payload):
        raise ValueError(f"{len(payload) - at} bytes too many")
    after, angle, distance = columns
    return Scan(arrival, start, rate, after, angle, distance, std)
