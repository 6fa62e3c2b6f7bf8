"""``drive_speed``: it settles, and it reverses through an ESC that brakes first."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.car import Car
from dart_hal.control.measured import DEFAULT_REVERSE_REST
from dart_hal.control.reversal import (
    BRAKE_THROTTLE,
    MAX_BRAKE_TIME,
    MIN_BRAKE_TIME,
    REST_SPEED,
    Reversal,
)

pytestmark = pytest.mark.usefixtures("armed_esc")

URL = "sim://?seed={}&nano=mock"
LOOP_PERIOD = 0.01


def driven(seed, reference, seconds):
    """(t, speed, throttle applied, limits) of a car with the target reference(t) [m/s]."""
    rows = []
    start = None
    with Car.open(URL.format(seed)) as car:
        car.arm()
        for state in car.states(duration=seconds):
            start = state.t if start is None else start
            t = state.t - start
            applied = car.drive_speed(steering=0.3, speed=reference(t))
            rows.append((t, state.speed, applied.throttle, applied.limited))
    t, speed, throttle = np.array([row[:3] for row in rows]).T
    return t, speed, throttle, [row[3] for row in rows]


def there_and_back(t):
    return 0.8 if t < 2.0 else -0.5 if t < 4.0 else 0.8


def first_time(t, holds, t_start):
    return t[holds & (t > t_start)][0] - t_start


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, *(pytest.param(n, marks=pytest.mark.slow)
                                       for n in range(2, 9))])
def test_forward_reverse_forward(seed):
    t, speed, _, limited = driven(seed, there_and_back, 5.5)
    assert first_time(t, speed < -0.45, 2.0) < 1.5
    assert first_time(t, speed > 0.72, 4.0) < 1.5
    steady = (t > 3.3) & (t < 4.0)
    assert np.sqrt(np.mean((speed[steady] + 0.5)**2)) < 0.03
    assert {"REVERSING"} <= {name for names in limited for name in names}


@pytest.mark.slow
def test_without_the_brake_and_the_rest_the_esc_never_reverses(monkeypatch):
    monkeypatch.setattr(Reversal, "throttle", lambda self, target, speed, dt: target)
    t, speed, _, _ = driven(1, there_and_back, 4.0)
    assert speed[t > 2.0].min() > -0.1


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 9))
def test_a_step_from_rest_settles_and_a_sine_is_followed(seed):
    def reference(t):
        return 0.8 if t < 3.0 else 1.2 + 0.4 * np.sin(np.pi * (t - 3.0))

    t, speed, _, _ = driven(seed, reference, 8.0)
    assert speed[t < 3.0].max() < 0.8 * 1.15
    follows = (t > 4.0) & (t < 8.0)
    target = np.array([reference(one) for one in t[follows]])
    assert np.sqrt(np.mean((speed[follows] - target)**2)) < 0.05


def test_a_speed_beyond_the_limit_is_reported():
    limited = driven(1, lambda t: 99.0, 0.3)[3]
    assert all("RANGE" in names for names in limited)


@given(st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-3.0, 3.0)), max_size=400))
def test_neutral_is_never_filled_and_nothing_drives_forward_unasked(requests):
    reversal = Reversal()
    for target, speed in requests:
        given_ = reversal.throttle(target, speed, LOOP_PERIOD)
        if target >= 0.0:
            assert given_ == target
        else:
            assert -max(BRAKE_THROTTLE, -target) <= given_ <= 0.0


@given(st.floats(0.0, 3.0), st.floats(0.1, 1.0), st.floats(0.5, 3.0))
def test_after_forward_the_brake_and_a_rest_come_before_reverse(speed, pull, slows):
    reversal = Reversal()
    throttles = []
    reversal.throttle(0.3, speed, LOOP_PERIOD)
    for _ in range(300):
        throttles.append(reversal.throttle(-pull, speed, LOOP_PERIOD))
        speed = max(speed - slows * LOOP_PERIOD, 0.0)
        if not reversal.holding:
            break
    rest = np.flatnonzero(np.array(throttles) == 0.0)
    assert MIN_BRAKE_TIME / LOOP_PERIOD - 1 <= rest[0] <= MAX_BRAKE_TIME / LOOP_PERIOD + 1
    assert len(rest) >= DEFAULT_REVERSE_REST / LOOP_PERIOD - 2
    assert throttles[-1] == -pull


def test_a_brake_that_turns_out_to_reverse_is_let_go():
    reversal = Reversal()
    reversal.throttle(0.3, 0.5, LOOP_PERIOD)
    for i in range(100):
        if reversal.throttle(-0.3, 0.5 + 0.02 * i, LOOP_PERIOD) == 0.0:
            break
    assert i < 15


def test_an_esc_that_braked_instead_is_rested_once_more():
    reversal = Reversal()
    throttles = []
    for _ in range(200):
        throttles.append(reversal.throttle(-0.3, 0.5 * REST_SPEED, LOOP_PERIOD))
    assert throttles[0] == -0.3
    assert 0.0 in throttles
    assert throttles[-1] == -0.3


@pytest.mark.slow
@pytest.mark.parametrize("held", ["obstacle", "battery"])
def test_the_car_does_not_leap_when_a_withheld_throttle_passes_again(held):
    def fastest(hold):
        with Car.open("sim://?nano=mock&seed=3") as car:
            car.arm(waive=("CALIBRATION_MISSING",))
            actuator = car._engine.driver.actuator
            begin = car.now
            throttles = []
            for state in car.states(duration=5.0):
                withheld = hold and state.t < begin + 3.0
                if held == "obstacle":
                    actuator.set_obstacle(withheld)
                else:
                    actuator.set_battery_cap(0.1 if withheld else None)
                throttles.append(car.drive_speed(steering=0.0, speed=0.5).throttle)
            return max(throttles)

    assert fastest(True) < 1.3 * fastest(False), "2.2 times, with the integral of the pause"
