"""Compensation of the steering play: the wheels reach the requested angle."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.devices.actuation.play import MIN_TURN, Play
from dart_hal.devices.actuation.steering_map import SteeringMap, steering_map
from studies.actuation.steering_figures import angle_error
from tests.devices.actuation.pwm_world import car_files

CURVE: SteeringMap = steering_map(car_files().config, None)
HALF = 0.0125
FRAME = 0.02


def wheels_after(play, true, angles, slew=3800.0):
    """Angle of a peg in the slot, frame by frame, when ``play`` gets these angles."""
    pulse, out = None, []
    for angle in angles:
        target = CURVE.pulse(play.aim(angle))
        pulse = target if pulse is None else pulse + np.clip(
            target - pulse, -slew * FRAME, slew * FRAME)
        middle = CURVE.angle(pulse)
        true = min(max(true, middle - HALF), middle + HALF)
        play.update(target, FRAME)
        out.append(true)
    return np.array(out)


@given(st.lists(st.floats(-0.2, 0.2), min_size=2, max_size=12))
def test_every_level_is_reached_from_either_side(levels):
    play = Play(CURVE, 2.0 * HALF, 3800.0)
    reached = wheels_after(play, 0.0, np.repeat([0.0, -0.1, *levels], 20))[19::20]
    assert np.abs(reached[1:] - np.array([-0.1, *levels])).max() <= MIN_TURN + 1e-6
    assert abs(play.wheels - reached[-1]) < 1e-9


def test_control_without_it_the_wheels_stay_behind_by_half_the_backlash():
    play = Play(CURVE, 0.0, 3800.0)
    reached = wheels_after(play, 0.0, np.repeat([0.0, 0.1, -0.05], 20))
    assert abs(reached[39] - 0.1) == pytest.approx(HALF, abs=1e-6)
    assert abs(reached[59] + 0.05) == pytest.approx(HALF, abs=1e-6)


def test_noise_does_not_shake_the_servo():
    rng = np.random.default_rng(2)
    play, pulses = Play(CURVE, 2.0 * HALF, 3800.0), []
    for k in range(300):
        angle = 0.1 + 0.4 * MIN_TURN * float(rng.uniform(-1.0, 1.0))
        pulses.append(CURVE.pulse(play.aim(angle if k > 20 else -0.1)))
        play.update(pulses[-1], FRAME)
    held = np.array(pulses[60:])
    assert np.ptp(held) < 12.0      # a slot across would be 40 us
    assert abs(play.wheels - 0.1) < MIN_TURN


def test_a_turn_before_the_servo_has_arrived_is_known_by_its_slew():
    quick = Play(CURVE, 2.0 * HALF, None)
    slow = Play(CURVE, 2.0 * HALF, 1000.0)
    for play in (quick, slow):
        for angle in (0.0, 0.25, 0.25):
            play.update(CURVE.pulse(play.aim(angle)), FRAME)
    assert quick.wheels == pytest.approx(0.25, abs=1e-6)
    assert slow.wheels < 0.05


@pytest.mark.long
def test_hidden_cars_follow_closer():
    pairs = np.array([[angle_error(seed, take_up) for take_up in (False, True)]
                      for seed in range(1, 13)])
    assert np.median(pairs[:, 1]) < 0.9 * np.median(pairs[:, 0])
    assert np.degrees(pairs[:, 1].max()) < 0.22
