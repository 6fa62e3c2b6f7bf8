"""Shipped maps of cars with a VESC, from the import to a fit, on drives of another laboratory."""

from __future__ import annotations

import re

import numpy as np
import pytest

from dart_hal.car.runs import read_any
from dart_hal.cli.common.sizes import apply_car_sizes
from dart_hal.core.errors import RecordingError
from dart_hal.recording.imported import write_imported
from dart_hal.vehicle.load import find_model, vehicle_of
from dart_hal.vehicle.steering import make_steering
from dart_lab.identification.evaluation import evaluate
from dart_lab.identification.outcome import identify_jointly
from dart_lab.identification.write import SECTIONS, build_model
from dart_lab.importing import convert_tables, guess_map, load_map, read_tables
from dart_lab.importing.maps import parse_map
from dart_lab.importing.tables import Table

LOCK = 0.45  # rad of the command 1
SCALE = 5.3  # m/s of the command 1, and the speed limit of the slow drive
LIMIT = {"ds3": 1.3, "ds4": np.inf}


def make_topics(columns, limit):
    """Return the topics of f1tenth_system and of MuSHR with the columns of the recordings."""
    time = {"stamp": columns["vicon time"]}
    pose = {"position.x": columns["vicon x"], "position.y": columns["vicon y"],
            "orientation.yaw": columns["vicon yaw"]}
    drive = {**time, "drive.steering_angle": LOCK * columns["steering"],
             "drive.speed": np.clip(SCALE * columns["throttle"], -limit, limit)}
    odometry = {**time, "twist.twist.linear.x": columns["vel encoder"]}
    imu = {**time, "angular_velocity.z": columns["W (IMU)"],
           "linear_acceleration.x": -columns["acc y (IMU)"],
           "linear_acceleration.y": columns["acc x (IMU)"]}
    filtered = {f"pose.pose.{name}": values for name, values in pose.items()}
    filter_twist = {"twist.twist.linear.x": np.zeros(len(time["stamp"]))}
    return {"f1tenth": [Table("/pf/pose/odom", {**time, **filtered, **filter_twist}),
                        Table("/drive", drive), Table("/odom", odometry),
                        Table("/sensors/imu/raw", imu)],
            "mushr": [Table("/car/car_pose", {**time, **{f"pose.{n}": v for n, v in pose.items()}}),
                      Table("/car/mux/ackermann_cmd_mux/output", drive),
                      Table("/car/vesc/odom", odometry)]}


@pytest.fixture(scope="module")
def topics(other_cars):
    return {name: make_topics(read_tables(
        [other_cars / "f1tenth_upenn2022" / f"{name}.csv.gz"])[0].columns, limit)
        for name, limit in LIMIT.items()}


def with_lock(name):
    """Return the shipped map with the largest angle of this car."""
    _, text = load_map(name)
    changed = re.sub(r"full_scale = \S+", f"full_scale = {LOCK}", text)
    assert changed != text
    return parse_map(changed, name)


@pytest.mark.parametrize("name", ["f1tenth", "mushr"])
def test_a_map_of_a_smaller_lock_states_the_angle_to_write(topics, name):
    with pytest.raises(RecordingError, match="exceed full_scale") as error:
        convert_tables(topics["ds3"][name], load_map(name)[0])
    assert f"full_scale = {LOCK}" in error.value.remedy


def test_a_guess_takes_the_odometry_and_not_the_twist_of_the_filter(topics):
    made = guess_map(topics["ds4"]["f1tenth"]).map
    assert made.encoder.table == "/odom"
    assert made.throttle.kind == "speed"
    assert made.poses.table == "/pf/pose/odom"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["f1tenth", pytest.param("mushr", marks=pytest.mark.slow)])
def test_a_shipped_map_leads_to_a_model_that_predicts_another_drive(topics, name, tmp_path):
    for drive in LIMIT:
        write_imported(convert_tables(topics[drive][name], with_lock(name)),
                       tmp_path / f"{drive}.mcap")
    (slow, fast), _ = read_any([tmp_path / f"{drive}.mcap" for drive in LIMIT])
    assert slow.drive == "speed"
    assert slow.steering_scale == LOCK
    start = apply_car_sizes("paper", find_model("paper")[0], None, [slow], fitting=True).model
    # The fit starts at the angle that the log states for the command 1.
    steer = make_steering(vehicle_of(start).steering)
    assert 0.5 * (steer(1.0) - steer(-1.0)) == pytest.approx(LOCK)
    found, _ = identify_jointly([slow], [], SECTIONS, start, "test")
    model = build_model(found.fits, found.over(start), found.source, joint=found.joint).model
    made = evaluate(vehicle_of(model), [fast], limit=False)
    error, constant = (s.to_json()["1.0"]["pooled"]["vx"] for s in (made.model, made.ctrv))
    assert error < 0.8 * constant
