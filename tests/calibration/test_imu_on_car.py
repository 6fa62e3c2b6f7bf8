"""`calibrate imu` through the whole Car, against the hidden truth of simulated cars."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fit_graphs import distance_from_fit

from dart_hal.calibration.imu import PULLS, calibrate_imu
from dart_hal.calibration.imu_fit import GyroRest, MeasuredTurn, fit_axis, measure_rest, yaw_bias
from dart_hal.calibration.measured import write
from dart_hal.calibration.sensor_log import ImuSamples
from dart_hal.car import Car
from dart_hal.core.errors import CalibrationFailed
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation.frames import Mounting
from dart_lab.sim.truth import reveal, world_of

URL = "sim://?nano=mock&seed="


def measured(url, tmp_path, **options):
    backend = open_backend(url)
    with Car.over(backend, cars=tmp_path) as car:
        try:
            return car.files, calibrate_imu(car, backend.workshop, **options)
        finally:
            assert car.mode != "RAW"


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3, 5])
@pytest.mark.long_except("1")
def test_hidden_cars(tmp_path, seed):
    _, result = measured(f"{URL}{seed}", tmp_path)
    true = reveal(seed)["sensors"]
    for name, found in result.quantities.items():
        assert abs(found.value - true[name]) < 3.0 * found.std, name
    scale = result.quantities["imu.gyro_scale"]
    assert abs(scale.value - true["imu.gyro_scale"]) < 0.003
    assert scale.std < 0.0015
    assert distance_from_fit(result.graph) < 0.1
    assert np.ptp(result.graph.x) > 2.0, "the car speeds up and slows down"


@pytest.mark.slow
def test_each_straight_acceleration_begins_at_the_start(tmp_path):
    """Driven one after the other, three needed 5.4 m of a floor of 3 m."""
    backend = open_backend(f"{URL}1")
    world = world_of(backend)
    starts = []
    mark = backend.workshop.mark

    def mark_start():
        starts.append(world.truth().distance)
        mark()

    backend.workshop.mark = mark_start
    with Car.over(backend, cars=tmp_path) as car:
        calibrate_imu(car, backend.workshop, turns=1)
        ends = [*starts[1:], world.truth().distance]
    distances = [end - start for start, end in zip(starts[2:], ends[2:], strict=True)]
    assert len(distances) == PULLS
    assert max(distances) < 2.0


def test_control_an_uncalibrated_imu_misses_the_target():
    scale = [abs(reveal(seed)["sensors"]["imu.gyro_scale"] - 1.0) for seed in range(1, 21)]
    assert np.mean(np.array(scale) > 0.003) > 0.4


@pytest.mark.slow
def test_a_second_time_finds_the_same_and_not_the_rest_of_the_first(tmp_path):
    """The sensors are read in their own axes: what the file holds does not enter."""
    files, first = measured(f"{URL}2", tmp_path, turns=1)
    write(files, first)
    files, second = measured(f"{URL}2", tmp_path, turns=1)
    assert files.calibration.imu.gyro_scale.std == pytest.approx(
        first.quantities["imu.gyro_scale"].std, rel=0.01)
    for name, found in second.quantities.items():
        spread = math.hypot(found.std, first.quantities[name].std)
        assert abs(found.value - first.quantities[name].value) < 4.0 * spread, name


class Miscounted:
    """The simulated workshop, with a full turn too many the first time."""

    def __init__(self, workshop) -> None:
        self.mark, self._true, self._extra = workshop.mark, workshop.turns, [2.0 * math.pi, 0.0]

    def turns(self) -> float:
        return self._true() + self._extra.pop(0)


@pytest.mark.slow
def test_miscounted_turn_is_refused(tmp_path):
    backend = open_backend(f"{URL}2")
    with Car.over(backend, cars=tmp_path) as car, pytest.raises(
            CalibrationFailed, match="gyro and measured turns do not agree"):
        calibrate_imu(car, Miscounted(backend.workshop), turns=1)
    assert not list(tmp_path.rglob("calibration.toml"))


@pytest.mark.slow
@pytest.mark.parametrize(("alter", "url", "why"), [
    ("[steering]\ndirection = -1", "2", "to the left gives a yaw rate the other way"),
    ("[imu]\nmount_roll = 3.1416", "2", "to the left gives a yaw rate the other way"),
    ("", "2&fail=imu:off@20s", "no data of the IMU"),
    ("", "2&fail=esc:wrong@0s", "drives the car backward"),
    ("", "2&fail=enc:off@20s", "encoder does not count"),
    ("", "2&fail=wheel:stuck@20s", "a wheel is blocked"),
    ("", "2&fail=esc:off@20s", "motor does not answer")])
def test_wrong_wiring_is_named(tmp_path, alter, url, why):
    backend = open_backend(URL + url)
    table = alter.partition("\n")[0]
    assert not table or table in backend.car_toml
    if table:
        backend.car_toml = backend.car_toml.replace(table, alter)
    with Car.over(backend, cars=tmp_path) as car, pytest.raises(CalibrationFailed, match=why):
        calibrate_imu(car, backend.workshop, turns=1)
    assert not list(tmp_path.rglob("calibration.toml"))


@pytest.mark.parametrize("roll", [0.04, math.pi, -1.5])
def test_axis_gives_back_scale_and_tilt(roll):
    """Also of an IMU upside down or on its side."""
    mounting, scale = Mounting(roll, 0.03, 0.5), 1.007
    vertical = np.array(mounting.matrix()).reshape(3, 3)[2]
    bias, t = np.array([0.01, -0.004, 0.002]), np.arange(0.0, 20.0, 0.01)
    turns = [MeasuredTurn(ImuSamples(t, scale * np.outer(np.full_like(t, rate), vertical) + bias,
                         np.zeros((len(t), 3)), np.zeros_like(t)), rate * (t[-1] - t[0]))
             for rate in (0.7, -0.7)]
    tilted = fit_axis(turns, GyroRest(bias, np.full(3, 1e-4)))
    assert tilted.scale.value == pytest.approx(scale)
    assert tilted.pitch.value == pytest.approx(0.03)
    assert math.remainder(tilted.roll.value - roll, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
    found = yaw_bias(GyroRest(bias, np.full(3, 1e-4)), tilted.axis)
    assert found.value == pytest.approx(vertical @ bias / scale)


def test_bias_counts_slow_noise():
    """Batches see a random walk that the scatter of samples would average away."""
    rng, t = np.random.default_rng(3), np.arange(0.0, 10.0, 0.01)
    white = rng.normal(0.0, 1e-3, (len(t), 3))
    walk = np.cumsum(rng.normal(0.0, 1e-4, (len(t), 3)), axis=0)
    still = [measure_rest(ImuSamples(t, noise, white, t)) for noise in (white, white + walk)]
    assert np.all(still[1].std > 3.0 * still[0].std)
