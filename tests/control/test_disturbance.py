"""The error of the steering model is learnt, and what is commanded allows for it."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from dart_hal.control.follow import Follower
from dart_hal.control.mpc import disturbance
from dart_hal.control.mpc.disturbance import MAX_ERROR, DisturbancePrediction, SteeringDisturbance
from dart_hal.control.plant import MotionPrediction, SteeringDelay
from dart_hal.control.tracks import track_named
from dart_hal.core.types import Pose
from studies.control.light_follow import LATER, light_drive, motion_at, plant_by
from studies.control.mpc_loop import P, known

TRUE_ERRORS = np.array([0.03, -0.15, 0.1])
ORIGIN = Pose(0.0, 0.0, 0.0)
STEERING_STEPS = np.tile((0.0, 0.6, 0.0, -0.5), 20)


def learnt(speed: float, true: np.ndarray = TRUE_ERRORS) -> SteeringDisturbance:
    """After 8 s of bends to both sides by a car that steers by ``true``, noise of 0.05 rad/s
    in its yaw rate."""
    plant = known(P)
    found = SteeringDisturbance(known(P))
    rng = np.random.default_rng(1)
    for c in STEERING_STEPS:
        acts = c + true @ (1.0, max(c, 0.0), min(c, 0.0))
        turned = speed * plant.steady.curvature(plant.angle_of(acts), speed) + rng.normal(
            scale=0.05
        )
        found.update(float(c), speed, turned, 0.1)
    return found


@pytest.mark.parametrize("speed", [0.7, 1.8])
def test_it_finds_offset_and_both_gains(speed):
    assert learnt(speed).value == pytest.approx(TRUE_ERRORS, abs=0.04)


def test_a_car_at_rest_teaches_nothing():
    assert (learnt(0.2).value == 0.0).all()


def test_it_never_believes_more_than_its_limit():
    assert np.abs(learnt(1.5, np.array([0.9, 0.9, 0.9])).value).max() <= MAX_ERROR


@pytest.mark.parametrize("command", [-1.0, -0.3, -0.02, 0.0, 0.02, 0.4, 1.0])
def test_a_command_and_what_it_does(command):
    found = learnt(1.5)
    assert found.command(found.effective(command)) == pytest.approx(command, abs=1e-12)


@pytest.mark.slow_except("10")
@pytest.mark.parametrize("every", [1, 10])
def test_wheels_that_turn_teach_nothing_of_where_they_stood(every):
    """A car that does what its model says, steered to and fro, without any slip, predicts
    each 10 ms or with each plan: there is nothing to learn of it."""
    plant = replace(known(P), delay=SteeringDelay(transport=0.03, yaw_delay=0.0))
    true = MotionPrediction(plant, learns_bias=False)
    predictor = DisturbancePrediction(plant)
    for k in range(800):
        t = 0.01 * k
        angle = plant.angle_of(0.0 if k % 40 < 20 else 0.5 if k % 80 < 40 else -0.5)
        wheels = true.predict(motion_at(t, ORIGIN, 1.5, 0.0), t).angle
        motion = motion_at(t, ORIGIN, 1.5, 1.5 * plant.steady.curvature(wheels, 1.5))
        if k % every == 0:
            predictor.predict(motion, t)
        for prediction in (true, predictor):
            prediction.record_command(t, angle)
    assert np.abs(predictor.disturbance.value).max() < 0.001


@pytest.mark.slow
def test_a_yaw_rate_that_comes_behind_the_wheels_is_no_loss_of_gain():
    """It settles within 20 ms and the servo is slower than the model's: what is missing as the
    wheels go out, and left over as they come back, must not add up on any side."""
    plant = replace(known(P), delay=SteeringDelay(transport=0.03))
    behind = 0.0
    slow = replace(plant, delay=SteeringDelay(transport=0.03, slew=6.0))
    true = MotionPrediction(slow, learns_bias=False)
    predictor = DisturbancePrediction(plant)
    for k in range(1600):
        t = 0.01 * k
        angle = plant.angle_of(0.0 if k % 40 < 20 else 0.5 if k % 80 < 40 else -0.5)
        wheels = true.predict(motion_at(t, ORIGIN, 1.5, 0.0), t).angle
        behind += 0.4 * (1.5 * plant.steady.curvature(wheels, 1.5) - behind)
        predictor.predict(motion_at(t, ORIGIN, 1.5, behind), t)
        for prediction in (true, predictor):
            prediction.record_command(t, angle)
    assert np.abs(predictor.disturbance.value).max() < 0.06


def final_offset(speed: float = 1.5) -> float:
    """m off a circle of 1 m, in the mean of its second half, by ``follow`` on a car whose wheels
    are turned 0.04 rad too far to the left."""
    follower = Follower(track_named("circle"), plant_by(LATER), speed, "mpcc")
    rows = light_drive(follower, bias=0.04)
    assert follower.why == "the path is driven"
    return float(rows[len(rows) // 2:-200, 3].mean())


@pytest.mark.slow
def test_misaligned_wheels_leave_no_offset(monkeypatch):
    """The control: the same where nothing is learnt."""
    assert abs(final_offset()) < 0.004
    monkeypatch.setattr(disturbance, "MIN_LEARNING_SPEED", inf)
    assert abs(final_offset()) > 0.012
