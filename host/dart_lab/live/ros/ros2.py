"""ROS 2 middleware: an rclpy node. Tests use a fake, because rclpy is no Python package."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from dart_hal.core.errors import UsageError
from dart_lab.live.ros.messages import RosMessage, build_object
from dart_lab.live.ros.ros1 import MAX_QUEUED_MESSAGES, class_of


class Ros2:
    """Middleware on an rclpy node. Raises UsageError without rclpy."""

    def __init__(self, name: str) -> None:
        try:
            import rclpy
            import sensor_msgs.msg  # noqa: F401 - missing ones are reported before the car moves
            import tf2_msgs.msg  # noqa: F401
            from rclpy.qos import DurabilityPolicy, QoSProfile
            from rclpy.signals import SignalHandlerOptions
        except ImportError as why:
            raise UsageError(
                "the bridge needs ROS 2", found=f"no Python package {why.name}",
                expected="rclpy, sensor_msgs and tf2_msgs where this Python finds them",
                remedy="source /opt/ros/humble/setup.bash ; docs/how_to/ros.md") from why
        # Ctrl-C is handled by the car, which it stops.
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self._rclpy = rclpy
        # Subscribers of /tf_static and /map use the same one.
        self._latched_quality = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._node = rclpy.create_node(name)
        self._publishers: dict[str, Any] = {}
        threading.Thread(target=rclpy.spin, args=(self._node,), name="ros2", daemon=True).start()

    @property
    def is_closed(self) -> bool:
        return not self._rclpy.ok()

    def subscribe(self, topic: str, heard: Callable[[float], None]) -> None:
        self._node.create_subscription(class_of("std_msgs/Float32"), topic,
                                       lambda message: heard(message.data), 1)

    def advertise(self, topic: str, kind: str, latched: bool) -> None:
        quality = self._latched_quality if latched else MAX_QUEUED_MESSAGES
        self._publishers[topic] = self._node.create_publisher(class_of(kind), topic, quality)

    def publish(self, topic: str, message: RosMessage) -> None:
        if not self.is_closed:
            self._publishers[topic].publish(build_object(message, class_of))

    def close(self) -> None:
        self._rclpy.try_shutdown()
