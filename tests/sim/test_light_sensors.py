"""Sensors of the light path: window, quantum, noise, age, each by a law of its own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dart_hal.core.errors import ConfigError
from dart_hal.vehicle import UPSTREAM_2024
from dart_lab.sim.light import (
    PERFECT,
    RECORDED,
    Encoder,
    Inertial,
    LightBatch,
    LightCar,
    LightConfig,
    Mocap,
    Sensors,
)
from dart_lab.sim.light.config import GYRO_DENSITY, GYRO_QUANTUM


def car_with(**sensors):
    return LightCar(UPSTREAM_2024, LightConfig(sensors=replace(PERFECT, **sensors)))


def turn(car, steps=150, start=2.0):
    """Readings and true states of a drive that brakes in a turn."""
    car.reset(v_x=start, steering=0.4)
    rows = [(car.read(), car.state)]
    for _ in range(steps):
        car.advance(0.2, 0.4)
        rows.append((car.read(), car.state))
    return rows


def test_perfect_sensors_read_the_truth():
    for r, (x, y, yaw, u, _, om, _, _) in turn(car_with()):
        l_r = UPSTREAM_2024.body.l_r
        assert (r.speed, r.yaw_rate, r.yaw) == (u, om, yaw)
        assert math.hypot(r.x - x, r.y - y) == pytest.approx(l_r)


def test_the_accelerometer_measures_the_turn():
    car = car_with()
    car.reset(v_x=1.0)
    car.advance(0.28, 0.5, 600)
    r = car.read()
    assert r.accel_y == pytest.approx(car.state[3] * r.yaw_rate, rel=1e-3)
    assert abs(r.accel_y) > 0.5


def test_the_recorded_encoder_counts_and_is_old():
    """Counts of 0.1 s: whole quanta, and on a ramp the speed of 50 ms ago."""
    rows = turn(LightCar(UPSTREAM_2024, LightConfig(sensors=RECORDED)))
    quantum = RECORDED.encoder.metres_per_count / 0.1
    truth = [state[3] for _, state in rows]
    errors = {"old": [], "now": []}
    for k in range(20, 150, 10):
        r = rows[k][0]
        assert r.speed / quantum == pytest.approx(round(r.speed / quantum))
        errors["old"].append(r.speed - truth[k - 5])
        errors["now"].append(r.speed - truth[k])
    assert abs(np.mean(errors["old"])) < 0.35 * quantum
    assert max(map(abs, errors["old"])) < 1.1 * quantum
    assert np.mean(errors["now"]) > 1.5 * quantum, "the control: braking, it reads too much"


def test_the_recorded_encoder_changes_every_tenth_of_a_second_only():
    speeds = [r.speed for r, _ in turn(LightCar(UPSTREAM_2024, LightConfig(sensors=RECORDED)))]
    changes = {k % 10 for k in range(1, 150) if speeds[k] != speeds[k - 1]}
    assert changes == {0}


def test_a_noisy_sample_stays_until_the_next_one():
    car = car_with(gyro=Inertial(period=0.05, density=0.01), encoder=Encoder(0.05, noise=0.1))
    rows = [r for r, _ in turn(car, 50)]
    for name in ("yaw_rate", "speed"):
        values = [getattr(r, name) for r in rows]
        assert {k % 5 for k in range(1, 51) if values[k] != values[k - 1]} == {0}


@pytest.mark.parametrize("speed", [1.0, -2.0])
def test_a_car_is_taken_to_have_come_at_the_speed_it_starts_with(speed):
    car = LightCar(UPSTREAM_2024, LightConfig(sensors=RECORDED))
    car.reset(v_x=speed)
    assert car.read().speed == pytest.approx(abs(speed), abs=0.021)
    car = car_with(mocap=Mocap(age=0.1), encoder=Encoder(window=0.1))
    car.reset(x=UPSTREAM_2024.body.l_r, v_x=speed)
    assert car.read().x == pytest.approx(-0.1 * speed)
    assert car.read().speed == pytest.approx(speed)


def test_the_first_reading_after_a_reset_is_of_the_new_place():
    sensors = replace(PERFECT, mocap=Mocap(dropout=0.9))
    batch = LightBatch(UPSTREAM_2024, 50, LightConfig(sensors=sensors), seed=1)
    car = LightCar(UPSTREAM_2024, LightConfig(sensors=sensors), seed=1)
    for k in range(1, 20):
        start = np.full((6, 50), float(k))
        batch.reset(start)
        np.testing.assert_allclose(batch.read().yaw, k)
        car.reset(yaw=float(k))
        assert car.read().yaw == k


@pytest.mark.parametrize("window", [0.0, 0.1])
def test_an_unsigned_encoder_does_not_see_reverse(window):
    for signed in (True, False):
        car = car_with(encoder=Encoder(window=window, signed=signed))
        car.advance(-0.4, 0.0, 200)
        assert (car.read().speed < 0.0) is signed
        assert abs(car.read().speed) == pytest.approx(-car.state[3], abs=0.02)


@pytest.mark.parametrize("age", [0.01, 0.013, 0.025, 0.05])
def test_age_is_to_the_moment(age):
    car = car_with(mocap=Mocap(age=age), gyro=Inertial(age=age), encoder=Encoder(age=age))
    rows = turn(car)
    t = 0.01 * np.arange(len(rows))
    for k in (30, 77, 140):
        r = rows[k][0]
        for name, i in (("speed", 3), ("yaw_rate", 5), ("yaw", 2)):
            truth = np.interp(t[k] - age, t, [s[i] for _, s in rows])
            assert getattr(r, name) == pytest.approx(truth, abs=1e-9)


def test_scale_offset_quantum():
    car = car_with(gyro=Inertial(scale=1.02, offset=0.3, quantum=GYRO_QUANTUM))
    for r, state in turn(car):
        digits = r.yaw_rate / GYRO_QUANTUM
        assert digits == pytest.approx(round(digits), abs=1e-6)
        assert r.yaw_rate == pytest.approx(1.02 * state[5] + 0.3, abs=0.51 * GYRO_QUANTUM)


def test_a_quantum_is_one_sixteenth_of_a_degree_per_second():
    assert pytest.approx(0.00109083, rel=1e-5) == GYRO_QUANTUM


@pytest.mark.parametrize("period", [0.01, 0.02, 0.1])
def test_white_noise_has_its_density(period):
    """Sigma of a sample is density / sqrt(2 period): the band of the sampling."""
    sensors = replace(PERFECT, gyro=Inertial(period=period, density=GYRO_DENSITY))
    batch = LightBatch(UPSTREAM_2024, 200, LightConfig(sensors=sensors), seed=1)
    still = np.zeros(200)
    got = np.array([batch.drive(still, still, round(period / 0.01)).yaw_rate for _ in range(40)])
    assert got.std() == pytest.approx(GYRO_DENSITY * math.sqrt(0.5 / period), rel=0.03)
    assert abs(np.mean(got[1:] * got[:-1])) < 0.05 * got.var(), "white"
    assert abs(np.mean(got[:, 1:] * got[:, :-1])) < 0.05 * got.var(), "each car its own"


def test_a_bias_is_drawn_at_the_reset_and_stays():
    sensors = replace(PERFECT, gyro=Inertial(offset_spread=0.02))
    batch = LightBatch(UPSTREAM_2024, 500, LightConfig(sensors=sensors), seed=1)
    still = np.zeros(500)
    first, later = (np.array(batch.drive(still, still).yaw_rate) for _ in range(2))
    np.testing.assert_allclose(first, later, atol=1e-12)
    assert first.std() == pytest.approx(0.02, rel=0.1)
    batch.reset()
    assert np.abs(np.array(batch.drive(still, still).yaw_rate) - first).min() > 1e-9


def test_motion_capture_loses_samples_and_keeps_the_last_pose():
    sensors = replace(PERFECT, mocap=Mocap(dropout=0.3, noise=1e-4, yaw_noise=5e-4))
    batch = LightBatch(UPSTREAM_2024, 300, LightConfig(sensors=sensors), seed=1)
    start = np.zeros((6, 300))
    start[3] = 1.0
    batch.reset(start)
    u = np.full(300, 0.25)
    got = np.array([np.array(batch.read().x)] + [batch.drive(u, 0 * u).x for _ in range(60)])
    held = got[1:] == got[:-1]
    assert held.mean() == pytest.approx(0.3, abs=0.02)
    assert held[:, 7].any()
    assert not held[:, 7].all()


@pytest.mark.slow
def test_noise_of_motion_capture():
    sensors = replace(PERFECT, mocap=Mocap(noise=1e-4, yaw_noise=5e-4))
    batch = LightBatch(UPSTREAM_2024, 2000, LightConfig(sensors=sensors), seed=1)
    r = batch.read()
    assert np.std(r.x) == pytest.approx(1e-4, rel=0.06)
    assert np.std(r.yaw) == pytest.approx(5e-4, rel=0.06)


def test_refusals():
    with pytest.raises(ConfigError, match="whole number of steps"):
        LightCar(config=LightConfig(sensors=Sensors(encoder=Encoder(period=0.015))))
    with pytest.raises(ConfigError):
        Mocap(dropout=1.0)
    with pytest.raises(ConfigError):
        Encoder(age=-0.01)
