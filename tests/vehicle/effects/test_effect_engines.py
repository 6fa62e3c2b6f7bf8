"""One definition, every namespace: floats, arrays, symbols, casadi and compiled kernels."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dart_hal.vehicle import (
    PAPER,
    make_acceleration,
    make_car_step,
    make_dynamic,
    make_motion_step,
    rollout,
    stack,
)
from dart_hal.vehicle.batch import car_rollout
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.effects import activate, add_effects, apply, catalogue, find_effect
from dart_hal.vehicle.flat import names, value
from dart_hal.vehicle.namespace import SCALAR
from dart_hal.vehicle.native.build import compiler
from dart_hal.vehicle.native.model import DT_SYMBOL as STEP
from dart_hal.vehicle.native.model import form_of, trace
from dart_hal.vehicle.native.trace import evaluate
from tests.vehicle.effects.effect_drive import EFFECT_CARS, SAMPLE_TIME, medium


def states(n=6, seed=1):
    draw = np.random.default_rng(seed)
    low = [-1, -1, -3, -0.5, -0.2, -2, -0.2, -0.5, 0.0, -0.8]
    high = [1, 1, 3, 3.0, 0.2, 2, 0.5, 0.5, 0.5, 0.8]
    return draw.uniform(low, high, (n, 10)).T


def car_with_all(p, size=0):
    return add_effects(p, (activate(e, medium(e, size)) for e in catalogue().values()))


@pytest.mark.parametrize("car", EFFECT_CARS)
def test_floats_arrays_and_a_stack_move_a_car_with_all_effects_equally(car):
    x = states()
    cars = [car_with_all(EFFECT_CARS[car], size) for size in (0, 1)]
    alone = np.array([[make_car_step(p, math, SAMPLE_TIME)(*column) for column in x.T.tolist()]
                      for p in cars])
    for p, expected in zip(cars, alone, strict=True):
        assert np.abs(np.array(make_car_step(p, np, SAMPLE_TIME)(*x)).T - expected).max() < 1e-12
    together = np.array(make_car_step(stack(cars), np,
                                      SAMPLE_TIME)(*np.repeat(x[:, :1], 2, axis=1)))
    assert np.abs(together.T - alone[:, 0]).max() < 1e-12
    assert np.abs(alone[0] - alone[1]).max() > 1e-3


def test_symbols_move_a_car_with_all_effects_equally():
    """No branch, no float(): parameters and states are symbols of a graph."""
    p = car_with_all(PAPER)
    x = states(1)[:, 0].tolist()
    traced = trace(form_of(p), "car", "rk4")
    symbols = {n: min(value(p, n), 1e30) for n in names(p)}
    symbols |= {STEP: SAMPLE_TIME, **dict(zip((*traced.states, *traced.inputs), x, strict=True))}
    got = evaluate(traced.graph, traced.outputs, symbols, SCALAR)
    assert got == pytest.approx(make_car_step(p, math, SAMPLE_TIME)(*x), rel=1e-12, abs=1e-12)


def test_casadi_has_the_rates_of_a_car_with_all_effects_and_their_slope():
    casadi = pytest.importorskip("casadi")
    p = apply_parameter_effects(car_with_all(PAPER))
    held = (3.0, 0.8, 0.0, math.cos(0.2), math.sin(0.2))
    x = casadi.SX.sym("x", 4)
    rates = casadi.Function("rates", [x], [casadi.vertcat(*make_dynamic(p, casadi)(
        x[0], x[1], x[2], x[3], *held))])
    for at in ((0.4, 1.6, -0.05, 0.9), (0.0, 0.0, 0.0, 0.0), (2.0, -0.8, 0.1, -1.0)):
        got = np.array(rates(at)).ravel()
        assert got == pytest.approx(make_dynamic(p, math)(*at, *held), rel=1e-11, abs=1e-11)
        slope = np.array(casadi.Function("j", [x], [casadi.jacobian(rates(x), x)])(at))
        assert np.isfinite(slope).all(), "an optimiser can differentiate it, at rest as well"


@pytest.mark.slow
@pytest.mark.skipif(not compiler(), reason="no C compiler")
def test_the_compiled_kernel_has_every_effect():
    cars = [car_with_all(PAPER, size) for size in (0, 1)]
    draw = np.random.default_rng(2)
    start = states(2)[:6]
    start[3] = 1.0, 2.0
    inputs = draw.uniform(-0.3, 0.5, (2, 60, 2))
    native, plain = (rollout(stack(cars), start, *inputs, engine=e) for e in ("native", "numpy"))
    assert np.isfinite(plain).all()
    assert np.abs(native - plain).max() < 1e-12
    bare = rollout(PAPER, start, *inputs, engine="numpy")
    assert np.abs(bare - plain).max() > 0.01


def test_rollouts_with_actuators_have_them_too():
    p = add_effects(PAPER, [activate(find_effect("steering_lag"), {"k": 0.1}),
                         activate(find_effect("yaw_damping"), {"k": 0.02})])
    start = np.zeros((8, 1))
    start[3] = 1.5
    commands = np.full((30, 1), 0.3), np.full((30, 1), 0.5)
    got = car_rollout(p, start, *commands, engine="numpy")[-1, :, 0]
    q = replace(PAPER, delay=replace(PAPER.delay, steering_lag_s=0.1))
    step = make_car_step(apply(q, "yaw_damping", k=0.02), math, 0.01)
    state = start[:, 0].tolist()
    for _ in range(30):
        state = step(*state, 0.3, 0.5)
    assert got == pytest.approx(state, abs=1e-12)


def test_accelerations_have_effects_of_both_kinds():
    x = (1.5, 0.05, 1.0, 0.3, 0.2)
    p = add_effects(PAPER, [activate(find_effect("yaw_damping"), {"k": 0.02}),
                         activate(find_effect("yaw_inertia"), {"k": 0.5})])
    bare = make_acceleration(PAPER)(*x)
    got = make_acceleration(p)(*x)
    moment = PAPER.body.yaw_inertia * bare[2] - 0.02 * x[2]
    assert got[2] == pytest.approx(moment / (1.5 * PAPER.body.yaw_inertia), rel=1e-12)


def test_the_kinematic_car_has_what_is_not_a_force():
    p = replace(PAPER, kind="kinematic")
    x = (0.0, 0.0, 0.0, 1.5, 0.0, 0.0, 0.4, 0.2)
    bare = make_motion_step(p, math)(*x)
    assert make_motion_step(apply(p, "quadratic_drag", k=0.2), math)(*x)[3] < bare[3]
    assert make_motion_step(apply(p, "yaw_damping", k=0.2), math)(*x) == bare
