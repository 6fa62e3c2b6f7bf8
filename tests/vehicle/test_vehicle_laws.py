"""Laws that any parameter set must obey, and the misreadings they expose."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import brentq

from dart_hal.core.errors import ConfigError, NotMonotone
from dart_hal.vehicle import (
    ARRAY,
    PAPER,
    PAPER_PRINTED,
    SETS,
    UPSTREAM_2024,
    Body,
    Friction,
    PaperTyres,
    Steering,
    check_monotone,
    make_acceleration,
    make_dead_band,
    make_dynamic,
    make_dynamic_step,
    make_friction,
    make_motor,
    make_slip,
    make_steering,
    make_steering_inverse,
    make_tyres,
)

ANY_SPEED = st.floats(-3.0, 3.0)
YAW_RATE = st.floats(-6.0, 6.0)
ANY_ANGLE = st.floats(-0.35, 0.35)
each_set = pytest.mark.parametrize("vehicle", SETS.values(), ids=SETS)


@each_set
@given(vx=ANY_SPEED, vy=ANY_SPEED, om=YAW_RATE, delta=ANY_ANGLE, tau=st.floats(-1.0, 1.0))
def test_left_and_right_are_mirror_images(vehicle, vx, vy, om, delta, tau):
    acceleration = make_acceleration(vehicle)
    a, b, c = acceleration(vx, vy, om, tau, delta)
    assert acceleration(vx, -vy, -om, tau, -delta) == pytest.approx((a, -b, -c), abs=1e-9)


@each_set
@given(vx=ANY_SPEED, vy=ANY_SPEED, om=YAW_RATE, delta=ANY_ANGLE)
def test_passive_forces_turn_round_with_the_velocity(vehicle, vx, vy, om, delta):
    """Mirror in time: friction and tyres oppose the motion in either direction."""
    acceleration = make_acceleration(vehicle)
    ax, ay, turn = acceleration(vx, vy, om, 0.0, delta)
    bx, by, back = acceleration(-vx, -vy, -om, 0.0, delta)
    assert (ax - om * vy, ay + om * vx, turn) == pytest.approx(
        (-(bx - om * vy), -(by + om * vx), -back), abs=1e-8)


@given(delta=ANY_ANGLE)
def test_a_car_at_rest_stays(delta):
    assert make_acceleration(PAPER)(0.0, 0.0, 0.0, 0.0, delta) == pytest.approx((0, 0, 0), abs=1e-9)


def test_published_slip_angles_turn_a_car_at_rest():
    """Why there is a form of our own: turned wheels alone must not move the car."""
    *_, turn = make_acceleration(PAPER, slip="paper")(0.0, 0.0, 0.0, 0.0, 0.3)
    assert turn > 10.0


@given(vy=st.floats(-0.5, 0.5), om=st.floats(-3.0, 3.0), delta=ANY_ANGLE)
def test_no_jump_when_the_speed_changes_sign(vy, om, delta):
    acceleration = make_acceleration(PAPER)
    before = acceleration(-1e-9, vy, om, 0.0, delta)
    after = acceleration(1e-9, vy, om, 0.0, delta)
    assert after == pytest.approx(before, abs=1e-4)


@given(vx=st.floats(0.35, 4.0), vy=st.floats(-0.3, 0.3), om=st.floats(-3.0, 3.0), delta=ANY_ANGLE)
def test_own_slip_angles_equal_the_paper_s_where_those_hold(vx, vy, om, delta):
    args = (vx, vy, om, math.cos(delta), math.sin(delta))
    along_wheel = vx * args[3] + (vy + PAPER.body.l_f * om) * args[4]
    assume(along_wheel > 0.35)
    ours, paper = (make_slip(PAPER.body, form=f)(*args) for f in ("all_speeds", "paper"))
    assert ours == pytest.approx(paper, abs=2e-5)


@pytest.mark.slow_except("0.0-upstream-2024")
@each_set
@pytest.mark.parametrize("delta", [0.0, 0.3, -0.3])
def test_a_rolling_car_loses_energy(vehicle, delta):
    body = vehicle.body
    step = make_dynamic_step(make_dynamic(vehicle))
    rng = np.random.default_rng(5)
    rolling = (0.0, 0.0, 0.0, math.cos(delta), math.sin(delta))

    def energy(s):
        return 0.5 * body.mass * (s[3]**2 + s[4]**2) + 0.5 * body.yaw_inertia * s[5]**2

    for _ in range(20):
        state = (0.0, 0.0, 0.0, *rng.uniform((-3, -0.5, -5), (3, 0.5, 5)).tolist())
        for _ in range(300):
            later = step(*state, 1e-3, rolling, rolling, rolling)
            assert energy(later) <= energy(state) + 1e-12
            state = later


def test_arrays_give_what_floats_give():
    rng = np.random.default_rng(1)
    state = rng.uniform(-2.0, 2.0, (3, 50))
    tau = rng.uniform(-1, 1, 50)
    delta = rng.uniform(-0.3, 0.3, 50)
    for vehicle in SETS.values():
        batch = np.array(make_acceleration(vehicle, ARRAY)(*state, tau, delta))
        one = make_acceleration(vehicle)
        single = np.array([one(*state[:, k].tolist(), float(tau[k]), float(delta[k]))
                           for k in range(50)]).T
        np.testing.assert_allclose(batch, single, rtol=1e-12, atol=1e-12)


@given(tau=st.floats(-1.0, 1.0), v=ANY_SPEED)
def test_motor_in_reverse_is_the_weaker_mirror_image(tau, v):
    motor = make_motor(PAPER.motor)
    if tau > 0.3:
        assert motor(-tau, -v) == pytest.approx(-0.6 * motor(tau, v), abs=1e-9)


def test_dead_band_dips_as_documented():
    band = make_dead_band(PAPER.motor.g)
    dip = min(PAPER.motor.d * band(k / 1e4) for k in range(1000, 1600))
    assert dip == pytest.approx(-0.040, abs=1e-3)
    assert make_motor(PAPER.motor)(0.0, 0.0) == pytest.approx(0.0, abs=1e-9)


@given(v=st.floats(0.01, 5.0), brake=st.floats(0.01, 10.0))
def test_friction_and_brake_oppose_the_motion(v, brake):
    friction = make_friction(UPSTREAM_2024.friction)
    assert friction(v, brake) == -friction(-v, brake)
    assert friction(v, brake) < friction(v) < 0.0


def test_front_tyre_approaches_its_limit_from_below():
    front, _ = make_tyres(PAPER.tyres, PAPER.body)
    forces = [front(math.radians(a)) for a in range(1, 90)]
    assert forces == sorted(forces)
    assert forces[-1] < 2.622
    assert forces[-1] / PAPER.body.front_load == pytest.approx(0.30, abs=0.01)


def test_rear_tyre_needs_an_end_only_beyond_the_data():
    from dataclasses import replace

    open_end = make_tyres(PAPER.tyres, PAPER.body)[1]
    capped = make_tyres(replace(PAPER.tyres, rear_max=6.0), PAPER.body)[1]
    assert capped(math.radians(6.7)) == open_end(math.radians(6.7))
    assert capped(0.6) == 6.0
    assert capped(-0.6) == -6.0


@pytest.mark.parametrize("vehicle", [PAPER, UPSTREAM_2024], ids=["paper", "upstream"])
@given(s=st.floats(-1.0, 1.0))
def test_steering_inverse_returns_the_command(vehicle, s):
    command = make_steering_inverse(vehicle.steering)
    assert command(make_steering(vehicle.steering)(s)) == pytest.approx(s, abs=1e-9)
    assert (command(-2.0), command(2.0)) == (-1.0, 1.0)


def test_gains_and_amplitudes_exchanged_give_the_printed_absurdity():
    """Read literally, the printed table locks at +30.5/-33.9 deg instead of +17.6/-20.2."""
    p = PAPER_PRINTED.steering
    curve = make_steering(p)
    assert [math.degrees(curve(s)) for s in (1, -1)] == pytest.approx([17.6, -20.2], abs=0.1)
    swapped = Steering(k_left=p.a_left_rad, a_left_rad=1.4, s0=p.s0, a_right_rad=1.4,
                       k_right=p.a_right_rad)
    locks = [math.degrees(make_steering(swapped)(s)) for s in (1, -1)]
    assert locks[0] > 25
    assert locks[1] < -27


@pytest.mark.parametrize("v", [1.0, 2.5])
def test_linearised_it_is_the_a_and_b_of_the_docstring(v):
    p = PAPER
    h = 1e-6
    accelerate, (front, rear) = make_acceleration(p), make_tyres(p.tyres, p.body)
    c_f, c_r = ((axle(h) - axle(-h)) / (2 * h) for axle in (front, rear))
    m = p.body.mass
    i_z = p.body.yaw_inertia
    l_f = p.body.l_f
    l_r = p.body.l_r
    a_b = [[-(c_f + c_r) / (m * v), (l_r * c_r - l_f * c_f) / (m * v) - v, c_f / m],
           [(l_r * c_r - l_f * c_f) / (i_z * v), -(l_f**2 * c_f + l_r**2 * c_r) / (i_z * v),
            l_f * c_f / i_z]]
    throttle = brentq(lambda tau: accelerate(v, 0.0, 0.0, tau, 0.0)[0], 0.0, 1.0)
    columns = [[(up - down) / (2 * h) for up, down in zip(
        accelerate(v, *(h * e for e in unit[:2]), throttle, h * unit[2])[1:],
        accelerate(v, *(-h * e for e in unit[:2]), throttle, -h * unit[2])[1:], strict=True)]
        for unit in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    np.testing.assert_allclose(np.transpose(columns), a_b, rtol=1e-4)


def test_a_map_that_falls_is_refused():
    high_gain_one_side = Steering(k_left=0.05, a_left_rad=0.02, s0=-0.05, a_right_rad=0.02,
                                  k_right=10.0)
    with pytest.raises(NotMonotone, match="falls at command"):
        check_monotone(high_gain_one_side)


@pytest.mark.parametrize("make", [
    lambda: Friction(a=float("nan"), b=10.0, c=0.3),
    lambda: Friction(a=-1.0, b=10.0, c=0.3),
    lambda: Body(wheelbase=175.0, l_f=80.5, l_r=94.5, mass=1.67, yaw_inertia=0.0065),
    lambda: Body(wheelbase=0.175, l_f=0.09, l_r=0.0945, mass=1.67, yaw_inertia=0.0065),
    lambda: PaperTyres(front_D=2.98, front_C=0.69, front_B=0.29, front_E=-3.0,
                       rear_cornering_stiffness=22.0),
])
def test_wrong_units_are_refused(make):
    """Millimetres, values per degree, NaN, a wheelbase that does not add up."""
    with pytest.raises(ConfigError):
        make()

