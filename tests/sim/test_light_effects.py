"""Vehicles with effects in the light simulation: what sensors read, car by car and in batches."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dart_hal.core.errors import UsageError
from dart_hal.vehicle import GRAVITY, UPSTREAM_2024
from dart_hal.vehicle.channels import Stepper
from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.effects import add_effects, apply, catalogue, parse_effects
from dart_hal.vehicle.steering import make_steering
from dart_lab.sim.light import (
    FIRMWARE,
    PERFECT,
    RECORDED,
    Inertial,
    LightBatch,
    LightCar,
    LightConfig,
    Mocap,
    Sensors,
)
from dart_lab.sim.light.effects import COMMAND_CHANNELS

DRIVE_STEPS = 150
WITH_SIGNALS = [name for name, of in catalogue().items() if of.signals]
ROLLING = replace(UPSTREAM_2024, kind="kinematic")


def car_with(text, config=None, base=UPSTREAM_2024, seed=0):
    return LightCar(add_effects(base, parse_effects(text)), config, seed)


def command(k):
    return 0.3 + 0.15 * (k % 50 > 25), 0.6 if k % 70 > 35 else -0.4


def drive(car, steps=DRIVE_STEPS):
    """Readings (steps, 8)."""
    return np.array([car.drive(*command(k)) for k in range(steps)])


def large(name):
    of = catalogue()[name]
    return f"{name}:{of.parameters[0].sizes[2]}"


@pytest.fixture(scope="module")
def plain():
    return drive(LightCar(UPSTREAM_2024))


@pytest.mark.slow_except("*encoder*", "*gyro*", "mass", "battery_fade")
@pytest.mark.parametrize("name", catalogue())
def test_every_effect_shows_in_some_reading(name, plain):
    found = np.abs(drive(car_with(large(name))) - plain).max(axis=0)
    assert found.max() > 4e-3


@pytest.mark.slow_except("sensors1-*")
@pytest.mark.parametrize("name", catalogue())
@pytest.mark.parametrize("sensors", [PERFECT, FIRMWARE])
def test_at_null_the_numbers_are_the_same_to_the_last_bit(name, sensors):
    config = LightConfig(sensors=sensors)
    nulls = ":".join(f"{q.name}={q.null}" for q in catalogue()[name].parameters)
    one, other = LightCar(UPSTREAM_2024, config, 3), car_with(f"{name}:{nulls}", config, seed=3)
    assert np.array_equal(drive(one, 40), drive(other, 40))


@pytest.mark.parametrize("name", WITH_SIGNALS)
@pytest.mark.parametrize("sensors", [PERFECT, RECORDED])
@pytest.mark.slow_except("sensors0-gyro_bias")
def test_a_batch_is_its_cars_also_when_some_begin_again(name, sensors):
    """Cars of other sizes of the effect, one of which is reset on the way."""
    config = LightConfig(sensors=sensors)
    vehicles = [add_effects(UPSTREAM_2024, parse_effects(f"{name}:{size}"))
                for size in catalogue()[name].parameters[0].sizes]
    batch = LightBatch(vehicles, 3, config, seed=[[7, i] for i in range(3)])
    cars = [LightCar(p, config, [7, i]) for i, p in enumerate(vehicles)]
    start = np.array([0.0, 0.0, 0.3, 1.2, 0.0, 0.1])
    for k in range(60):
        if k == 30:
            batch.reset(start[:, None], np.array([1]))
            cars[1].reset(*start)
        throttle, steering = command(k)
        read = batch.drive(np.full(3, throttle), np.full(3, steering))
        alone = [car.drive(throttle, steering) for car in cars]
        for i, one in enumerate(alone):
            assert [column[i] for column in read[1:]] == pytest.approx(one[1:], abs=1e-9)


@pytest.mark.parametrize("name", [n for n in WITH_SIGNALS
                                  if set(catalogue()[n].signals) & {"steering", "angle"}])
def test_the_wheels_are_where_the_signals_put_them(name):
    """A car without slip shows its angle; the law is the one that every simulator steps."""
    p = replace(add_effects(ROLLING, parse_effects(large(name))), delay=ROLLING.delay)
    p = replace(p, delay=replace(p.delay, steering_s=0.0, steering_lag_s=0.0, throttle_s=0.0))
    car, curve = LightCar(p), make_steering(p.steering)
    turn, bend = Stepper(p, "steering", 0.01), Stepper(p, "angle", 0.01)
    bend(curve(turn(0.0, Now())), Now())            # at rest, wheels at the centre
    for k in range(DRIVE_STEPS):
        throttle, steering = command(k)
        car.advance(throttle, steering)
        expected = bend(curve(turn(steering, Now(0.01 * k))), Now(0.01 * k))
        turned = math.atan(car.state[5] * p.body.wheelbase / car.state[3])
        assert turned == pytest.approx(expected, abs=1e-9)


def test_readings_by_their_equations():
    start = {"v_x": 1.5, "v_y": 0.02, "yaw_rate": 0.8, "yaw": 0.4}
    plain = LightCar(UPSTREAM_2024)
    changed = car_with("gyro_bias:0.05,gyro_scale:0.03,encoder_scale:0.04,imu_pitch:0.1,"
                       "mocap_yaw:0.01,mocap_offset_x:0.02")
    for car in (plain, changed):
        car.reset(**start)
        car.advance(0.3, 0.2, 7)
    one, other = plain.read(), changed.read()
    assert changed.state == pytest.approx(plain.state, abs=1e-12)
    assert other.speed == pytest.approx(1.04 * one.speed)
    assert other.yaw_rate == pytest.approx((one.yaw_rate + 0.05) * 1.03 * math.cos(0.1))
    assert other.accel_x == pytest.approx(
        one.accel_x * math.cos(0.1) - GRAVITY * math.sin(0.1))
    assert other.yaw == pytest.approx(one.yaw + 0.01)
    assert math.hypot(other.x - one.x, other.y - one.y) == pytest.approx(0.02, abs=1e-9)


@pytest.mark.parametrize(("name", "columns"), [
    ("encoder_latency", [1]), ("gyro_latency", [2]), ("mocap_latency", [5, 6, 7]),
    ("clock_offset", [1, 2, 3, 4])])
def test_late_readings_are_those_of_then(name, columns, plain):
    late = drive(car_with(f"{name}:0.03"))
    assert late[3:, columns] == pytest.approx(plain[:-3, columns], abs=1e-12)
    others = [c for c in range(1, 8) if c not in columns]
    assert np.array_equal(late[:, others], plain[:, others])


def test_a_latency_of_a_part_of_a_step_is_between():
    def fine(text):
        return drive(car_with(text), 60)[30:, 2]

    mean = 0.5 * (fine("gyro_latency:0.02") + fine("gyro_latency:0.03"))
    assert fine("gyro_latency:0.025") == pytest.approx(mean, abs=1e-12)


def test_encoder_slip_follows_the_force():
    p = add_effects(UPSTREAM_2024, parse_effects("encoder_slip:0.04"))
    plain, changed = LightCar(UPSTREAM_2024), LightCar(p)
    for car in (plain, changed):
        car.reset(v_x=1.5)
    pulling = [car.drive(0.6, 0.0, 30).speed for car in (plain, changed)]
    coasting = [car.drive(0.0, 0.0, 40).speed for car in (plain, changed)]
    assert pulling[1] > 1.02 * pulling[0]
    assert coasting[1] < 0.99 * coasting[0]


@pytest.mark.slow
def test_battery_fade_is_of_the_time_since_the_reset():
    def gained(text, wait):
        car = car_with(text)
        car.advance(0.0, 0.0, wait)
        car.advance(0.3, 0.0, 60)
        return car.state[3]

    assert gained("battery_fade:0", 3000) == pytest.approx(gained("battery_fade:0", 0), abs=1e-9)
    assert gained("battery_fade:-0.5", 3000) < 0.85 * gained("battery_fade:-0.5", 0)


def test_the_future_is_refused_and_an_age_makes_it_the_past():
    with pytest.raises(UsageError, match="need the future"):
        car_with("clock_offset:-0.02")
    aged = Sensors(replace(PERFECT.encoder, age=0.03), Inertial(age=0.03), Inertial(age=0.03),
                   Mocap())
    config = LightConfig(sensors=aged)
    early = drive(car_with("clock_offset:-0.02", config))
    plain = drive(LightCar(UPSTREAM_2024, config))
    assert early[20:-2, 1:5] == pytest.approx(plain[22:, 1:5], abs=1e-12)


def test_parameters_may_change_and_new_sensors_may_not():
    car = car_with("gyro_latency:0.03,steering_backlash:0.05")
    car.advance(0.3, 0.5, 20)
    car.set_vehicle(apply(car.vehicle, "gyro_latency", k=0.05))
    car.drive(0.3, 0.2, 5)
    with pytest.raises(UsageError, match="history of the sensors is too short"):
        car.set_vehicle(apply(car.vehicle, "gyro_latency", k=0.09))
    with pytest.raises(UsageError, match="history of the sensors is too short"):
        LightCar(UPSTREAM_2024).set_vehicle(apply(UPSTREAM_2024, "gyro_bias", k=0.1))


def test_no_command_of_the_catalogue_waits():
    """Else the light simulation would have to refuse it: delays are the vehicle's own."""
    assert not [n for n, of in catalogue().items() for c in COMMAND_CHANNELS
                if type(of.signals.get(c)).__name__ == "Late"]
