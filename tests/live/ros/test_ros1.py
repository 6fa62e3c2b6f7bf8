"""A real master and rospy: DART's own nodes, and one of the same interface, drive the car."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from ros_world import MISSING, RosWorld, is_installed, upstream_nodes

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
