"""The rclpy node with classes and CDR of rosbags behind a toy rclpy: rclpy itself was not run."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace

import pytest
from ros_types import classes_of

from dart_hal.core.errors import UsageError
from dart_hal.core.types import ExternalPose
from dart_hal.recording import cdr
from dart_lab.live.ros.messages import external_pose, number, numbers
from dart_lab.live.ros.ros1 import Ros1
from dart_lab.live.ros.ros2 import Ros2


class ToyNode:
    """Keeps the bytes of what is published."""

    def __init__(self, name, store):
        self.name = name
        self.store = store
        self.sent = {}
        self.heard = {}

    def create_subscription(self, kind, topic, callback, depth):
        self.heard[topic] = (kind, callback, depth)

    def create_publisher(self, kind, topic, depth):
        def publish(message):
            self.sent[topic] = bytes(self.store.serialize_cdr(message, message.__msgtype__))
        return SimpleNamespace(publish=publish, kind=kind, depth=depth)


@pytest.fixture
def rclpy(monkeypatch):
    class_of, store = classes_of("ROS2_HUMBLE")
    rclpy = ModuleType("rclpy")
    signals = ModuleType("rclpy.signals")
    signals.SignalHandlerOptions = SimpleNamespace(NO="no")
    state = SimpleNamespace(up=False, options=None)

    def init(signal_handler_options):
        state.up = True
        state.options = signal_handler_options

    rclpy.init = init
    rclpy.ok = lambda: state.up
    rclpy.spin = lambda node: None
    rclpy.create_node = lambda name: ToyNode(name, store)
    rclpy.try_shutdown = lambda: setattr(state, "up", False)
    qos = ModuleType("rclpy.qos")
    qos.DurabilityPolicy = SimpleNamespace(TRANSIENT_LOCAL="transient local")
    qos.QoSProfile = SimpleNamespace
    rclpy.state = state
    rclpy.store = store
    for name, module in (("rclpy", rclpy), ("rclpy.signals", signals), ("rclpy.qos", qos)):
        monkeypatch.setitem(sys.modules, name, module)
    for package in ("std_msgs", "geometry_msgs", "nav_msgs", "tf2_msgs", "sensor_msgs",
                    "builtin_interfaces"):
        messages = ModuleType(f"{package}.msg")
        messages.__getattr__ = lambda name, package=package: class_of(f"{package}/{name}")
        monkeypatch.setitem(sys.modules, package, ModuleType(package))
        monkeypatch.setitem(sys.modules, f"{package}.msg", messages)
    return rclpy


def test_what_is_published_is_the_cdr_of_ros_2(rclpy):
    node = Ros2("dart_hal_1")
    sent = node._node.sent
    pose = ExternalPose(5.0, 2.0, 1.0, -0.5, 0.3, frame="map")
    for topic, message in (("vx_1", number(0.25)), ("arduino_data_1", numbers((1.0, 2.0))),
                           ("vicon/jetracer1", external_pose(pose, pose.stamp))):
        node.advertise(topic, message.kind, False)
        node.publish(topic, message)
    assert sent["vx_1"] == bytes.fromhex("00010000" "0000803e")
    assert sent["arduino_data_1"] == bytes.fromhex(
        "00010000" "00000000" "00000000" "02000000" "0000803f" "00000040")
    assert sent["vicon/jetracer1"] == cdr.encode_external_pose(pose), "to the byte the recorder's"


def test_a_latched_topic_is_kept_for_later_subscribers(rclpy):
    node = Ros2("dart_hal_1")
    for topic, latched in (("/map", True), ("/tf", False)):
        node.advertise(topic, "std_msgs/Float32", latched)
    quality = node._publishers["/map"].depth
    assert (quality.depth, quality.durability) == (1, "transient local")
    assert node._publishers["/tf"].depth == 10


def test_what_is_received_is_the_number_and_the_end_is_detected(rclpy):
    node = Ros2("dart_hal_1")
    heard = []
    node.subscribe("throttle_1", heard.append)
    _, callback, depth = node._node.heard["throttle_1"]
    callback(rclpy.store.deserialize_cdr(bytes.fromhex("00010000" "0000803e"),
                                         "std_msgs/msg/Float32"))
    assert (heard, depth) == ([0.25], 1)
    assert rclpy.state.options == "no", "Ctrl-C stays the car's"
    assert not node.is_closed
    node.close()
    assert node.is_closed
    node.publish("without a listener", number(0.0))


@pytest.mark.parametrize(("node", "package"), [(Ros1, "rosgraph"), (Ros2, "rclpy")])
def test_without_ros_it_names_what_to_install(monkeypatch, node, package):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(UsageError, match="needs ROS") as why:
        node("dart_hal_1")
    assert "docs/how_to/ros.md" in why.value.remedy
