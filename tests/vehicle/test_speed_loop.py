"""A motor with a speed loop: its force, its file, and who refuses it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dart_hal.control.drivetrain import InverseDrive
from dart_hal.core.config import load_model, save_model
from dart_hal.core.errors import ConfigError, UsageError
from dart_hal.estimation.bounds import SpeedBounds
from dart_hal.vehicle import (
    PAPER,
    UPSTREAM_2024,
    SpeedLoop,
    make_car_step,
    make_motor,
    make_motor_gains,
    rollout,
    stack,
)
from dart_hal.vehicle.effects import apply, catalogue, is_applicable
from dart_hal.vehicle.file import model_of, vehicle_from
from dart_hal.vehicle.flat import bounds, names
from dart_hal.vehicle.scale import REFERENCE_MASS
from dart_lab.sim.light import LightCar

SPEED_LOOP = SpeedLoop(gain=8.0, max_force=6.0)
CAR = replace(PAPER, name="loop", motor=SPEED_LOOP)


@pytest.mark.parametrize(("command", "speed", "force"), [
    (1.5, 1.0, 4.0), (1.0, 1.5, -4.0), (3.0, 1.0, 6.0), (0.0, 2.0, -6.0), (-1.0, -0.75, -2.0)])
def test_force_is_gain_times_excess_within_the_largest_force(command, speed, force):
    assert make_motor(SPEED_LOOP)(command, speed) == force


def test_car_settles_where_the_force_equals_the_friction():
    state = (0.0,) * 8
    step = make_car_step(CAR)
    for _ in range(1000):
        state = step(*state, 1.5, -CAR.steering.s0)
    f = CAR.friction
    resistance = f.a * math.tanh(f.b * state[3]) + f.c * state[3]
    assert state[3] == pytest.approx(1.5 - resistance / SPEED_LOOP.gain, abs=1e-4)


def test_largest_acceleration_is_that_of_the_largest_force():
    state = (0.0,) * 8
    step = make_car_step(replace(CAR, friction=replace(CAR.friction, a=0.0, c=0.0)))
    for _ in range(20):
        state = step(*state, 5.0, -CAR.steering.s0)
    assert state[3] == pytest.approx(0.2 * SPEED_LOOP.max_force / CAR.body.mass, rel=1e-3)


def test_kinematic_and_dynamic_cars_have_the_same_loop():
    start = np.zeros((6, 1))
    command, angle = np.full((200, 1), 1.2), np.zeros((200, 1))
    speeds = [rollout(replace(CAR, kind=kind), start, command, angle)[-1, 3, 0]
              for kind in ("dynamic", "kinematic")]
    assert speeds[0] == pytest.approx(speeds[1], rel=1e-9)


def test_file_keeps_the_form(tmp_path):
    path = save_model(model_of(CAR), tmp_path / "model.toml")
    model = load_model(path)
    assert model.forms["motor"] == "speed"
    assert vehicle_from(model, PAPER) == CAR
    assert vehicle_from(model) == CAR
    assert "motor" not in model_of(PAPER).forms, "files of duty motors are as before"


@pytest.mark.parametrize(("forms", "motor"), [
    ({"motor": "torque"}, {"gain": 8.0, "max_force": 6.0}),
    ({"motor": "speed"}, {"gain": 8.0}),
    ({"motor": "speed"}, {"gain": 8.0, "max_force": 6.0, "d": 20.0}),
    ({}, {"gain": 8.0, "max_force": 6.0}),
    ({"motor": "speed"}, {"gain": 8.0, "max_force": -6.0})])
def test_bad_motor_of_a_file_is_refused(forms, motor):
    import msgspec

    model = msgspec.structs.replace(model_of(PAPER), forms=forms, motor=motor)
    with pytest.raises(ConfigError):
        vehicle_from(model, PAPER)


def test_bounds_scale_with_the_mass():
    heavy = replace(CAR, body=replace(CAR.body, wheelbase=0.6, l_f=0.3, l_r=0.3, mass=72.0,
                                      yaw_inertia=6.0))
    assert bounds(CAR, "motor.gain") == (0.1, 200.0)
    assert bounds(heavy, "motor.max_force")[1] == pytest.approx(200.0 * 72.0 / REFERENCE_MASS)
    assert {"motor.gain", "motor.max_force"} <= set(names(CAR))


def test_motors_of_two_forms_do_not_stack():
    with pytest.raises(UsageError, match="different equations"):
        stack([PAPER, replace(PAPER, motor=SPEED_LOOP)])


@pytest.mark.parametrize("use", [
    lambda: make_motor_gains(SPEED_LOOP), lambda: InverseDrive(CAR), lambda: SpeedBounds(CAR, True),
    lambda: LightCar(CAR)], ids=["gains", "inverse", "bounds", "simulation"])
def test_users_of_a_duty_motor_refuse_a_speed_loop(use):
    with pytest.raises(UsageError, match="speed loop") as refused:
        use()
    assert "identify all --joint" in refused.value.remedy


def test_effects_of_pulses_duty_and_battery_are_refused():
    excluded = {name for name, one in catalogue().items() if not is_applicable(one, CAR)}
    assert excluded == {"back_emf", "battery_fade", "motor_deadband", "motor_saturation",
                        "pwm_clock", "pwm_quantisation"}
    for name in excluded:
        with pytest.raises(ConfigError, match="speed loop"):
            apply(CAR, name)
        apply(UPSTREAM_2024, name)


@pytest.mark.parametrize("name", [n for n, e in catalogue().items() if not e.duty_only])
def test_every_other_effect_runs_with_a_speed_loop(name):
    p = apply(CAR, name)
    start = np.array([[0.0], [0.0], [0.0], [1.0], [0.0], [0.0]])
    command, angle = np.full((20, 1), 1.5), np.full((20, 1), 0.1)
    assert rollout(p, start, command, angle, engine="numpy") == pytest.approx(
        rollout(CAR, start, command, angle, engine="numpy"), abs=1e-12)
