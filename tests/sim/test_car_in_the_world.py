"""The whole stack on the virtual world: what a user's ten lines do to the true car."""

from __future__ import annotations

import math

import pytest

from dart_hal.car import Car
from dart_hal.core.errors import EmulatorMissing
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of

URLS = ["sim://?nano=mock", "sim://?nano=mock&seed=3&jitter=usb", "sim://?nano=mock&cutoff=oe",
        "sim://?nano=mock&cutoff=mux",
        pytest.param("sim://?nano=avr&seed=3", marks=pytest.mark.emulator),
        pytest.param("sim://?nano=avr&cutoff=oe", marks=pytest.mark.emulator),
        pytest.param("sim://?nano=avr&cutoff=mux", marks=pytest.mark.emulator)]


@pytest.mark.slow
@pytest.mark.parametrize("url", URLS)
def test_a_left_turn_is_driven_and_observed(url):
    try:
        backend = open_backend(url)
    except EmulatorMissing as missing:
        pytest.skip(f"no emulator: {missing.what}")
    world = world_of(backend)
    with Car.over(backend) as car:
        car.arm()
        states = []
        for state in car.states(duration=3.0):
            car.drive(steering=0.2, throttle=0.3)
            states.append(state)
        state = states[-1]
        true = world.truth(state.t)
        assert true.v_x > 1.0
        assert true.yaw > 1.0
        assert state.speed == pytest.approx(true.v_x, rel=0.08)      # an unlearnt ring
        assert state.yaw_rate == pytest.approx(true.yaw_rate, abs=0.08)
        assert math.hypot(state.pose.x - true.x, state.pose.y - true.y) < 0.4
    assert world.esc.throttle == 0.0
