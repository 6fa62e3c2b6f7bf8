"""Bends begin slowly and get faster while the model is confirmed."""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest

from dart_hal.control.speed_ramp import FIRST_SHARE, MIN_SHARE, SpeedRamp
from studies.control.light_follow import LATER
from studies.control.wrong_models import drive_once, vary


def learn(ramp, distance=40.0, ratio=None, offset=0.1, error=0.005, start=0.0):
    """Drive ``distance`` m at 1 m/s from ``start``; ratio: of the speed to the profile, None: what
    is commanded.
    """
    for k in range(round(100 * start), round(100 * (start + distance))):
        ramp.update(0.01 * k, 0.01 * k, ramp.factor if ratio is None else ratio, offset, error)
    return ramp


def test_a_confirmed_model_is_driven_at_its_full_speed():
    ramp = SpeedRamp()
    assert ramp.factor == pytest.approx(sqrt(FIRST_SHARE))
    assert learn(ramp).factor == 1.0


@pytest.mark.parametrize("wrong", [{"offset": 0.35}, {"error": 0.025}, {"error": -0.025},
                                   {"ratio": 0.4}])
def test_the_share_stays_without_a_confirmation(wrong):
    """The last one: a slow straight confirms nothing."""
    assert learn(SpeedRamp(), **wrong).share == FIRST_SHARE


@pytest.mark.parametrize("wrong", [{"offset": -0.45}, {"error": 0.035}])
def test_the_share_falls_when_the_model_is_wrong(wrong):
    assert learn(learn(SpeedRamp()), start=40.0, **wrong).share == MIN_SHARE


@pytest.mark.parametrize("wrong", [{"offset": 0.6}, {"error": 0.05}])
def test_an_alarm_acts_within_the_stretch(wrong):
    assert learn(learn(SpeedRamp()), start=40.0, distance=0.5, **wrong).share < 0.5


def test_an_offset_slows_down_at_once():
    ramp = learn(SpeedRamp())
    ramp.update(99.0, 99.0, 1.0, 0.65, 0.0)
    assert ramp.factor <= 0.6


@pytest.mark.slow
def test_cars_with_weaker_tyres_stay_in_the_lane():
    rng = np.random.default_rng(79)
    cars = [vary(LATER, 0.2, 0.3, rng) for _ in range(4)]
    # Two of them leave the lane at once: the control.
    assert sum(drive_once(car, "lqr", 2.0, careful=False)[0] > 0.3 for car in cars) == 2
    offsets, laps = zip(*(drive_once(car, "lqr", 2.0, careful=True) for car in cars), strict=True)
    assert max(offsets) < 0.1
    assert [len(times) for times in laps] == [2, 2, 2, 2]


@pytest.mark.slow
def test_a_right_model_costs_the_first_lap_alone():
    _, at_once = drive_once(LATER, "lqr", 2.0, careful=False)
    _, careful = drive_once(LATER, "lqr", 2.0, careful=True)
    assert careful[0] > at_once[0] + 0.3
    assert careful[1] == pytest.approx(at_once[1], abs=0.25)
