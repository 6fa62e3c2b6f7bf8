"""The brake of the ESC: its fit, and what the planner and the speed loop make of it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from dart_hal.calibration import brake
from dart_hal.calibration.spin import edge_distances
from dart_hal.car import Car
from dart_hal.control.drivetrain import COAST_THROTTLE
from dart_hal.control.lap import speed_profile
from dart_hal.control.measured import make_inverse_drive, min_brake
from dart_hal.control.plant import plant_of
from dart_hal.control.tracks import track_named
from dart_hal.core.config import Calibration, Quantity
from dart_hal.core.config.calibration import ThrottleCalibration
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.sets import PAPER
from tests.common import MOCK_2_URL

DECELERATION_NOISE = 0.02


@pytest.fixture(scope="module")
def files():
    with Car.open(MOCK_2_URL) as car:
        return car.files


def limit_brake(files, min_throttle):
    config = files.config
    limits = msgspec.structs.replace(config.limits, min_throttle=min_throttle)
    return replace(files, config=msgspec.structs.replace(config, limits=limits))


def with_brake(files, value, std=0.1):
    table = ThrottleCalibration(brake=Quantity(value, std))
    return replace(files, calibration=Calibration(car=files.config.name, throttle=table))


def make_runs(parts, full, seed):
    rng = np.random.default_rng(seed)
    friction = make_friction(PAPER.friction)
    speeds = rng.uniform(0.45, 0.8, len(parts))
    noise = DECELERATION_NOISE * rng.standard_normal(len(parts))
    return [(v, full * p - friction(v) / PAPER.body.mass + n)
            for p, v, n in zip(parts, speeds, noise, strict=True)]


def test_intervals_hold_the_brake(files):
    parts = brake.choose_parts(files)
    found = [brake.fit_brake(parts, make_runs(parts, 4.4, seed), files)[0] for seed in range(200)]
    inside = np.mean([abs(q.value - 4.4) < 1.645 * q.std for q in found])
    assert inside > 0.85


def test_nanos_clock_does_not_change_a_deceleration():
    t = np.arange(0.0, 0.4, 0.01)
    metres = 0.002
    # Of x = 1.2 t - 1.5 t^2 the edge of count n is at the smaller root.
    ticks = np.floor((1.2 * t - 1.5 * t**2) / metres).astype(int)
    edge_t = (1.2 - np.sqrt(1.2**2 - 6.0 * metres * ticks)) / 3.0
    before = (1.2 - np.sqrt(1.2**2 - 6.0 * metres * np.maximum(ticks - 1, 0))) / 3.0
    nano = 1.004
    pairs = [(SimpleNamespace(t_dev=7.0 + nano * at, ticks=int(n), edge_t=7.0 + nano * edge,
                              edge_dt=nano * (edge - last)), SimpleNamespace(t=100.0 + at))
             for at, n, edge, last in zip(t, ticks, edge_t, before, strict=True)]
    times, x = edge_distances(pairs, metres)
    assert -2.0 * np.polyfit(times, x, 2)[0] == pytest.approx(3.0, rel=1e-4)


def test_esc_without_brake_is_stated(files):
    parts = brake.choose_parts(files)
    found, note = brake.fit_brake(parts, make_runs(parts, 0.0, 1), files)
    assert found.value < 1.645 * found.std
    assert min_brake(with_brake(files, found.value, found.std)) == 0.0
    assert note.startswith("caution: no brake was found")


def test_owners_limit_bounds_the_pulses(files):
    assert max(brake.choose_parts(files)) == brake.MAX_PART
    assert max(brake.choose_parts(limit_brake(files, -0.3))) == 0.3
    assert brake.choose_parts(limit_brake(files, 0.0)) == ()


def test_weaker_brake_needs_more_of_the_pulse(files):
    usual = make_inverse_drive(with_brake(files, 4.8)).throttle_or_brake(1.5, -3.0)
    weak = make_inverse_drive(with_brake(files, 2.4)).throttle_or_brake(1.5, -3.0)
    assert usual < 0.0
    assert weak == pytest.approx(2.0 * usual)


def test_without_a_brake_the_car_rolls_out(files):
    assert make_inverse_drive(with_brake(files, 0.0)).throttle_or_brake(1.5, -3.0) == COAST_THROTTLE


def test_plan_uses_the_lower_end_within_the_owners_limit(files):
    measured = with_brake(files, 4.4, 0.2)
    assert min_brake(measured) == pytest.approx(4.4 - 1.645 * 0.2, abs=1e-3)
    assert min_brake(limit_brake(measured, -0.3)) == pytest.approx(0.3 * min_brake(measured))


def test_profile_brakes_as_hard_as_the_car_can(files):
    """The steepest deceleration of a plan is that of brake and friction, and no more."""
    track = track_named("oval")
    friction = make_friction(PAPER.friction)
    steepest = {}
    for min_throttle in (-1.0, -0.2):
        plant = plant_of(limit_brake(with_brake(files, 3.0, 0.01), min_throttle))
        speed = speed_profile(track, plant, 4.0).speed
        steepest[min_throttle] = -float(np.diff(speed**2).min()) / (2.0 * track.spacing)
        at_most = plant.brake - friction(4.0) / PAPER.body.mass
        assert steepest[min_throttle] < at_most
    assert steepest[-0.2] < steepest[-1.0], "the limit of the owner counts"
