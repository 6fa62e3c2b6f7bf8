"""What is published of a car: topics, numbers, and bytes that other programs' decoders read."""

from __future__ import annotations

from dataclasses import replace
from math import isnan, tan

import pytest
from ros_types import classes_of
from toy_ros import BridgedCar, ToyRos

from dart_hal.car import Car
from dart_hal.recording import cdr, stamp
from dart_lab.live.ros.bridge import Bridge
from dart_lab.live.ros.messages import battery_state, build_object, odometry
from dart_lab.live.ros.told import TopicWriter


@pytest.fixture(scope="module")
def driven():
    """Car 3 after 1.5 s of a left turn, with a motion capture; its States."""
    with BridgedCar("sim://?nano=mock&seed=1&mocap=1", number=3) as car:
        car.states = []
        car.car.on_state(car.states.append)

        def each(t):
            if t > 0.1:
                car.ros.publish_value("safety_value", 1.0)
                car.ros.publish_value("throttle_3", 0.25)
                car.ros.publish_value("steering_3", 0.5)

        car.run(1.5, each)
        yield car


@pytest.mark.slow
def test_the_topics_are_those_of_upstream(driven):
    assert driven.ros.heard.keys() == {"safety_value", "throttle_3", "steering_3"}
    assert driven.ros.advertised.keys() == {
        "sensors_and_input_3", "arduino_data_3", "odom_3", "/tf", "vicon/jetracer3", "vx_3",
        "vy_3", "omega_3", "commands_timestamped_car_3", "/clock"}


@pytest.mark.slow
@pytest.mark.parametrize("battery", [True, False])
def test_the_battery_has_a_topic_where_it_is_measured(battery):
    with BridgedCar(f"sim://?nano=mock&seed=1&battery={battery:d}", number=3) as car:
        car.run(1.0, lambda _t: None)
    sent = [m.fields for topic, m in car.ros.published if topic == "battery_3"]
    assert ("battery_3" in car.ros.advertised) is bool(sent) is battery
    voltage = car.ros.last("sensors_and_input_3").fields["data"][2]
    assert voltage == pytest.approx(8.2 if battery else 0.0, abs=0.4)
    if battery:
        assert sent[-1]["voltage"] == voltage
        assert isnan(sent[-1]["current"])
        for store in ("ROS1_NOETIC", "ROS2_HUMBLE"):
            class_of, _ = classes_of(store)
            assert build_object(battery_state(8.0, 1.0), class_of).voltage == 8.0


@pytest.mark.slow
def test_a_real_car_leaves_the_motion_capture_to_others(driven):
    writer = TopicWriter(3, 0.09, simulated=False)
    names = {topic for topic, _ in writer.messages(driven.states[-1], (0.0, 0.0, 0.0), 0.0)}
    assert names == {"sensors_and_input_3", "arduino_data_3", "odom_3", "/tf"}


@pytest.mark.slow
def test_sensors_are_in_upstreams_order(driven):
    data = driven.ros.last("sensors_and_input_3").fields["data"]
    state = driven.states[-1]
    assert len(data) == 10
    assert data[1:3] == [0.0, 0.0]
    assert data[3:7] == [state.accel_x, state.accel_y, state.yaw_rate, state.speed]
    assert data[7:] == [1.0, 0.25, 0.5], "safety, throttle and steering as they were sent"
    assert driven.ros.last("arduino_data_3").fields["data"] == data[3:7]
    assert state.speed > 0.3
    assert state.yaw_rate > 0.1, "left is positive"


@pytest.mark.slow
def test_every_sample_is_published(driven):
    times = [m.fields["data"][0] for name, m in driven.ros.published
             if name == "sensors_and_input_3"]
    assert len(times) == pytest.approx(100.0 * times[-1], abs=2)
    assert times == sorted(times)
    poses = [m for name, m in driven.ros.published if name == "vicon/jetracer3"]
    assert len(poses) == pytest.approx(100.0 * times[-1], rel=0.1), "each pose once"
    frames = {link.fields["header"].fields["frame_id"] for name, m in driven.ros.published
              if name == "/tf" for link in m.fields["transforms"]}
    assert poses[-1].fields["header"].fields["frame_id"] in frames, "no transform leads to it"


@pytest.mark.slow
def test_the_simulators_topics_are_the_motion_of_the_centre_of_mass(driven):
    vx, vy, omega = (driven.ros.last(f"{name}_3").fields["data"] for name in ("vx", "vy", "omega"))
    state = driven.states[-1]
    l_r = driven.car.files.config.geometry.l_r
    assert (vx, omega) == (state.speed, state.yaw_rate)
    assert vy == pytest.approx(omega * l_r)
    assert vy / vx == pytest.approx(tan(state.applied.steering) * l_r / 0.175, rel=0.3)


def test_what_the_imu_cannot_measure_is_no_number():
    with BridgedCar("sim://?nano=mock&seed=1") as car:
        state = next(car.car.states())
        writer = TopicWriter(1, 0.09, simulated=False)
        blind = replace(state, accel_x=None, accel_y=None, yaw_rate=None)
        data = dict(writer.messages(blind, (0.0, 0.0, 0.0), 0.0))["arduino_data_1"].fields["data"]
    assert [isnan(value) for value in data] == [True, True, True, False]


def test_a_recording_is_published_and_not_driven(tmp_path):
    with Car.open("sim://?nano=mock&seed=1", record=tmp_path / "run.mcap") as car:
        speeds = [state.speed for state in car.states(duration=0.3)]
    ros = ToyRos()
    with Car.open(f"replay://{tmp_path / 'run.mcap'}") as car:
        Bridge(car, 1, ros, print).run(car.arming(), car.states())
    values = [m.fields["data"][6] for name, m in ros.published if name == "sensors_and_input_1"]
    assert len(values) == len(speeds)


# -- the same messages as bytes, by the classes and the decoder of others --------------------------


TOPICS = ["sensors_and_input_3", "arduino_data_3", "odom_3", "/tf", "vicon/jetracer3", "vx_3"]


@pytest.mark.slow
@pytest.mark.parametrize("topic", TOPICS)
@pytest.mark.parametrize("store_name", ["ROS2_HUMBLE", "ROS1_NOETIC"])
def test_each_message_fits_the_types_of_ros(driven, topic, store_name):
    class_of, store = classes_of(store_name)
    message = driven.ros.last(topic)
    made = build_object(message, class_of)
    kind = made.__msgtype__
    assert kind.replace("/msg", "") == message.kind
    pack, unpack = ((store.serialize_cdr, store.deserialize_cdr) if store_name.startswith("ROS2")
                    else (store.serialize_ros1, store.deserialize_ros1))
    data = bytes(pack(made, kind))
    again = unpack(data, kind)
    assert bytes(pack(again, kind)) == data


@pytest.mark.slow
def test_odometry_is_to_the_byte_the_recorders(driven):
    """The recorder's CDR is decoded by mcap-ros2-support, rosbags and cyclonedds; only the frames'
    names differ."""
    class_of, store = classes_of("ROS2_HUMBLE")
    state = driven.states[-1]
    whole = stamp.split(state.t)[0] / 1e9  # whole ns, as the recorder keeps them
    made = build_object(odometry(state, whole, "odom", "base_link"), class_of)
    assert bytes(store.serialize_cdr(made, "nav_msgs/msg/Odometry")) == cdr.encode_odometry(state)
