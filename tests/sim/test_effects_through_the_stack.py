"""The whole stack over a car with hidden effects: what a user's program receives."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.car import Car
from dart_hal.core.errors import EmulatorMissing
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import truth

NANOS = ["mock", pytest.param("avr", marks=pytest.mark.emulator)]


@pytest.fixture(scope="module")
def measure_car():
    """``measure_car(nano, effects)``: estimated path over the true one, then means of the last 0.4
    s: yaw rate as reported, true speed, true yaw rate."""
    kept = {}

    def drive(nano, effects=""):
        if (nano, effects) in kept:
            return kept[nano, effects]
        try:
            backend = open_backend(f"sim://?nano={nano}&effect={effects}")
        except EmulatorMissing as missing:
            pytest.skip(f"no emulator: {missing.what}")
        with Car.over(backend) as car:
            car.arm()
            states = []
            for state in car.states(duration=2.0):
                car.drive(steering=0.0, throttle=0.25)
                states.append(state)
            real = [truth(backend, s.t) for s in states[-40:]]
            path = states[-1].pose.x / real[-1].x
            kept[nano, effects] = (
                path, np.mean([s.yaw_rate for s in states[-40:]]),
                np.mean([r.v_x for r in real]), np.mean([r.yaw_rate for r in real]))
        return kept[nano, effects]

    return drive


@pytest.mark.parametrize("nano", NANOS)
@pytest.mark.slow
def test_a_bad_ring_shortens_the_path_and_leaves_the_car_alone(measure_car, nano):
    plain, changed = measure_car(nano), measure_car(nano, "encoder_ring:missing=0.1")
    assert plain[0] == pytest.approx(1.0, abs=0.01)
    assert changed[0] == pytest.approx(0.9, abs=0.015)
    # Not to the bit: the first pulse waits for the first State, whose length on the wire, and so
    # its arrival, depends on the count of the ring.
    assert changed[2:] == pytest.approx(plain[2:], abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("nano", NANOS)
def test_a_trimmed_linkage_turns_a_car_that_is_reported_to_go_straight(measure_car, nano):
    plain, changed = measure_car(nano), measure_car(nano, "steering_trim:0.05")
    assert abs(plain[1]) < 0.03
    assert changed[1] == pytest.approx(changed[3], abs=0.03)
    assert 0.15 < changed[3] < changed[2] * 0.05 / 0.175 * 1.1


@pytest.mark.parametrize("nano", NANOS)
@pytest.mark.slow
def test_a_board_with_another_clock_drives_faster_and_to_the_left(measure_car, nano):
    plain, changed = measure_car(nano), measure_car(nano, "pwm_clock:0.01")
    assert changed[2] > 1.4 * plain[2]
    assert changed[1] > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("nano", NANOS)
def test_at_rest_before_arming_takes_a_gyro_bias_off_and_no_scale(measure_car, nano):
    turning = "steering_trim:0.05"
    plain, biased, scaled = (measure_car(nano, turning + more) for more in (
        "", ",gyro_bias:0.05", ",gyro_scale:0.2"))
    assert biased[1] == pytest.approx(plain[1], abs=5e-3)
    assert scaled[1] == pytest.approx(1.2 * plain[1], rel=0.02)
