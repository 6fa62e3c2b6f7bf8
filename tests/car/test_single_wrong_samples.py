"""Single wrong samples of the IMU: what they do to pose, covariance, doubts and speed."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from estimator_input import ACCEL_X, ACCEL_Y, GYRO_Z, RecordedFrames, flip, yaw_sigma

from dart_hal.car import Car, telemetry
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of

pytestmark = pytest.mark.usefixtures("armed_esc")
DEGREE = math.pi / 180
RANGE_BIT = 12
"""From this bit of a gyro word on, the step is impossible and the sample not given out."""


def slalom(car, t):
    car.drive_speed(steering=0.25 * math.sin(math.pi * t), speed=1.0)


def hard_steps(car, t):
    car.drive_speed(steering=0.3 if int(2 * t) % 2 else -0.3, speed=1.5)


def straight(car, t):
    car.drive_speed(steering=0.0, speed=1.0)


def full_throttle_and_brake(car, t):
    car.drive(steering=0.2 * (int(t) % 2), throttle=0.6 if int(1.5 * t) % 2 else -0.2,
              valid_for=0.5)


MANOEUVRES = {"slalom": slalom, "steps": hard_steps, "straight": straight,
              "throttle": full_throttle_and_brake}
_made: dict[tuple[str, int, float], RecordedFrames] = {}


@pytest.fixture(scope="module")
def drives(tmp_path_factory):
    """By manoeuvre, seed and s: the frames of a hidden car, recorded once."""
    def make(name: str, seed: int = 3, seconds: float = 6.0) -> RecordedFrames:
        key = name, seed, seconds
        if key not in _made:
            _made[key] = RecordedFrames(tmp_path_factory.mktemp("car"),
                                        f"sim://?nano=mock&seed={seed}", MANOEUVRES[name], seconds)
        return _made[key]
    yield make
    _made.clear()


class NoSampleFilter(telemetry.SingleSampleFilter):
    """The layer taken away: every sample is accepted, and no residual is stated."""

    def add(self, t, value, stamp):
        return telemetry.AcceptedSample(value, stamp)


@pytest.mark.slow
def test_without_wrong_samples_nothing_changes(drives, monkeypatch):
    drive = drives("slalom")
    states = drive.estimate()
    assert states[-1].pose.yaw == pytest.approx(drive.states[-1].pose.yaw, abs=1e-3)
    assert states[-1].health.jumped == 0
    assert not any("SAMPLES_JUMPED" in s.health.doubts for s in states)
    monkeypatch.setattr(telemetry, "SingleSampleFilter", NoSampleFilter)
    plain = drive.estimate()
    assert states[-1].pose.yaw == pytest.approx(plain[-1].pose.yaw, abs=1e-4)
    late = sum(a.yaw_rate != b.yaw_rate for a, b in zip(states, plain, strict=True))
    assert late < 0.03 * len(states), "where the steering begins to turn, one sample late"
    assert yaw_sigma(states) == pytest.approx(yaw_sigma(plain), rel=0.01)


@pytest.mark.slow
def test_one_wrong_bit_in_a_hundred_samples_leaves_the_yaw_alone(drives, monkeypatch):
    """Control: without the filter the yaw is far off, and the stated error does not cover it."""
    drive = drives("straight")
    clean = drive.yaw_error(drive.estimate())
    states = drive.estimate(flip(GYRO_Z, 11, 100))
    assert drive.yaw_error(states) == pytest.approx(clean, abs=0.2 * DEGREE)
    assert yaw_sigma(states) < 1.1 * yaw_sigma(drive.estimate())
    assert states[-1].health.jumped == pytest.approx(len(states) / 100, abs=1)
    assert "SAMPLES_JUMPED" in states[-1].health.doubts
    assert all(abs(s.yaw_rate) < 0.3 for s in states), "no wrong sample is given out"
    monkeypatch.setattr(telemetry, "SingleSampleFilter", NoSampleFilter)
    states = drive.estimate(flip(GYRO_Z, 11, 100))
    assert abs(drive.yaw_error(states)) > 3 * yaw_sigma(states)


def sizes(names):
    """(manoeuvre, bit, one in, in a row) of every test of the covariance."""
    return list(product(names, range(16), (5, 100, 1000), (1, 2)))


QUICK_CASES = [("slalom", 9, 5, 1), ("straight", 4, 5, 1), ("straight", 9, 100, 2)]


def check_covered(drive, bit, every, run):
    states = drive.estimate(flip(GYRO_Z, bit, every, run, phase=3))
    error = abs(drive.yaw_error(states))
    sigma = yaw_sigma(states)
    assert error < 3 * sigma, (bit, every, run, error / DEGREE, sigma / DEGREE)


@pytest.mark.parametrize(("name", "bit", "every", "run"), QUICK_CASES)
@pytest.mark.slow
def test_covariance_covers_wrong_samples(drives, name, bit, every, run):
    check_covered(drives(name), bit, every, run)


@pytest.mark.slow
@pytest.mark.parametrize("name", MANOEUVRES)
@pytest.mark.long_except("slalom")
def test_covariance_covers_wrong_samples_of_every_size(drives, name):
    drive = drives(name)
    for _, bit, every, run in sizes([name]):
        check_covered(drive, bit, every, run)


@pytest.mark.slow
def test_stated_variance_is_that_of_the_errors(drives):
    """NEES of the yaw over cars, sizes and rates: not overconfident."""
    squares = []
    for seed, (bit, every, run) in product((3, 5, 7, 11), ((3, 5, 1), (5, 5, 1), (8, 20, 1),
                                                           (11, 100, 1), (7, 50, 2), (10, 200, 2))):
        drive = drives("slalom", seed)
        states = drive.estimate(flip(GYRO_Z, bit, every, run, seed))
        squares.append((drive.yaw_error(states) / yaw_sigma(states))**2)
    assert np.mean(squares) < 1.5, squares


@pytest.mark.slow
def test_wrong_samples_at_rest_teach_no_bias(drives, monkeypatch):
    """They begin before the car drives. Control: without the filter the bias is off."""
    drive = drives("straight")
    change = flip(GYRO_Z, 6, 5)
    clean = drive.yaw_error(drive.estimate())
    assert drive.yaw_error(drive.estimate(change, first=0)) == pytest.approx(
        clean, abs=0.3 * DEGREE)
    monkeypatch.setattr(telemetry, "SingleSampleFilter", NoSampleFilter)
    states = drive.estimate(change, first=0)
    assert abs(drive.yaw_error(states) - clean) > 10.0 * DEGREE


@pytest.mark.slow_except("False")
@pytest.mark.parametrize("filtered", [True, False])
def test_wrong_accelerations_accuse_no_encoder(drives, monkeypatch, filtered):
    """Bit 11 is 20 m/s2. Control: without the filter the encoder is doubted."""
    if not filtered:
        monkeypatch.setattr(telemetry, "SingleSampleFilter", NoSampleFilter)
    drive = drives("slalom")
    states = drive.estimate(flip(ACCEL_X, 11, 5))
    doubted = any(name.startswith("ENCODER") for s in states for name in s.health.doubts)
    assert doubted != filtered
    assert (max(abs(s.accel_x) for s in states) > 15.0) != filtered


@pytest.mark.slow
@pytest.mark.parametrize("name", MANOEUVRES)
@pytest.mark.long_except("throttle")
def test_wrong_accelerations_of_every_size_change_neither_pose_nor_speed(drives, name):
    drive = drives(name)
    clean = drive.estimate()
    for word, bit, every in product((ACCEL_X, ACCEL_Y), range(RANGE_BIT + 1), (5, 100, 1000)):
        states = drive.estimate(flip(word, bit, every, phase=3))
        assert [s.pose.x for s in states] == [s.pose.x for s in clean], (word, bit, every)
        assert [s.speed for s in states] == [s.speed for s in clean], (word, bit, every)


@pytest.mark.slow_except("slalom")
@pytest.mark.parametrize("name", MANOEUVRES)
def test_true_motion_is_never_rejected(drives, name):
    states = drives(name).estimate()
    assert states[-1].health.jumped == 0


@pytest.mark.slow
def test_drive_with_wrong_samples_replays_bit_for_bit(tmp_path):
    backend = open_backend("sim://?nano=mock&seed=3")
    imu = world_of(backend).nano.imu
    shown = imu._apply_fault

    def flip_bit(values, slot):
        words = list(shown(values, slot))
        words[5] ^= (slot % 20 == 0) << 9
        return tuple(words)

    imu._apply_fault = flip_bit
    run = tmp_path / "run.mcap"
    live = []
    with Car.over(backend, cars=tmp_path, record=run) as car:
        for _ in car.states(duration=2.2):
            pass
        car.arm(waive=["CALIBRATION_MISSING"])
        for state in car.states(duration=1.0):
            slalom(car, state.t)
            live.append(state)
    assert live[-1].health.jumped > 5
    with Car.open(f"replay://{run}") as car:
        again = list(car.states())[-len(live):]
    for a, b in zip(live, again, strict=True):
        assert (a.t, a.yaw_rate, a.pose.x, a.pose.yaw, a.health) == \
            (b.t, b.yaw_rate, b.pose.x, b.pose.yaw, b.health)
        assert np.array_equal(a.pose.cov, b.pose.cov)
