"""Speeds under neutral that trip, and those that must not; free of any car."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.devices.actuation.neutral_watch import SETTLE_S, NeutralWatch

DT = 0.01


def tripped_at(speeds, neutral=lambda t: True) -> float | None:
    """s at which a sequence of speeds [m/s], one each 10 ms, trips; None = never."""
    watch = NeutralWatch()
    for k, speed in enumerate(speeds):
        t = k * DT
        if not neutral(t):
            watch.note_driven(t)
        if watch.update(t, speed, neutral(t)):
            return t
    return None


def ramp(start: float, slope: float, seconds: float) -> list[float]:
    return [max(start + slope * k * DT, 0.0) for k in range(round(seconds / DT))]


@pytest.mark.parametrize("acceleration", [0.2, 1.0, 5.0, 40.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_car_at_rest_that_speeds_up_trips(acceleration, sign):
    speeds = [0.0] * 50 + [sign * v for v in ramp(0.0, acceleration, 3.0)]
    t = tripped_at(speeds)
    assert t is not None
    assert t - 0.5 < 0.1 / acceleration + 0.08


def test_creeping_trips_after_a_decimetre():
    t = tripped_at([0.0] * 50 + [0.06] * 500)
    assert t is not None
    assert 0.06 * (t - 0.5) < 0.11


@pytest.mark.parametrize("deceleration", [0.05, 0.3, 2.0, 8.0])
def test_coasting_does_not_trip(deceleration):
    assert tripped_at(ramp(3.0, -deceleration, 20.0)) is None


def test_a_speed_that_does_not_fall_trips():
    """A program before had armed the ESC, and the wrong neutral only holds its speed."""
    t = tripped_at([1.5] * 300)
    assert t is not None
    assert t < 1.2


def test_the_lag_of_the_motor_after_a_throttle_does_not_trip():
    speeds = ramp(1.0, 3.0, 1.0 + 0.2) + ramp(4.6, -0.5, 5.0)
    assert tripped_at(speeds, neutral=lambda t: t > 1.0) is None
    assert tripped_at(ramp(1.0, 3.0, 3.0), neutral=lambda t: t > 1.0) > 1.0 + SETTLE_S


def test_a_ring_with_a_missing_mark_does_not_trip():
    speeds = [v * (1.08 if k % 9 < 3 else 1.0) for k, v in enumerate(ramp(2.0, -0.4, 5.0))]
    assert tripped_at(speeds) is None


def test_edges_that_no_wheel_makes_do_not_trip():
    assert tripped_at([0.0] * 50 + [5.4] * 300 + [0.0] * 50 + [3.0] * 100) is None


def test_a_wheel_that_rocks_at_rest_does_not_trip():
    assert tripped_at(([0.0] * 60 + [0.2] * 2 + [0.07] * 20) * 20) is None


@given(st.lists(st.floats(0.0, 5.0), max_size=100))
def test_speeds_without_neutral_never_trip(speeds):
    assert tripped_at(speeds, neutral=lambda t: False) is None
