"""What `calibrate esc` and `throttle` measured is what the speed loop drives with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.car import Car
from dart_hal.control.drivetrain import InverseDrive
from dart_hal.control.loop import SpeedLoop
from dart_hal.control.measured import (
    DEFAULT_REVERSE_REST,
    make_inverse_drive,
    rest_before_reverse,
    vehicle_for,
)
from dart_hal.control.reversal import Reversal
from dart_hal.core.config import Calibration, DriveTable, Quantity, save_calibration
from dart_hal.core.config.calibration import ThrottleCalibration
from dart_hal.devices.links.base import open_backend
from dart_hal.vehicle.sets import PAPER
from dart_lab.sim.esc import Esc
from dart_lab.sim.truth import world_of
from tests.common import MOCK_2_URL

TABLE = DriveTable(speed=(0.5, 1.0, 1.5), pulse_us=(1600.0, 1612.0, 1627.0),
                   std_us=(0.3, 0.3, 0.3))


@pytest.fixture(scope="module")
def files():
    with Car.open(MOCK_2_URL) as car:
        return car.files


def add_throttle_table(files, **throttle):
    table = ThrottleCalibration(**throttle)
    return replace(files, calibration=Calibration(car=files.config.name, throttle=table))


def test_the_feed_forward_is_the_measured_pulse(files):
    for v, pulse in zip(TABLE.speed, TABLE.pulse_us, strict=True):
        car = make_inverse_drive(add_throttle_table(files, drive=TABLE))
        assert 1500.0 + 450.0 * car.throttle(v) == pytest.approx(pulse, abs=1e-6)
        other = make_inverse_drive(add_throttle_table(files, drive=TABLE,
                                                      neutral_us=Quantity(1510.0, 1.0)))
        assert 1510.0 + 450.0 * other.throttle(v) == pytest.approx(pulse, abs=1e-6)
    assert make_inverse_drive(files).throttle(1.0) == InverseDrive(PAPER).throttle(1.0)


def test_between_and_beyond_the_points_it_keeps_the_models_shape(files):
    car = make_inverse_drive(add_throttle_table(files, drive=TABLE))
    model = InverseDrive(PAPER)
    more = [car.throttle(v) - model.throttle(v) for v in (0.2, 0.5, 0.75, 1.0, 2.0, 1.5)]
    assert more[0] == pytest.approx(more[1])
    assert more[2] == pytest.approx(0.5 * (more[1] + more[3]))
    assert more[4] == pytest.approx(more[5])
    assert np.all(np.diff([car.throttle(v) for v in np.linspace(0.1, 3.0, 60)]) > 0.0)
    assert car.throttle(1.0, 1.0) - car.throttle(1.0) == pytest.approx(
        model.throttle(1.0, 1.0) - model.throttle(1.0))
    assert car.throttle(1.0, -20.0) == car.throttle(0.0) == 0.0


def test_the_dead_band_is_the_papers_until_it_is_measured(files):
    measured = add_throttle_table(files, deadband_forward_us=Quantity(72.0, 0.1))
    assert vehicle_for(files) == PAPER
    assert vehicle_for(measured).motor == replace(PAPER.motor, g=-72.0 / 450.0)


def test_the_loop_requests_no_more_than_the_esc_gives(files):
    """A car at rest with a target of 4.9 m/s: no throttle is enough."""
    with Car.open(MOCK_2_URL) as car:
        still = next(iter(car.states()))

    def most(loop):
        return max(loop.throttle(4.9, replace(still, t=0.01 * k), armed=True, window=0.2)
                   for k in range(300))

    assert most(SpeedLoop(add_throttle_table(files,
                                             saturation_us=Quantity(360.0, 1.0)))) == pytest.approx(
        0.8)
    assert most(SpeedLoop(files)) == 1.0


@pytest.mark.parametrize(("throttle", "rest"), [
    ({}, DEFAULT_REVERSE_REST), ({"reverse": "at_once"}, 0.0),
    ({"reverse_rest": Quantity(0.4, 0.01)}, 0.4 + 1.645 * 0.01 + 0.06)])
def test_the_rest_before_reverse_is_the_measured_one(files, throttle, rest):
    assert rest_before_reverse(add_throttle_table(files, **throttle)) == pytest.approx(rest)


def test_an_esc_without_a_brake_is_not_braked():
    reversal = Reversal(0.0)
    assert [reversal.throttle(u, 1.0, 0.01) for u in (0.3, -0.3, -0.3)] == [0.3, -0.3, -0.3]


def backward_after(tmp_path, gap: float, rest: Quantity | None) -> float:
    """s from the order to reverse until the car goes back at 0.2 m/s (inf: not within 2.5 s)."""
    backend = open_backend(MOCK_2_URL)
    world = world_of(backend)
    world.esc = Esc(replace(world.esc.params, reverse_gap=gap))
    cal = Calibration(car="sim-2", throttle=ThrottleCalibration(reverse_rest=rest))
    save_calibration(cal, tmp_path / "sim-2")
    with Car.over(backend, cars=tmp_path) as car:
        car.arm()
        start = next(iter(car.states())).t
        for state in car.states(duration=4.0):
            t = state.t - start
            car.drive_speed(steering=0.0, speed=0.6 if t < 1.5 else -0.5)
            if t > 1.5 and world.truth().v_x < -0.2:
                return t - 1.5
    return float("inf")


@pytest.mark.slow
def test_an_esc_that_rests_long_reverses_at_once_where_it_was_measured(tmp_path):
    measured = backward_after(tmp_path / "a", 0.4, Quantity(0.4, 0.01))
    unknown = backward_after(tmp_path / "b", 0.4, None)
    assert measured < 1.3
    assert unknown > measured + 0.5
