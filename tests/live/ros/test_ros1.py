"""A real master and rospy: DART's own nodes, and one of the same interface, drive the car."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from functools import partial
from math import cos, hypot, sin
from pathlib import Path

import pytest
from ros_world import (
    DEBIAN,
    MISSING,
    PAUSES_S,
    RosWorld,
    is_installed,
    one_ended,
    until,
    upstream_nodes,
)

from dart_lab.sim.lidar.maps import room_of

pytestmark = [pytest.mark.slow, pytest.mark.realtime]

SILENCE_LIMIT_S = 0.5
"""s from the last safety_value to the end of the last driving pulse."""


@pytest.fixture
def world(tmp_path):
    if not is_installed():
        pytest.skip(MISSING)
    with RosWorld(tmp_path) as made:
        yield made


def check(result, pins):
    """Rates, speed, and the pin after the silence of safety_value alone.

    On a busy computer the bridge skips States, 100 Hz otherwise; each that it takes is a message.
    """
    driving = [t for t, us in pins["pulses"] if abs(us - 1500.0) > 5.0]
    speeds = [v for t, v in pins["speeds"] if result["began"] <= t < result["silent"]]
    states = len(speeds) / (result["silent"] - result["began"])
    late = max(driving) - result["silent"]
    print(f"sensors {result['rate']:.1f} Hz of {states:.1f}, speed {result['speed']:.3f} m/s, "
          f"truly {sum(speeds) / len(speeds):.3f}, neutral {late:.3f} s behind the last "
          f"safety_value, "
          f"stamps {1e3 * result['stamp_age']:.0f} ms old, {pins['said']}")
    assert states < 102.0
    assert result["rate"] == pytest.approx(states, rel=0.02)
    assert {k: round(v / states, 1) for k, v in result["counts"].items()} == dict.fromkeys(
        ("odom_1", "/tf", "vx_1", "arduino_data_1", "vicon/jetracer1"), 1.0)
    assert result["speed"] == pytest.approx(1.0, rel=0.15)
    assert set(result["gate"]) == {1.0}
    assert any(t > result["silent"] for t in driving), "it drove until then"
    assert late <= SILENCE_LIMIT_S
    assert result["after"] == 0.0
    assert result["stamp_age"] < 0.5
    assert result["frames"] == ["odom_1", "base_link_1", "base_link_1"]
    assert pins["said"][-1].startswith("safety_value has been silent for 0.3 s: neutral")


def test_a_node_of_upstreams_interface_drives(world):
    result, pins = world.drive("own")
    check(result, pins)
    assert result["yaw_rate"] > 0.2, "left"


def test_upstreams_own_nodes_drive_unchanged(world):
    folder = upstream_nodes()
    if folder is None:
        pytest.skip("DART's two nodes are not here ($DART_UPSTREAM_ROS)")
    for name in ("v_tracking_controller.py", "steering_angle_2_command.py"):
        world.start(folder / name)
    check(*world.drive("upstream"))


def test_tf2_has_the_lidar_in_the_map_at_the_stamp_of_each_scan(world, tmp_path):
    """A node that subscribes later gets map and mounting too. The car is at rest."""
    if not (Path(DEBIAN) / "tf2_ros").is_dir():
        pytest.skip("no tf2_ros: make ros")
    verb = [Path(sys.executable).parent / "dart-hal", "bridge", "ros1", "--url",
            "sim://?nano=mock&seed=4&lidar=1&map=room", "--poses", "lidar", "--waive",
            "CALIBRATION_MISSING", "--duration", "40"]
    for pause in PAUSES_S:  # as RosWorld.drive
        time.sleep(pause)
        with (tmp_path / "bridge.log").open("wb") as log:
            bridge = subprocess.Popen(verb, env=world.env, stdout=log, stderr=log)
            try:
                node = world.start(Path(__file__).parent / "slam_node.py", tmp_path / "scans.json")
                until(partial(one_ended, bridge, node), 90.0)
            finally:
                bridge.terminate()
                bridge.wait(20)
        output = (tmp_path / "bridge.log").read_text() + (tmp_path / "slam_node.py.log").read_text()
        if "LINK_" not in output:
            break
        node.terminate()
    assert node.returncode == 0, output
    result = json.loads((tmp_path / "scans.json").read_text())
    rows = result["rows"]
    x, y, yaw = room_of("room", 4).start
    print(result)
    assert len(rows) == 10, output
    assert result["latched"] == ["laser_1"]
    assert min(result["map"]) > 150, "cells of a room of 6 x 5 m"
    assert {row[2] for row in rows} == {result["first"]}
    for at_x, at_y, _, age in rows:
        reach = hypot(at_x - x, at_y - y)
        assert reach == pytest.approx(0.13, abs=0.04), "the lidar is before the rear axle"
        assert (at_x - x) * cos(yaw) + (at_y - y) * sin(yaw) > 0.9 * reach
        assert 0.0 < age < 0.5


def test_the_verb_without_and_with_a_master(world):
    verb = [Path(sys.executable).parent / "dart-hal", "bridge", "ros1", "--url",
            "sim://?nano=mock&seed=1", "--duration", "0.5"]
    for _ in range(5):  # as RosWorld.drive
        done = subprocess.run(verb, env=world.env, capture_output=True, text=True, timeout=60)
        if "LINK_" not in done.stderr:
            break
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("0.00 m in ")
    done = subprocess.run(verb, env={**world.env, "ROS_MASTER_URI": "http://127.0.0.1:1"},
                          capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "no ROS master answers" in done.stderr
    assert "roscore" in done.stderr
