"""The message types of ROS by the package rosbags, and the bytes that it makes of them."""

from __future__ import annotations

import numpy as np
import pytest


def classes_of(store_name):
    """(kind -> class, serialise) of a distribution's message types, by the package rosbags."""
    rosbags = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed (.[ros])")
    store = rosbags.get_typestore(getattr(rosbags.Stores, store_name))
    added = rosbags.get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n",
                                       "tf2_msgs/msg/TFMessage")
    if "tf2_msgs/msg/TFMessage" not in store.types:
        store.register(added)

    def class_of(kind):
        package, _, name = kind.partition("/")
        made = store.types[f"{package}/msg/{name}"]

        def make(**fields):
            if kind == "std_msgs/Header" and store_name.startswith("ROS1"):
                fields["seq"] = 0
            arrays = {"data": np.int8 if kind == "nav_msgs/OccupancyGrid" else np.float32,
                      "covariance": np.float64, "ranges": np.float32, "intensities": np.float32}
            return made(**{k: np.array(v, arrays[k]) if isinstance(v, list) and k in arrays else v
                           for k, v in fields.items()})
        return make

    return class_of, store
