"""ROS 1: a rospy node."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from dart_hal.core.errors import UsageError
from dart_lab.live.ros.messages import TIME, Message, built

QUEUE = 10
"""Messages that wait for a slow reader, 0.1 s; then the oldest go."""


class Ros1:
    """A node of this name; a Middleware. Raises UsageError without rospy or a master."""

    def __init__(self, name: str) -> None:
        try:
            import nav_msgs.msg  # noqa: F401
            import rosgraph
            import rospy
            import tf2_msgs.msg  # noqa: F401 - what is missing is said before the car moves
        except ImportError as why:
            raise UsageError(
                "the bridge needs ROS 1", found=f"no Python package {why.name}",
                expected="rospy, nav_msgs and tf2_msgs where this Python finds them",
                remedy="sudo apt install python3-rospy python3-nav-msgs python3-tf2-msgs ; then "
                       "docs/how_to/ros.md"
            ) from why
        if not rosgraph.is_master_online():
            raise UsageError("no ROS master answers", found=rosgraph.get_master_uri(),
                             expected="a running roscore", remedy="roscore &")
        self._rospy = rospy
        self._ended = False
        self._publishers: dict[str, Any] = {}
        rospy.init_node(name, disable_signals=True)  # Ctrl-C is the car's

    @property
    def closed(self) -> bool:
        return self._ended or bool(self._rospy.is_shutdown())

    def subscribe(self, topic: str, heard: Callable[[float], None]) -> None:
        self._rospy.Subscriber(topic, self._class_of("std_msgs/Float32"),
                               lambda message: heard(message.data), queue_size=1)

    def advertise(self, topic: str, kind: str) -> None:
        self._publishers[topic] = self._rospy.Publisher(topic, self._class_of(kind),
                                                        queue_size=QUEUE)

    def publish(self, topic: str, message: Message) -> None:
        try:
            self._publishers[topic].publish(built(message, self._class_of))
        except self._rospy.ROSSerializationException:
            raise
        except self._rospy.ROSException:  # the topic is closed: somebody ends the node, and
            self._ended = True            # is_shutdown() comes behind that

    def close(self) -> None:
        self._rospy.signal_shutdown("the bridge ends")

    def _class_of(self, kind: str) -> Callable[..., Any]:
        return self._time if kind == TIME else class_of(kind)

    def _time(self, sec: int, nanosec: int) -> Any:
        return self._rospy.Time(sec, nanosec)


def class_of(kind: str) -> Callable[..., Any]:
    """The class of a message type, named alike in ROS 1 and ROS 2."""
    package, _, name = kind.partition("/")
    found: Callable[..., Any] = getattr(import_module(f"{package}.msg"), name)
    return found
