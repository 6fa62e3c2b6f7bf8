"""Laws of motion, held on every engine: closed forms, mirror, energy, and casadi."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dart_hal.vehicle import (
    PAPER,
    UPSTREAM_2024,
    Motor,
    Steering,
    integrate,
    make_car_step,
    make_motion_step,
    make_steering,
    rollout,
)
from dart_hal.vehicle.batch import car_rollout
from dart_hal.vehicle.native.build import compiler
from dart_hal.vehicle.parameters import PaperTyres

ENGINES = ("numpy", "native") if compiler() else ("numpy",)
ENGINE = pytest.mark.parametrize("engine", ENGINES)
KINEMATIC = replace(PAPER, kind="kinematic")


def settle(p, throttle, delta, engine, seconds=5.0):
    """(v_x, v_y, omega) of n cars after driving with held inputs (n,)."""
    samples = round(seconds * 100)
    n = len(delta)
    start = np.zeros((6, n))
    start[3] = 1.2
    held = (np.repeat(u[None], samples, axis=0) for u in (throttle, delta))
    return rollout(p, start, *held, output_samples=[samples], engine=engine)[0, 3:]


@ENGINE
@given(seed=st.integers(0, 10**6))
@settings(max_examples=5)
def test_the_kinematic_circle_has_the_radius_of_geometry(engine, seed):
    """R = l / tan(delta) at the rear axle, at any speed."""
    draw = np.random.default_rng(seed)
    delta = draw.uniform(0.02, 0.4, 30)
    body = KINEMATIC.body
    vx, vy, om = settle(KINEMATIC, draw.uniform(0.2, 0.4, 30), delta, engine, seconds=0.5)
    assert vx / om == pytest.approx(body.wheelbase / np.tan(delta), rel=1e-12)
    assert vy / om == pytest.approx(np.full(30, body.l_r), rel=1e-12)


@ENGINE
@pytest.mark.parametrize(("front_b", "sign"), [(8.0, 1), (20.0, -1)], ids=["under", "over"])
@pytest.mark.slow_except("*-native")
def test_the_circle_of_linear_tyres_is_that_of_the_understeer_gradient(engine, front_b, sign):
    """delta = l / R + (m / l)(l_r / C_f - l_f / C_r) v^2 / R, for small angles.

    C_f = D C B and C_r are stiffnesses of axles; with a D so high the front
    tyre is linear as well.
    """
    p = replace(PAPER, tyres=PaperTyres(front_D=100.0, front_C=0.05, front_B=front_b, front_E=0.0,
                                        rear_cornering_stiffness=55.0))
    b = p.body
    c_f = 100.0 * 0.05 * front_b
    c_r = 55.0
    gradient = b.mass / b.wheelbase * (b.l_r / c_f - b.l_f / c_r)
    assert math.copysign(1, gradient) == sign
    draw = np.random.default_rng(8)
    delta = draw.uniform(0.004, 0.02, 30)
    vx, _, om = settle(p, draw.uniform(0.26, 0.32, 30), delta, engine)
    ackermann = om * b.wheelbase / vx
    assert ackermann + gradient * vx * om == pytest.approx(delta, rel=2e-3)
    assert (np.sign(delta - ackermann) == sign).all()
    assert (np.abs(ackermann - delta) > 0.02 * delta).all(), "the control: the gradient matters"


# symmetry and energy

EVEN_STEERING = Steering(k_left=1.6, a_left_rad=0.35, s0=0.0, a_right_rad=0.35, k_right=1.6)
BOTH_SIDES = [replace(p, steering=EVEN_STEERING, delay=UPSTREAM_2024.delay)
              for p in (PAPER, UPSTREAM_2024, KINEMATIC)]
IDS = ["paper", "upstream", "kinematic"]
LEFT_RIGHT = np.array([1, -1, -1, 1, -1, -1, 1, -1.0])[:, None]


@ENGINE
@pytest.mark.parametrize("p", BOTH_SIDES, ids=IDS)
@given(seed=st.integers(0, 10**6))
@settings(max_examples=15)
@pytest.mark.slow_except("kinematic-native")
def test_a_mirrored_drive_is_the_mirror_image(engine, p, seed):
    draw = np.random.default_rng(seed)
    n = 5
    steps = 60
    start = np.stack([draw.uniform(*ab, n) for ab in
                      ((-1, 1), (-1, 1), (-3, 3), (0.8, 3), (-0.2, 0.2), (-2, 2), (0.2, 0.4),
                       (-0.5, 0.5))])
    throttle = draw.uniform(0.25, 0.4, (steps, n))
    steering = draw.uniform(-0.5, 0.5, (steps, n))
    there = car_rollout(p, start, throttle, steering, output_samples=[steps], engine=engine)[0]
    mirrored = car_rollout(p, start * LEFT_RIGHT, throttle, -steering, output_samples=[steps],
                           engine=engine)[0]
    assert mirrored == pytest.approx(there * LEFT_RIGHT, rel=1e-11, abs=1e-11)
    crooked = replace(p, steering=PAPER.steering)
    other = [car_rollout(crooked, s, throttle, d, output_samples=[steps], engine=engine)[0]
             for s, d in ((start, steering), (start * LEFT_RIGHT, -steering))]
    assert np.abs(other[1] - other[0] * LEFT_RIGHT).max() > 1e-3, "the control"


def energy(p, states):
    """Kinetic energy [J] of states (..., 6, n)."""
    vx, vy, om = (states[..., i, :] for i in (3, 4, 5))
    return 0.5 * p.body.mass * (vx**2 + vy**2) + 0.5 * p.body.yaw_inertia * om**2


@ENGINE
@pytest.mark.parametrize("p", [PAPER, UPSTREAM_2024], ids=lambda p: p.name)
@given(seed=st.integers(0, 10**6))
@settings(max_examples=20)
@pytest.mark.slow_except("paper-*")
@pytest.mark.slow_except("*-native")
def test_without_throttle_energy_only_falls(engine, p, seed):
    """Forwards, backwards, sliding, with turned wheels."""
    draw = np.random.default_rng(seed)
    n = 20
    samples = 60
    start = np.stack([np.zeros(n), np.zeros(n), draw.uniform(-3, 3, n), draw.uniform(-4, 4, n),
                      draw.uniform(-1, 1, n), draw.uniform(-8, 8, n)])
    held = np.zeros((samples, n)), np.repeat(draw.uniform(-0.4, 0.4, (1, n)), samples, axis=0)
    states = rollout(p, start, *held, output_samples=range(samples + 1), sample=0.004, substeps=4,
                     engine=engine)
    course = energy(p, states)
    assert (np.diff(course, axis=0) <= 1e-9).all()
    assert (course[-1] < course[0]).all()


def test_negative_friction_would_be_detected():
    """The control of the energy law."""
    pushed = replace(PAPER, friction=replace(PAPER.friction, a=0.0, c=-0.5))
    start = np.array([[0.0, 0, 0, 2.0, 0, 0]]).T
    states = rollout(pushed, start, np.zeros((9, 1)), np.zeros((9, 1)))
    assert (np.diff(energy(pushed, states), axis=0) > 0).all()


def test_a_motor_that_pulls_does_not_obey_it():
    start = np.array([[0.0, 0, 0, 0.5, 0, 0]]).T
    states = rollout(replace(PAPER, motor=Motor(d=20.0, e=2.0, g=0.0)), start,
                     np.full((9, 1), 0.5), np.zeros((9, 1)))
    assert energy(PAPER, states)[-1] > energy(PAPER, start)


# casadi

STATE = (0.3, -1.0, 0.7, 1.4, 0.05, 0.9, 0.25, 0.1)
STEP_COMMANDS = (0.35, -0.3)


@pytest.mark.slow
@pytest.mark.parametrize("p", [*BOTH_SIDES, PAPER, UPSTREAM_2024], ids=[*IDS, "P1", "P2"])
@given(vx=st.floats(0.4, 4), vy=st.floats(-0.4, 0.4), om=st.floats(-4, 4),
       tau=st.floats(-0.4, 0.6), s=st.floats(-1, 1))
@settings(max_examples=20)
def test_casadi_floats_and_arrays_are_one_step(p, vx, vy, om, tau, s):
    casadi = pytest.importorskip("casadi")
    state = (*STATE[:3], vx, vy, om, *STATE[6:])
    x = casadi.SX.sym("x", 8)
    u = casadi.SX.sym("u", 2)
    out = make_car_step(p, casadi, 0.01)(*casadi.vertsplit(x), *casadi.vertsplit(u))
    compiled = casadi.Function("step", [x, u], [casadi.vertcat(*out)])
    got = np.array(compiled(state, (tau, s))).ravel()
    floats = make_car_step(p, math, 0.01)(*state, tau, s)
    arrays = make_car_step(p, np, 0.01)(*(np.array([v]) for v in (*state, tau, s)))
    assert got == pytest.approx(floats, rel=1e-12, abs=1e-12)
    assert floats == pytest.approx([a[0] for a in arrays], rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("p", [PAPER, UPSTREAM_2024, KINEMATIC], ids=IDS)
def test_casadi_differentiates_a_step(p):
    """What an optimiser needs: the Jacobian, equal to differences of the float step."""
    casadi = pytest.importorskip("casadi")
    x = casadi.SX.sym("x", 8)
    u = casadi.SX.sym("u", 2)
    out = casadi.vertcat(*make_car_step(p, casadi, 0.01)(*casadi.vertsplit(x),
                                                         *casadi.vertsplit(u)))
    jacobian = casadi.Function("j", [x, u], [casadi.jacobian(out, casadi.vertcat(x, u))])
    got = np.array(jacobian(STATE, STEP_COMMANDS))
    step = make_car_step(p, math, 0.01)
    base = (*STATE, *STEP_COMMANDS)
    h = 1e-6
    for i in range(10):
        high, low = ([v + sign * h * (k == i) for k, v in enumerate(base)] for sign in (1, -1))
        column = (np.array(step(*high)) - step(*low)) / (2 * h)
        assert got[:, i] == pytest.approx(column, abs=2e-7)
    assert np.linalg.matrix_rank(got[:, 8:]) == 2, "both commands act"


def test_a_motion_step_of_casadi_symbols_takes_parameters_as_symbols_too():
    """So that an estimator can fit what it likes."""
    casadi = pytest.importorskip("casadi")
    from dart_hal.vehicle.flat import bind, value

    mass = casadi.SX.sym("mass")
    p = bind(PAPER, lambda name: mass if name == "body.mass" else value(PAPER, name))
    delta = make_steering(PAPER.steering)(0.2)
    out = make_motion_step(p, casadi, 0.01)(*map(casadi.SX, STATE[:6]), 0.3, delta)
    f = casadi.Function("f", [mass], [casadi.vertcat(*out),
                                      casadi.jacobian(casadi.vertcat(*out), mass)])
    got, slope = (np.array(a).ravel() for a in f(PAPER.body.mass))
    assert got == pytest.approx(make_motion_step(PAPER, math, 0.01)(*STATE[:6], 0.3, delta),
                                rel=1e-12)
    assert abs(slope[3]) > 1e-4


@pytest.mark.parametrize(("limited", "chatters"), [(False, True), (True, False)])
@pytest.mark.slow
def test_a_step_of_10_ms_bears_the_paper_s_tyres_at_walking_pace(limited, chatters, monkeypatch):
    """The lateral motion relaxes no faster than the step can follow; without that it chatters."""
    free = replace(PAPER, friction=replace(PAPER.friction, a=0.0, c=0.0),
                   motor=Motor(d=0.0, e=0.0, g=0.0))
    start = np.array([[0.0, 0, 0, 0.15, 0, 0.1, 0, 0]]).T

    def yaw_rate(dt):
        n = round(1.0 / dt)
        held = np.zeros((n, 1)), np.full((n, 1), 0.1)
        return car_rollout(free, start, *held, output_samples=[n], dt=dt, engine="numpy")[0, 5, 0]

    right = yaw_rate(0.0025)
    if not limited:
        monkeypatch.setitem(integrate.MAX_RELAXATION, "rk4", 1e9)
    assert bool(abs(yaw_rate(0.01) - right) > 0.1 * abs(right)) == chatters
