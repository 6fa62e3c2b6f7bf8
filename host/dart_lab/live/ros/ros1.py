"""ROS 1 middleware: a rospy node."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from dart_hal.core.errors import UsageError
from dart_lab.live.ros.messages import TIME_KIND, RosMessage, build_object

# Messages queued for a slow subscriber, 0.1 s; then the oldest are dropped.
MAX_QUEUED_MESSAGES = 10


class Ros1:
    """Middleware on a rospy node. Raises UsageError without rospy or a running master."""

    def __init__(self, name: str) -> None:
        try:
            import nav_msgs.msg  # noqa: F401
            import rosgraph
            import rosgraph_msgs.msg  # noqa: F401 - missing ones are reported before the car moves
            import rospy
            import sensor_msgs.msg  # noqa: F401
            import tf2_msgs.msg  # noqa: F401
        except ImportError as why:
            raise UsageError(
                "the bridge needs ROS 1", found=f"no Python package {why.name}",
                expected="rospy, nav_msgs, sensor_msgs and tf2_msgs where this Python finds them",
                remedy="sudo apt install python3-rospy python3-nav-msgs python3-sensor-msgs "
                       "python3-tf2-msgs ; then docs/how_to/ros.md"
            ) from why
        if not rosgraph.is_master_online():
            raise UsageError("no ROS master answers", found=rosgraph.get_master_uri(),
                             expected="a running roscore", remedy="roscore &")
        self._rospy = rospy
        self._ended = False
        self._publishers: dict[str, Any] = {}
        # Ctrl-C is handled by the car, which it stops.
        rospy.init_node(name, disable_signals=True)

    @property
    def is_closed(self) -> bool:
        return self._ended or bool(self._rospy.is_shutdown())

    def subscribe(self, topic: str, heard: Callable[[float], None]) -> None:
        self._rospy.Subscriber(topic, self._class_of("std_msgs/Float32"),
                               lambda message: heard(message.data), queue_size=1)

    def advertise(self, topic: str, kind: str, latched: bool) -> None:
        self._publishers[topic] = self._rospy.Publisher(topic, self._class_of(kind), latch=latched,
                                                        queue_size=MAX_QUEUED_MESSAGES)

    def publish(self, topic: str, message: RosMessage) -> None:
        try:
            self._publishers[topic].publish(build_object(message, self._class_of))
        except self._rospy.ROSSerializationException:
            raise
        except self._rospy.ROSException:
            # The topic is closed: the node is being ended, is_shutdown() is not true yet.
            self._ended = True

    def close(self) -> None:
        self._rospy.signal_shutdown("the bridge ends")

    def _class_of(self, kind: str) -> Callable[..., Any]:
        return self._time if kind == TIME_KIND else class_of(kind)

    def _time(self, sec: int, nanosec: int) -> Any:
        return self._rospy.Time(sec, nanosec)


def class_of(kind: str) -> Callable[..., Any]:
    """Return the class of a message type; ROS 1 and ROS 2 use the same names."""
    package, _, name = kind.partition("/")
    found: Callable[..., Any] = getattr(import_module(f"{package}.msg"), name)
    return found
