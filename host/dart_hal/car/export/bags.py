"""A run as a bag of ROS 2 or ROS 1: every message in the order of time, with its definition.

``standard`` adds what ROS tools need.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from dart_hal.car.export import standard
from dart_hal.car.table import missing_package_error
from dart_hal.recording.run import RunReader

_HEADER = "std_msgs/msg/Header"


def write_ros2(run: RunReader, path: Path) -> int:
    """Write a folder with an MCAP and its metadata.yaml, as ``ros2 bag``; return the messages.

    The facts of the run are in the custom data of the metadata. Raises UsageError without rosbags,
    RecordingError, OSError.
    """
    rosbags = _rosbags()
    store = _types_of(run, rosbags)
    with rosbags.rosbag2.Writer(path, version=9,
                                storage_plugin=rosbags.rosbag2.StoragePlugin.MCAP) as writer:
        writer.set_custom_data("dart_hal.run", json.dumps(run.meta))
        return _copy(run, writer, store, store, bytes)


def write_ros1(run: RunReader, path: Path) -> int:
    """Write a ``.bag`` of format 2.0; ``seq`` of a header, which ROS 2 does not have, is 0.

    Raises as ``write_ros2``.
    """
    rosbags = _rosbags()
    store = _types_of(run, rosbags)
    typesys = rosbags.typesys
    store1 = typesys.get_typestore(typesys.Stores.EMPTY)
    header = typesys.get_typestore(typesys.Stores.ROS1_NOETIC).fielddefs[_HEADER]
    store1.register({**store.fielddefs, _HEADER: header})
    with rosbags.rosbag1.Writer(path) as writer:
        return _copy(run, writer, store, store1, store.cdr_to_ros1)


def _copy(run: RunReader, writer: Any, types: Any, store: Any, converted: Any) -> int:
    """Write the messages to an open bag of ``store``; return their number.

    types: store of the run's types. converted(raw, type): bytes of a message in the bag.
    """
    connections: dict[str, Any] = {}
    count = 0
    for message in standard.messages(run, types):
        if message.topic not in connections:
            connections[message.topic] = writer.add_connection(message.topic, message.kind,
                                                               typestore=store)
        raw = message.data if converted is bytes else converted(message.data, message.kind)
        writer.write(connections[message.topic], message.ns, raw)
        count += 1
    return count


def _types_of(run: RunReader, rosbags: Any) -> Any:
    """Return a store with the definitions of the run."""
    store = rosbags.typesys.get_typestore(rosbags.typesys.Stores.EMPTY)
    for kind, text in run.definitions.items():
        store.register(rosbags.typesys.get_types_from_msg(text, kind))
    standard.add_types(store, rosbags.typesys.get_typestore(rosbags.typesys.Stores.ROS2_HUMBLE))
    return store


def _rosbags() -> Any:
    try:
        import rosbags
        import rosbags.rosbag1
        import rosbags.rosbag2
        import rosbags.typesys
    except ImportError as error:
        raise missing_package_error("rosbags", "a bag", extra="ros") from error
    return rosbags
