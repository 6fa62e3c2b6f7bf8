"""Health of a lidar from the scans of a driven car."""

from __future__ import annotations

from math import pi, radians

import numpy as np
import pytest

from dart_hal.car import Car
from dart_hal.core.types import Scan
from dart_hal.devices.lidar.health import LidarHealthMonitor

URL = "sim://?nano=mock&physics=kinematic&seed="


def health(seed, lidar="1", seconds=4.0, steering=0.35):
    with Car.open(f"{URL}{seed}&lidar={lidar}") as car:
        assert car.lidar.health is None
        car.arm()
        for _ in car.states(duration=seconds):
            car.drive(steering=steering, throttle=0.3)
        return car.lidar.health


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.slow
def test_a_good_one_gives_nothing_to_look_at(seed):
    found = health(seed)
    assert list(found.sentences()) == []
    assert found.blind == ()
    assert found.lost == 0.0
    assert 0.6 < found.returned < 0.98  # a metre of glass, as near as it may be
    assert found.beams == pytest.approx(5000.0 / found.rate, rel=0.01)
    assert found.sense == pytest.approx(1.0, abs=0.3)


@pytest.mark.slow
def test_a_lidar_upside_down_against_its_car_file_is_detected_by_the_gyro():
    found = health(1, "clockwise=0")
    assert found.sense == pytest.approx(-1.0, abs=0.3)
    assert "turn against the gyro" in " ".join(found.sentences())


@pytest.mark.slow
def test_a_car_that_drives_straight_gives_no_sense():
    assert health(1, seconds=1.0, steering=0.0).sense is None


@pytest.mark.slow
def test_a_blind_sector_is_reported_with_its_angles():
    found = health(1, f"gap={radians(30.0)},yaw=0", seconds=2.0)
    ((start, end),) = found.blind
    # it is 30 deg wide, but the parallax puts its edges up to 8 deg further
    assert start == pytest.approx(radians(30.0), abs=radians(13.0))
    assert end == pytest.approx(radians(60.0), abs=radians(13.0))
    assert "nothing comes back from" in " ".join(found.sentences())


@pytest.mark.slow
def test_lost_packets_and_a_unit_that_is_too_fast_are_reported():
    found = health(1, "lost=0.1,rate=8.6", seconds=3.0)
    assert found.lost == pytest.approx(0.1, abs=0.05)
    messages = " ".join(found.sentences())
    assert "lost on the line" in messages
    assert "8.60 times a second" in messages


@pytest.mark.slow
def test_a_lidar_in_the_dark_is_blind_all_around():
    found = health(1, "dropout=1", seconds=1.0)
    assert found.blind == ((-pi, pi),)
    assert found.returned == 0.0
    assert "only 0 % of the beams have an echo" in " ".join(found.sentences())


def room_scan(yaw, start, rate=8.0, n=400):
    """A scan in a room of 6 x 3 m with a wing, from the middle, of a car at heading ``yaw``."""
    bearing = np.linspace(-pi, pi, n, endpoint=False)
    at = bearing + yaw
    distance = np.fmin(3.0 / np.fmax(np.abs(np.cos(at)), 1e-6),
                       1.5 / np.fmax(np.abs(np.sin(at)), 1e-6)) * (1.0 + 0.3 * (np.sin(at) > 0.8))
    after = np.linspace(0.0, 1.0 / rate, n, endpoint=False)
    return Scan(start + 1.0 / rate, start, rate, after, -bearing, distance)


@pytest.mark.parametrize(("turn", "pause"), [(2.0, 0.6), (0.5, 0.6)])
def test_scans_with_a_gap_between_them_are_not_compared(turn, pause):
    """The rotation that fits two scans of different places may have any sign."""
    watch = LidarHealthMonitor()
    for k in range(20):
        watch.add(room_scan(turn * k, (0.125 + pause) * k), turn * k)
    assert watch.sense is None
    control = LidarHealthMonitor()
    for k in range(20):
        control.add(room_scan(0.2 * k, 0.125 * k), 0.2 * k)
    assert control.sense == pytest.approx(1.0, abs=0.2)
