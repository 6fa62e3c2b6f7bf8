"""Pulses at the pins with a measured clock: the requested frequency and the mean pulse."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from dart_hal.core.config import CarFiles
from dart_hal.devices.actuation import Actuator
from dart_hal.devices.actuation.pca9685 import Pca9685
from dart_hal.devices.actuation.plan import LIVE_DEMAND
from dart_hal.devices.actuation.quantiser import (
    COUNTS_PER_FRAME,
    NOMINAL_HZ,
    Quantiser,
    count_us,
    counter_of,
    prescale_for,
)
from dart_hal.devices.actuation.standby import Throttle
from tests.devices.actuation.pwm_world import World, car_files

CLOCKS = (24.06e6, 25e6, 26.08e6, 27.0e6)
"""Hz, as measured on boards."""
STEERING, THROTTLE = 0, 1


def without_feedback(files: CarFiles) -> CarFiles:
    pwm = msgspec.structs.replace(files.config.pwm, error_feedback=False)
    return CarFiles(msgspec.structs.replace(files.config, pwm=pwm), *(
        getattr(files, name) for name in ("calibration", "model", "folder", "origin")))


def held(hertz: float, files: CarFiles, throttle: float = 0.3137, frames: int = 120
         ) -> tuple[World, Actuator, float]:
    """A world that holds one throttle for some frames, and the requested pulse [us]."""
    world = World(hertz)
    actuator = world.actuator(files, demand=lambda: LIVE_DEMAND)
    actuator.open()
    for _ in range(frames):
        actuator.command(0.1, throttle, 0.2, "user", world.t)
        actuator.frame(world.t)
        world.t += actuator.pca.frame
    return world, actuator, files.neutral_us + files.config.throttle.span_us * throttle


@pytest.mark.parametrize("hertz", CLOCKS)
def test_the_frequency_is_kept_by_the_measured_clock(hertz):
    world, actuator, _ = held(hertz, car_files(hertz))
    rises = np.array([rise for rise, _ in world.pulses(THROTTLE)])[-50:]
    assert 1.0 / np.mean(np.diff(rises)) == pytest.approx(50.0, rel=0.0042)
    assert actuator.pca.frame == pytest.approx(np.mean(np.diff(rises)), rel=1e-6)


@pytest.mark.parametrize("hertz", [24.06e6, 27.0e6])
def test_control_by_the_nominal_clock_it_is_not(hertz):
    """What 121 for every part would do."""
    frequency = hertz / COUNTS_PER_FRAME / (prescale_for(50.0) + 1)
    assert abs(frequency / 50.0 - 1.0) > 0.03


@pytest.mark.parametrize("prescale", [3, 30, 117, 121, 127, 200, 255])
def test_servokit_computes_the_prescale_that_is_meant(prescale):
    frequency = NOMINAL_HZ / COUNTS_PER_FRAME / (prescale + 1)
    assert int(NOMINAL_HZ / COUNTS_PER_FRAME / frequency + 0.5) - 1 == prescale
    assert prescale_for(frequency) == prescale


def test_without_a_measured_clock_it_is_the_nominal_one():
    assert counter_of(car_files(None)) == (121, count_us(121, NOMINAL_HZ))


@pytest.mark.parametrize("hertz", CLOCKS)
def test_who_stops_the_car_knows_the_drivers_counter(hertz):
    """Another counter would look like another chip, and all outputs would be cut."""
    files = car_files(hertz)
    world, _, _ = held(hertz, files)
    standby = Throttle(files, world.bus, world.sleep)
    assert standby.rest()
    world.t += 0.1
    assert world.pulses(THROTTLE)[-1][1] == pytest.approx(files.neutral_us, abs=2.6)
    assert not standby.is_off
    standby.switch_off()
    assert standby.is_off
    assert standby.rest(), "what is off stays off"
    assert standby.is_off


@pytest.mark.parametrize("ends", [True, False])
def test_standby_leaves_no_pulse_on_a_chip_with_another_counter(ends, monkeypatch):
    """Its neutral would be another pulse there. Control: without ALL_LED the throttle goes on."""
    world, _, _ = held(27.0e6, car_files(27.0e6))
    if not ends:
        monkeypatch.setattr(Pca9685, "all_off", lambda pca: None)
    standby = Throttle(car_files(25e6), world.bus, world.sleep)
    assert not standby.rest()
    assert standby.is_off == ends
    world.t += 0.03                                          # the pulse under way
    before = len(world.pulses(THROTTLE))
    world.t += 0.1
    assert (len(world.pulses(THROTTLE)) == before) == ends


@pytest.mark.parametrize("hertz", CLOCKS)
@pytest.mark.parametrize("throttle", [0.2, 0.3137, -0.41])
def test_the_mean_pulse_at_the_pin_is_the_requested_one(hertz, throttle):
    world, actuator, requested_us = held(hertz, car_files(hertz), throttle)
    widths = [width for _, width in world.pulses(THROTTLE)][-100:]
    assert np.mean(widths) == pytest.approx(requested_us, abs=0.05)
    assert max(abs(w - requested_us) for w in widths) <= actuator.pca.count_us
    assert actuator.applied.throttle_us == pytest.approx(widths[-1], abs=0.01)


def test_switched_off_every_frame_has_the_nearest_count():
    world, actuator, requested_us = held(25e6, without_feedback(car_files(25e6)))
    widths = {round(width, 3) for _, width in world.pulses(THROTTLE)[-50:]}
    assert len(widths) == 1
    off = abs(widths.pop() - requested_us)
    assert 0.05 < off <= 0.5 * actuator.pca.count_us
    quantiser = Quantiser(4.88, feedback=False)
    assert {quantiser.step(1502.0) for _ in range(20)} == {308}
    assert quantiser.peek(1502.0) == 308


def test_applied_has_the_angle_and_throttle_of_the_present_pulse():
    files = car_files(27.0e6)
    world, actuator, _ = held(27.0e6, files)
    steering, throttle = (world.pulses(channel)[-1][1] for channel in (STEERING, THROTTLE))
    assert actuator.applied.steering == pytest.approx(actuator.map.angle(steering), abs=1e-5)
    assert actuator.applied.throttle == pytest.approx(
        (throttle - files.neutral_us) / files.config.throttle.span_us, abs=1e-5)
