"""Trackers on the light simulation: by the same equations, so what is left is their own."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from dart_hal.control.follow import Follower, Rules
from dart_hal.control.lqr import PREVIEW_STEPS
from dart_hal.control.paths import Path
from dart_hal.control.plant import MotionPrediction, SteeringDelay, plant_of
from dart_hal.control.pursuit import arc
from dart_hal.control.trackers import TRACKERS, Lqr, Pursuit, without_delay
from dart_hal.control.tracks import track_named
from dart_hal.core.config import Calibration, Quantity, parse_car
from dart_hal.core.errors import UsageError
from dart_hal.core.types import Pose
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.sets import PAPER
from dart_lab.sim.car_file import typical_car_toml
from studies.control.light_follow import LATER, figures, light_drive, motion_at, plant_by

LATE_PLANT = plant_by(LATER)
both_trackers = pytest.mark.parametrize("name", TRACKERS)


def lap(name, speed, plant=LATE_PLANT, lane=1.0, whole=True, **options):
    """(rms, largest) offset [m] of one lap of the 22.92 m track, or until the car is off it."""
    follower = Follower(track_named("racetrack_vicon_2"), plant, speed, name, Rules(lane=lane))
    rows = light_drive(follower, **options)
    assert not whole or follower.why == "the path is driven"
    return figures(rows)


@both_trackers
@pytest.mark.slow
def test_two_metres_a_second(name):
    """The figures that are required of a whole car, with room for its electronics."""
    rms, largest = lap(name, 2.0, lane=0.3)
    assert rms < {"lqr": 0.012, "pursuit": 0.015, "mpcc": 0.012, "ca-mpcc": 0.02}[name]
    assert largest < 0.06


@pytest.mark.slow
@both_trackers
def test_one_metre_a_second(name):
    """The published low level follows the generated path, whose bends its kernel rounds."""
    rms, largest = lap(name, 1.0, lane=0.3)
    assert rms < (0.007 if name == "ca-mpcc" else 0.005)
    assert largest < 0.015


@pytest.mark.slow
@both_trackers
def test_without_delay_compensation_it_is_much_worse(name):
    """The control: 0.03 s of transport and 0.13 s of lag are 0.3 m at 2 m/s.

    Contouring control even leaves a lane of 1 m.
    """
    blind = lap(name, 2.0, without_delay(LATE_PLANT), whole=False)[0]
    knowing = lap(name, 2.0)[0]
    assert blind > 3.0 * knowing
    assert blind > 0.04


@pytest.mark.slow
@both_trackers
def test_a_lag_that_is_15_percent_off_and_a_map_that_is_half_a_degree_off(name):
    late = replace(LATE_PLANT.delay, lag=0.85 * LATE_PLANT.delay.lag)
    assert lap(name, 2.0, replace(LATE_PLANT, delay=late), bias=0.01)[0] < 0.04


@pytest.mark.slow
@both_trackers
def test_an_error_of_the_wheels_is_learnt(name):
    """0.02 rad that stay: without learning the LQR is 1.1 cm off, and stays so."""
    straight = Path([(12.0, 0.0)], closed=False)
    follower = Follower(straight, LATE_PLANT, 1.0, name)
    rows = light_drive(follower, bias=0.02)
    late = (rows[:, 1] > 8.0) & (rows[:, 1] < 11.0)
    assert np.abs(rows[late, 3]).max() < 0.002


@pytest.mark.slow
@both_trackers
@pytest.mark.parametrize("side", [0.9, -0.9])
@pytest.mark.long_except("0.9-*", "-0.9-lqr")
def test_from_far_off_the_path_it_comes_to_it_without_turning_back(name, side):
    """0.9 m off it and across to it."""
    straight = Path([(8.0, 0.0)], closed=False)
    follower = Follower(straight, LATE_PLANT, 0.8, name)
    rows = light_drive(follower, start=(0.2, side, -np.sign(side) * 1.2))
    assert follower.good
    assert (np.diff(rows[:, 1]) > -1e-6).all()
    assert np.abs(rows[rows[:, 1] > 5.0, 3]).max() < 0.01
    assert -np.sign(side) * rows[:, 2].max() < 0.25


def test_on_the_path_pursuit_requests_its_bend():
    circle = Path([(2 * pi * 1.2, 1 / 1.2)], closed=True)
    plant = replace(LATE_PLANT, delay=SteeringDelay(0.0))
    for v in (0.4, 1.2):
        bend = plant.steady.turn(1 / 1.2, v)
        motion = motion_at(0.0, Pose(0.0, 0.0, -bend.slip), v, v / 1.2)
        for name in ("lqr", "pursuit"):
            tracker = TRACKERS[name](circle, plant)
            tracker._prediction._servo = plant.command_of(bend.angle)
            tracker._prediction._t = 0.0
            assert tracker.steer(motion) == pytest.approx(bend.angle, abs=0.01)


@pytest.mark.slow
def test_left_and_right_are_symmetric():
    """Mirrored path, pose and plant: mirrored angle; differences of 1e-6 are taken to one side."""
    even = replace(LATER.steering, s0=0.0, k_right=LATER.steering.k_left,
                   a_right_rad=LATER.steering.a_left_rad)
    plant = replace(LATE_PLANT, vehicle=replace(LATER, steering=even), lock=(-0.3, 0.3))
    path = Path([(1.0, 0.0), (2.0, 0.8), (1.0, -0.5)], closed=False)
    mirrored = Path([(1.0, 0.0), (2.0, -0.8), (1.0, 0.5)], closed=False)
    for name, make in TRACKERS.items():
        one = make(path, plant).steer(motion_at(0.0, Pose(0.8, 0.05, 0.1), 1.5, 0.3))
        two = make(mirrored, plant).steer(motion_at(0.0, Pose(0.8, -0.05, -0.1), 1.5, -0.3))
        assert one == pytest.approx(-two, abs=1e-5 if name == "mpcc" else 1e-6)


def test_the_arc_to_a_point():
    assert arc(0.0, 0.0, 0.0, 1.0, 1.0) == pytest.approx(1.0)
    assert arc(0.0, 0.0, 0.0, 1.0, -1.0) == pytest.approx(-1.0)
    assert arc(0.0, 0.0, 0.0, 2.0, 0.0) == 0.0
    assert arc(0.0, 0.0, 0.0, -1.0, 0.1) == pytest.approx(2.0, rel=0.01)


def test_gains_by_speed():
    """A preview of ones is the bend itself; the faster, the less of what is near counts."""
    gains = LATE_PLANT.gains
    assert gains.preview.sum(axis=1) == pytest.approx(1.0)
    assert gains.preview.shape == (len(gains.feedback), PREVIEW_STEPS)
    assert (gains.feedback[:, :2] > 0.0).all()


def test_a_command_acts_after_transport_and_lag():
    """0.1 s ahead of a step: what is left of the lag by then; nothing before the transport."""
    late = SteeringDelay(0.04, 0.1, slew=99.0)
    prediction = MotionPrediction(replace(LATE_PLANT, delay=late))
    still = motion_at(0.0, Pose(), 0.0, 0.0)
    prediction.predict(still, 0.0)
    prediction.record_command(0.0, 0.2)
    assert prediction.predict(still, 0.04).angle == pytest.approx(0.0, abs=1e-9)
    share = 1.0 - np.exp(-0.06 / 0.1)
    first = LATE_PLANT.command_of(0.0)
    last = LATE_PLANT.command_of(0.2)
    assert LATE_PLANT.command_of(prediction.predict(still, 0.1).angle) == pytest.approx(
        first + share * (last - first), rel=0.1)
    later = motion_at(0.5, Pose(), 0.0, 0.0)
    assert prediction.predict(later, 0.5).angle == pytest.approx(0.2, rel=0.02)


def test_a_servo_turns_no_faster_than_it_can():
    prediction = MotionPrediction(replace(LATE_PLANT, delay=SteeringDelay(0.0, 0.0, slew=1.0)))
    still = motion_at(0.0, Pose(), 0.0, 0.0)
    prediction.predict(still, 0.0)
    prediction.record_command(0.0, 0.3)
    there = LATE_PLANT.angle_of(LATE_PLANT.command_of(0.0) + 0.1)
    assert prediction.predict(still, 0.1).angle == pytest.approx(there, abs=0.005)


def test_prediction_is_the_motion_of_the_model():
    """A steady bend, predicted over 0.15 s, against a circle."""
    prediction = MotionPrediction(LATE_PLANT)
    v = 1.5
    k = 0.8
    bend = LATE_PLANT.steady.turn(k, v)
    start = motion_at(0.0, Pose(0.0, 0.0, -bend.slip), v, k * v)
    prediction._t, prediction._servo = 0.0, LATE_PLANT.command_of(bend.angle)
    prediction.record_command(-1.0, bend.angle)
    where = prediction.predict(start, 0.15)
    turned = k * v * 0.15
    assert where.yaw == pytest.approx(turned - bend.slip, abs=2e-3)
    assert (where.x, where.y) == pytest.approx(
        (np.sin(turned) / k, (1.0 - np.cos(turned)) / k), abs=1e-3)


def test_what_is_known_of_a_car(tmp_path):
    """Nothing: the paper's bends and map, and a servo of this class; then what was measured."""
    files = parse_car(typical_car_toml(), "typical", [tmp_path])
    plant = plant_of(files)
    assert plant.vehicle.tyres == PAPER.tyres
    assert plant.delay.transport == pytest.approx(0.0315)
    assert plant.lock == pytest.approx((-0.3505, 0.3075), abs=1e-3)
    measured = Calibration(car=files.config.name).with_quantities({
        "latency.command_to_pulse": Quantity(0.013, 1e-4),
        "latency.pulse_to_yaw": Quantity(0.01, 1e-3),
        "latency.pulse_to_yaw_lag": Quantity(0.08, 1e-3)})
    assert plant_of(replace(files, calibration=measured)).delay == SteeringDelay(0.023, 0.08)
    known = plant_of(replace(files, model=model_of(LATER)))
    assert known.delay.transport == pytest.approx(0.0115 + 0.03)
    assert known.delay.lag == pytest.approx(0.1285, abs=1e-4)


@pytest.mark.parametrize(("path", "plant", "match"), [
    ("savoiardo", LATE_PLANT, "a tracker follows a path"),
    (track_named("savoiardo"), {}, "needs the car as a plant")])
def test_what_is_no_path_or_no_plant_is_refused(path, plant, match):
    for tracker in (Pursuit, Lqr):
        with pytest.raises(UsageError, match=match):
            tracker(path, plant)
