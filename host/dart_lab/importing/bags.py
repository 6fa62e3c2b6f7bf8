"""Topics of ROS 1 and ROS 2 bags and of MCAP files as tables."""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.car.table import missing_package_error
from dart_hal.core.errors import RecordingError
from dart_hal.core.types import FloatArray

from .tables import Table

# Elements of a list in a message that become columns; longer ones are images, scans, covariances.
MAX_LIST_LENGTH = 16
# Messages that bags of small cars often hold, for bags without definitions; those of ROS itself
# are known.
DEFINITIONS = {
    "ackermann_msgs/msg/AckermannDrive":
        "float32 steering_angle\nfloat32 steering_angle_velocity\nfloat32 speed\n"
        "float32 acceleration\nfloat32 jerk\n",
    "ackermann_msgs/msg/AckermannDriveStamped":
        "std_msgs/Header header\nackermann_msgs/AckermannDrive drive\n",
    "vesc_msgs/msg/VescState":
        "float64 voltage_input\nfloat64 temperature_pcb\nfloat64 current_motor\n"
        "float64 current_input\nfloat64 speed\nfloat64 duty_cycle\nfloat64 charge_drawn\n"
        "float64 charge_regen\nfloat64 energy_drawn\nfloat64 energy_regen\n"
        "float64 displacement\nfloat64 distance_traveled\nint32 fault_code\n",
    "vesc_msgs/msg/VescStateStamped": "std_msgs/Header header\nvesc_msgs/VescState state\n",
}

# (arrival [s], message) by topic and number of the connection, of which a publisher has one.
Rows = dict[tuple[str, int], list[tuple[float, Any]]]
# What readers raise for damaged or unusual files, besides errors of their own.
DAMAGE = (ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, OSError,
          TypeError, ValueError, struct.error)


def read_bag(path: Path) -> list[Table]:
    """Read each topic of a bag as a table.

    Columns are the numbers of a message by their path, as "pose.pose.position.x"; "stamp" [s] is
    that of the header, "arrival" [s] that of the recorder. A quaternion "pose.orientation" gives
    the column "pose.orientation.yaw" [rad] as well. Publishers that send on one topic at the same
    time give a table each: "topic#1", "topic#2".

    Raises RecordingError for a bag that cannot be read, UsageError without rosbags.
    """
    rows = _read_mcap(path) if path.suffix == ".mcap" else _read_rosbag(path)
    digest = _digest(path)
    tables = [_make_table(topic, messages, (str(path), digest))
              for topic, messages in _join_publishers(rows).items()]
    if not tables:
        raise RecordingError(f"{path}: no message in this bag", found="0 messages",
                             expected="topics with poses, commands or sensors", read=str(path),
                             remedy="leave this file out")
    return tables


def _digest(path: Path) -> str:
    files = [path] if path.is_file() else sorted(f for f in path.iterdir() if f.is_file())
    found = hashlib.sha256()
    for file in files:
        found.update(file.read_bytes())
    return found.hexdigest()


def _join_publishers(rows: Rows) -> dict[str, list[tuple[float, Any]]]:
    """Return the messages by topic; of publishers at the same time, by "topic#1", "topic#2".

    One that follows another is the same node after a restart.
    """
    by_topic: dict[str, list[list[tuple[float, Any]]]] = {}
    for (topic, _), messages in rows.items():
        by_topic.setdefault(topic, []).append(messages)
    joined = {}
    for topic, parts in by_topic.items():
        parts.sort(key=lambda part: part[0][0])
        if any(part[-1][0] > following[0][0] for part, following in pairwise(parts)):
            joined.update({f"{topic}#{k}": part for k, part in enumerate(parts, 1)})
        else:
            joined[topic] = [message for part in parts for message in part]
    return joined


def _store() -> Any:
    """Return the message types of ROS 2, and of DEFINITIONS."""
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError as error:
        raise missing_package_error("rosbags", "a ROS bag", "ros") from error
    store = get_typestore(Stores.ROS2_HUMBLE)
    types: dict[str, Any] = {}
    for name, text in DEFINITIONS.items():
        types |= get_types_from_msg(text, name)
    store.register(types)
    return store


def _read_rosbag(path: Path) -> Rows:
    store = _store()
    from rosbags.highlevel import AnyReader
    from rosbags.highlevel.anyreader import AnyReaderError
    from rosbags.rosbag1 import ReaderError
    from rosbags.serde import SerdeError
    from rosbags.typesys import TypesysError

    folder = path.parent if path.suffix == ".db3" else path
    rows: Rows = {}
    try:
        with AnyReader([folder], default_typestore=store) as reader:
            for connection, ns, raw in reader.messages():
                kept = rows.setdefault((connection.topic, connection.id), [])
                kept.append((1e-9 * ns, reader.deserialize(raw, connection.msgtype)))
    except (AnyReaderError, ReaderError, SerdeError, TypesysError, *DAMAGE) as why:
        raise _unreadable(path, why) from why
    return rows


def _read_mcap(path: Path) -> Rows:
    """Read the messages of an MCAP file: ROS 2, ROS 1 or JSON."""
    from mcap.exceptions import McapError
    from mcap.reader import make_reader
    from rosbags.serde import SerdeError
    from rosbags.typesys import TypesysError

    rows: Rows = {}
    decoders: dict[int, Callable[[bytes], Any] | None] = {}
    try:
        with path.open("rb") as file:
            for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
                if channel.id not in decoders:
                    decoders[channel.id] = _make_decoder(schema, channel)
                decode = decoders[channel.id]
                if decode is not None:
                    kept = rows.setdefault((channel.topic, channel.id), [])
                    kept.append((1e-9 * message.log_time, decode(message.data)))
    except (McapError, SerdeError, TypesysError, *DAMAGE) as why:
        raise _unreadable(path, why) from why
    return rows


def _make_decoder(schema: Any, channel: Any) -> Callable[[bytes], Any] | None:
    """Return what makes a message of bytes; None for a channel of images or unknown encoding."""
    if channel.message_encoding == "json":
        return json.loads
    if channel.message_encoding not in ("cdr", "ros1") or schema is None:
        return None
    store = _store()
    from rosbags.typesys import get_types_from_msg

    name = schema.name if "/msg/" in schema.name else schema.name.replace("/", "/msg/", 1)
    text = schema.data.decode(errors="replace")
    types = {key: value for key, value in get_types_from_msg(text, name).items()
             if key not in store.fielddefs}
    store.register(types)
    read = store.deserialize_cdr if channel.message_encoding == "cdr" else store.deserialize_ros1
    return lambda data: read(data, name)


def _unreadable(path: Path, why: Exception) -> RecordingError:
    missing = "definition" in str(why) or isinstance(why, KeyError)
    return RecordingError(
        f"{path}: this bag cannot be read", found=str(why)[:200] or type(why).__name__,
        read=str(path), expected="a whole bag with the definitions of its messages",
        likely="messages whose definitions are not in the bag" if missing else
        "a bag that was not closed, or that was copied badly",
        remedy="convert it where its message packages are installed: ros2 bag convert, to MCAP"
        if missing else "ros2 bag reindex, or rosbag reindex")


def _make_table(topic: str, messages: list[tuple[float, Any]], source: tuple[str, str]) -> Table:
    """Return a table of all numbers of the messages of a topic."""
    # A type has fixed fields but for its lists: its first message has all. A JSON object has not.
    objects = [message for _, message in messages if isinstance(message, Mapping)]
    paths = {path: read for message in objects or [messages[0][1]]
             for path, read in _find_numbers(message, "")}
    columns: dict[str, FloatArray] = {"arrival": np.array([t for t, _ in messages])}
    for name, read in paths.items():
        columns[name] = np.array([_read_number(read, message) for _, message in messages])
    # Seconds and nanoseconds of a stamp become one column; the message types name them differently.
    for prefix in ("header.stamp", "timestamp"):
        for second, part in (("sec", "nanosec"), ("sec", "nsec"), ("secs", "nsecs")):
            if f"{prefix}.{second}" in columns and f"{prefix}.{part}" in columns:
                columns["stamp"] = (columns.pop(f"{prefix}.{second}")
                                    + 1e-9 * columns.pop(f"{prefix}.{part}"))
    # Four columns x, y, z, w of one name are a quaternion: add its yaw, which maps refer to.
    for name in [n.removesuffix(".w") for n in columns if n.endswith(".w")]:
        if all(f"{name}.{axis}" in columns for axis in "xyz"):
            columns[f"{name}.yaw"] = quaternion_yaw(*(columns[f"{name}.{a}"] for a in "xyzw"))
    return Table(topic, columns, {}, source)


def quaternion_yaw(x: FloatArray, y: FloatArray, z: FloatArray, w: FloatArray) -> FloatArray:
    """Return the yaw angles (n,) [rad] of quaternions."""
    return np.asarray(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def _find_numbers(value: Any, path: str) -> Iterator[tuple[str, Callable[[Any], Any]]]:
    """Yield (path, function that reads it) of each number in a message."""
    if isinstance(value, bool | int | float | np.number):
        yield path, _make_reader(path)
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _find_numbers(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, np.ndarray | list | tuple):
        if len(value) <= MAX_LIST_LENGTH and all(
                isinstance(item, int | float | np.number) for item in value):
            for i in range(len(value)):
                yield f"{path}[{i}]", _make_reader(path, i)
    elif hasattr(value, "__dataclass_fields__"):
        for key in value.__dataclass_fields__:
            if not key.startswith("_"):
                inner = getattr(value, key)
                yield from _find_numbers(inner, f"{path}.{key}" if path else key)


def _make_reader(path: str, index: int | None = None) -> Callable[[Any], Any]:
    """Return a function that reads a path of a message, of a class or a JSON object."""
    get = attrgetter(path)
    parts = path.split(".")

    def read(message: Any) -> Any:
        if isinstance(message, Mapping):
            for part in parts:
                message = message[part]
        else:
            message = get(message)
        return message if index is None else message[index]

    return read


def _read_number(read: Callable[[Any], Any], message: Any) -> float:
    """Return a number of a message, NaN where a list is shorter or a key is missing."""
    try:
        return float(read(message))
    except (LookupError, TypeError, ValueError):
        return np.nan
