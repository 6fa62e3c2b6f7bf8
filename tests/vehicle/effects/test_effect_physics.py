"""Every effect: nothing at null, something at medium size, finite with every other one."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations, product

import numpy as np
import pytest

from dart_hal.vehicle import PAPER, make_car_step
from dart_hal.vehicle.bicycle import make_dynamic
from dart_hal.vehicle.channels import transform_signal
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.effect import (
    SIGNAL_CHANNELS,
    ActiveEffect,
    Effect,
    Forces,
    Now,
    Parameter,
    Static,
)
from dart_hal.vehicle.effects import activate, add_effects, apply, catalogue, find_effect
from dart_hal.vehicle.flat import names, value
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.tyres import make_slip, make_tyres
from tests.vehicle.effects.effect_drive import EFFECT_CARS, EFFECT_NAMES, SAMPLE_TIME, drive, medium

every_effect = pytest.mark.parametrize("name", EFFECT_NAMES)
MOVING = [n for n in EFFECT_NAMES if catalogue()[n].force or catalogue()[n].vehicle]
BATCH_SIZE = 40


def states(seed=3):
    """State and commands (10, N) of cars that rest, drive, slide and reverse."""
    draw = np.random.default_rng(seed)
    low = [-3.0, -3.0, -7.0, -1.5, -0.4, -4.0, -0.6, -0.9, -0.6, -0.9]
    high = [3.0, 3.0, 7.0, 3.5, 0.4, 4.0, 0.6, 0.9, 0.6, 0.9]
    x = draw.uniform(low, high, (BATCH_SIZE, 10)).T
    x[3:6, :4] = 0.0          # at rest, with and without commands
    x[:, 4] = 0.0
    return x


def series(channel, seed=4):
    """(signal, now) of N samples: both signs, zeros, a long stay."""
    draw = np.random.default_rng(seed)
    now = Now(np.arange(BATCH_SIZE) * SAMPLE_TIME,
              *draw.normal(size=(len(Now._fields) - 1, BATCH_SIZE)))
    rows = draw.uniform(-0.9, 0.9, ({"accel": 2, "pose": 3}.get(channel, 1), BATCH_SIZE))
    rows[:, 5:8] = 0.0
    return (tuple(rows) if len(rows) > 1 else rows[0]), now


def stays_neutral(p, with_effect):
    """Whether motion, signals and parameters are those of p, to the last bit."""
    x = states()
    motion = np.array_equal(make_car_step(p, np, SAMPLE_TIME)(*x),
                            make_car_step(with_effect, np, SAMPLE_TIME)(*x))
    same = all(value(apply_parameter_effects(with_effect), n) == value(p, n) for n in names(p))
    signals = True
    for channel in SIGNAL_CHANNELS:
        given, now = series(channel)
        signals &= np.array_equal(transform_signal(with_effect, channel, given, now, SAMPLE_TIME),
                                  given)
    return motion, signals, same


@pytest.mark.slow_except("paper-*", "*-grip", "*-front_grip", "*-steering_compliance",
                         "*-centre_of_mass")
@every_effect
@pytest.mark.parametrize("car", EFFECT_CARS)
def test_at_its_null_value_an_effect_changes_nothing(name, car):
    p = EFFECT_CARS[car]
    assert stays_neutral(p, apply(p, name)) == (True, True, True)


@pytest.mark.parametrize("hooks", [
    {"force": lambda p, f, k: lambda q: q._replace(f_yf=q.f_yf * (1.0 + k + 3e-16))},
    {"signals": {"gyro": Static(lambda p, f, k: lambda v, now: (v + 1.0 + k) - 1.0)}},
    {"vehicle": lambda p, k: replace(p, body=replace(p.body, mass=p.body.mass * (1.0 + 3e-16)))}],
    ids=["force", "signal", "vehicle"])
def test_the_test_of_the_null_sees_the_last_bit(hooks):
    almost = Effect("almost", "is almost the model", "-", "force",
                    (Parameter("k", "-", -1.0, 1.0, (0.1, 0.2, 0.4)),), (), "-", **hooks)
    p = replace(PAPER, effects=(ActiveEffect(almost, (0.0,)),))
    assert not all(stays_neutral(PAPER, p))


CHANGES = {
    "back_emf": ("v_x", 0.1), "battery_fade": ("v_x", 0.003),
    "centre_of_mass": ("omega", 0.05), "clock_offset": ("gyro", 0.15),
    "combined_slip": ("omega", 0.02),
    "cornering_drag": ("v_x", 0.05), "differential_drag": ("omega", 0.03),
    "encoder_axle": ("wheel", 0.001), "encoder_latency": ("wheel", 0.008),
    "encoder_ring": ("wheel", 0.1),
    "encoder_scale": ("wheel", 0.014), "encoder_slip": ("wheel", 0.009),
    "front_grip": ("omega", 0.06), "grip": ("omega", 0.05), "gyro_bias": ("gyro", 0.019),
    "gyro_latency": ("gyro", 0.2), "gyro_scale": ("gyro", 0.02), "imu_lever_arm": ("a_y", 0.2),
    "imu_offset_y": ("a_y", 0.02),
    "imu_pitch": ("a_x", 0.19), "imu_roll": ("a_y", 0.19), "imu_yaw": ("a_x", 0.05),
    "lateral_pull": ("omega", 0.02), "load_transfer": ("omega", 0.02), "mass": ("omega", 0.04),
    "mocap_latency": ("x", 0.02), "mocap_offset_x": ("x", 0.003), "mocap_offset_y": ("y", 0.003),
    "mocap_yaw": ("yaw", 0.0099), "motor_deadband": ("v_x", 0.05), "motor_gain": ("v_x", 0.06),
    "motor_saturation": ("v_x", 0.15), "pwm_clock": ("v_x", 0.08),
    "pwm_quantisation": ("v_x", 0.05), "quadratic_drag": ("v_x", 0.07),
    "rear_saturation": ("v_y", 0.014), "road_slope_x": ("v_x", 0.03),
    "road_slope_y": ("v_x", 0.02), "roll_compliance": ("omega", 0.02),
    "rolling_resistance": ("v_x", 0.07), "steering_backlash": ("omega", 0.06),
    "steering_compliance": ("omega", 0.025), "steering_dead_zone": ("omega", 0.05),
    "steering_delay": ("omega", 0.2),
    "steering_gain": ("omega", 0.01), "steering_lag": ("omega", 0.25),
    "steering_rate_limit": ("omega", 0.15), "steering_trim": ("omega", 0.025),
    "throttle_delay": ("a_x", 0.1), "throttle_lag": ("a_x", 0.1), "yaw_damping": ("omega", 0.03),
    "yaw_inertia": ("omega", 0.09)}
"""Channel of the standard drive, and the least rms change by the medium size (SI units)."""


@pytest.mark.slow_except("steering_compliance", "gyro_scale", "battery_fade")
@every_effect
def test_at_medium_size_it_shows_in_ten_seconds(name, base_drive):
    channel, least = CHANGES[name]
    of = find_effect(name)
    changed = drive(apply(PAPER, name, **medium(of)))

    def rms_change(c):
        return float(np.sqrt(np.mean((changed[c] - base_drive[c]) ** 2)))

    assert least < rms_change(channel) < 6.0 * least
    if of.stage == "measurement":
        assert all(rms_change(c) == 0.0 for c in ("v_x", "v_y", "omega")), "sensors move no car"


@pytest.mark.slow
def test_all_at_once_is_still_a_car(base_drive):
    one = add_effects(PAPER, (activate(e, medium(e, 0)) for e in catalogue().values()))
    other = add_effects(PAPER, (activate(e, medium(e, 0)) for e in reversed(catalogue().values())))
    got = drive(one)
    same = drive(other)
    for channel, signal in got.items():
        assert np.isfinite(signal).all()
        assert np.array_equal(signal, same[channel])
        assert not np.array_equal(signal, base_drive[channel])


@pytest.mark.slow
@pytest.mark.parametrize("car", EFFECT_CARS)
def test_any_two_compose_in_any_order(car):
    """Finite, equal whichever was named first, and equal to the one alone where the other is 0."""
    x = states()[:, :8]
    p = EFFECT_CARS[car]
    some = {n: activate(e, medium(e)) for n, e in catalogue().items()}
    for a, b in combinations(EFFECT_NAMES, 2):
        both = add_effects(p, (some[a], some[b]))
        assert both == add_effects(p, (some[b], some[a]))
        if {some[a].effect.stage, some[b].effect.stage} != {"measurement"}:
            assert np.isfinite(make_car_step(both, np, SAMPLE_TIME)(*x)).all(), f"{a} and {b}"
        for channel in {*some[a].effect.signals} & {*some[b].effect.signals}:
            given, now = series(channel)
            changed = transform_signal(both, channel, given, now, SAMPLE_TIME)
            assert np.isfinite(changed).all(), f"{a} and {b}"


# laws of single effects

def forces(p, *state):
    """(v_x', v_y', omega') of the effects of p alone, at a state (eta, v_x, v_y, omega, delta)."""
    eta, vx, vy, om, delta = state
    held = (0.0, 0.0, 0.0, math.cos(delta), math.sin(delta))
    with_them, without = (make_dynamic(apply_parameter_effects(q), math)(eta, vx, vy, om, *held)
                          for q in (p, replace(p, effects=())))
    return [a - b for a, b in zip(with_them[3:], without[3:], strict=True)]


@pytest.mark.parametrize("name", ["rolling_resistance", "quadratic_drag", "cornering_drag",
                                  "differential_drag", "yaw_damping"])
def test_what_resists_takes_energy_forwards_and_in_reverse(name):
    p = apply(PAPER, name, **medium(find_effect(name), 2))
    for v, (om, delta) in product((2.0, 0.05, -1.5), ((1.5, 0.3), (-1.5, -0.3), (0.7, -0.2))):
        ax, ay, alpha = forces(p, 0.3, v, 0.1, om, delta)
        power = PAPER.body.mass * (ax * v + ay * 0.1) + PAPER.body.yaw_inertia * alpha * om
        assert power < 0.0
    assert forces(p, 0.3, 0.0, 0.0, 0.0, 0.3) == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("name", MOVING)
def test_a_car_at_rest_without_commands_stays_at_rest(name):
    """Only a slope, and what shifts the zero of a command, moves it."""
    p = apply(replace(PAPER, steering=replace(PAPER.steering, s0=0.0)), name,
              **medium(find_effect(name), 2))
    # tyres at rest are stiff
    step = make_car_step(p, math, 0.0025)
    state = (0.0,) * 8
    for _ in range(200):
        state = step(*state, 0.0, 0.0)
    if name.startswith("road_slope"):
        assert 1e-4 < math.hypot(state[3], state[4]) < 0.1, "it creeps: dry friction is a tanh"
    else:
        assert max(map(abs, state)) < 1e-10, "the smooth dead band leaks 1e-13"


@pytest.mark.parametrize("k", [0.003, 0.03])
@pytest.mark.parametrize("car", EFFECT_CARS)
def test_compliance_solves_its_own_equation(k, car):
    """F = front(delta - k F), forwards: against a bisection."""
    p = EFFECT_CARS[car]
    front = make_tyres(p.tyres, p.body)[0]
    slip = make_slip(p.body, math, p.slip)
    share = 0.02 if p.slip == "all_speeds" else 0.05    # upstream's slip is bent up to 1 m/s
    for vx, vy, om, delta in ((1.5, 0.05, 1.0, 0.25), (2.5, -0.1, -2.0, -0.3), (1, 0, 0, 0.01)):
        def excess(turned, vx=vx, vy=vy, om=om, delta=delta):
            angle = delta - turned
            return k * front(slip(vx, vy, om, math.cos(angle), math.sin(angle))[0]) - turned

        low, high = sorted((0.0, math.copysign(0.6, excess(0.0))))
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if excess(middle) > 0 else (low, middle)
        angle = delta - low
        held = (0.0, 0.0, 0.0)
        want = make_dynamic(p, math)(0.0, vx, vy, om, *held, math.cos(angle), math.sin(angle))
        got = make_dynamic(apply(p, "steering_compliance", k=k), math)(
            0.0, vx, vy, om, *held, math.cos(delta), math.sin(delta))
        rigid = make_dynamic(p, math)(0.0, vx, vy, om, *held, math.cos(delta), math.sin(delta))
        assert got[5] == pytest.approx(want[5], abs=share * abs(want[5] - rigid[5]))


@pytest.mark.parametrize("car", EFFECT_CARS)
def test_compliance_in_reverse_adds_slip_and_no_more_than_stated(car):
    p = EFFECT_CARS[car]
    draw = np.random.default_rng(6)
    vx, vy, om, delta = draw.uniform([-3, -1, -6, -0.5], [3, 1, 6, 0.5], (20000, 4)).T
    cd = np.cos(delta)
    sd = np.sin(delta)
    alpha = make_slip(p.body, np, p.slip)(vx, vy, om, cd, sd)[0]
    q = Forces(0.0, vx, vy, om, cd, sd, alpha, alpha, 0.0, 0.0,
               make_tyres(p.tyres, p.body, np)[0](alpha), 0.0, 0.0, 0.0, 0.0)
    got = find_effect("steering_compliance").force(p, ARRAY, 0.03)(q).alpha_f
    ratio = got / alpha
    forwards = vx * cd + (vy + p.body.l_f * om) * sd
    assert (ratio > 0.0).all()
    assert (ratio < 3.0).all()
    assert (ratio[forwards > 0.3] < 1.0).all()
    assert (ratio[forwards < -0.3] > 1.0).all()
