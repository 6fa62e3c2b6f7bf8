"""Where the paper's print and its car differ, ours is the car: each would fail with the print.

A test shows the right value and that the printed form gives another one.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.vehicle import (
    PAPER,
    PAPER_PRINTED,
    UPSTREAM_2024,
    make_acceleration,
    make_friction,
    make_kinematic,
    make_motor,
    make_slip,
    make_steering,
    make_tyres,
)
from dart_hal.vehicle.inverse import make_inverse_dynamics

SETS = pytest.mark.parametrize("vehicle", [PAPER, UPSTREAM_2024], ids=lambda v: v.name)


def forces_and_motion(vehicle, vx, vy, om, tau, delta):
    """(F_w, F_yf, F_yr) that act, and (a_x, a_y, omega') that they cause."""
    cd = math.cos(delta)
    sd = math.sin(delta)
    wheels = (make_motor(vehicle.motor)(tau, vx) + make_friction(vehicle.friction)(vx))
    alphas = make_slip(vehicle.body, form=vehicle.slip)(vx, vy, om, cd, sd)
    lateral = [tyre(a) for tyre, a in zip(make_tyres(vehicle.tyres, vehicle.body), alphas,
                                          strict=True)]
    dvx, dvy, dom = make_acceleration(vehicle)(vx, vy, om, tau, delta)
    return (wheels, *lateral), (dvx - om * vy, dvy + om * vx, dom)


# 1: slip angles without the division by v_x

@pytest.mark.parametrize("form", ["paper", "all_speeds"])
def test_slip_angles_are_those_of_velocities_not_of_speeds_times_one_second(form):
    """v_x 2 m/s, lateral 0.2 m/s at the front axle: 5.7 deg; printed 11.3."""
    front, rear = make_slip(PAPER.body, form=form)(2.0, 0.2, 0.0, 1.0, 0.0)
    assert math.degrees(-front) == pytest.approx(5.71, abs=0.01)
    assert math.degrees(-rear) == pytest.approx(5.71, abs=0.01)
    assert math.degrees(math.atan(0.2)) == pytest.approx(11.31, abs=0.01)


# 2, 6, 11: the inversion from motion to forces

@SETS
@given(vx=st.floats(0.5, 4), vy=st.floats(-0.4, 0.4), om=st.floats(-4, 4),
       tau=st.floats(0, 0.6), delta=st.floats(-0.4, 0.4))
def test_inverse_dynamics_gives_back_the_forces_that_made_the_motion(vehicle, vx, vy, om, tau,
                                                                     delta):
    forces, motion = forces_and_motion(vehicle, vx, vy, om, tau, delta)
    got = make_inverse_dynamics(vehicle)(*motion, delta)
    assert got == pytest.approx(forces, rel=1e-9, abs=1e-9)


@SETS
def test_inverse_dynamics_solves_the_published_three_equations(vehicle):
    """Against a general solver, matrix as in the docstring."""
    body = vehicle.body
    delta = 0.31
    motion = (0.7, 4.2, -11.0)
    cf = body.front_share
    cr = 1 - body.front_share
    cd = math.cos(delta)
    sd = math.sin(delta)
    matrix = [[cf * cd + cr, -sd, 0], [cf * sd, cd, 1],
              [body.l_f * cf * sd, body.l_f * cd, -body.l_r]]
    right = [body.mass * motion[0], body.mass * motion[1], body.yaw_inertia * motion[2]]
    assert make_inverse_dynamics(vehicle)(*motion, delta) == pytest.approx(
        np.linalg.solve(matrix, right), rel=1e-12)


def printed_inversion(vehicle, motion, delta, *, masses_divide=False, sine_of_all=False):
    """The paper's way: F_xf = F_x / 2 (11); optionally its right-hand side (2), grouping (6)."""
    b = vehicle.body
    m, i_z = (1 / b.mass, 1 / b.yaw_inertia) if masses_divide else (b.mass, b.yaw_inertia)
    f_x = m * motion[0]
    f_y = m * motion[1]
    moment = i_z * motion[2]
    front = (b.l_r * f_y + moment) / b.wheelbase
    rear = (b.l_f * f_y - moment) / b.wheelbase
    if sine_of_all:
        return math.sin(-delta * f_x / 2 + math.cos(-delta) * front), rear
    return math.sin(-delta) * f_x / 2 + math.cos(-delta) * front, rear


def test_printed_inversions_are_not_the_inverse():
    """2: forces x 1/m^2 and moment x 1/I^2; 6: no tyre force above 1 N; 11: off by the coupling."""
    (_, front, rear), motion = forces_and_motion(PAPER, 1.5, 0.05, 1.0, 0.3, 0.228)
    _, divided = printed_inversion(PAPER, motion, 0.228, masses_divide=True)
    assert abs(divided - rear) > 100.0
    grouped, _ = printed_inversion(PAPER, motion, 0.228, sine_of_all=True)
    assert abs(grouped) <= 1.0 < front - 1.0
    halved, same_rear = printed_inversion(PAPER, motion, 0.228)
    assert same_rear == pytest.approx(rear)
    # F_xf = F_x / 2 forgets that F_x holds -F_yf sin d: (1 - c_f) sin^2 d of F_yf is missing ...
    exact = make_inverse_dynamics(PAPER)(*motion, 0.228)[1]
    assert exact == pytest.approx(front, rel=1e-9)
    assert abs(halved - front) > 0.02 * front
    # ... and without steering the two agree
    straight = forces_and_motion(PAPER, 1.5, 0.05, 1.0, 0.3, 0.0)
    assert printed_inversion(PAPER, straight[1], 0.0)[0] == pytest.approx(straight[0][1])


def test_moment_of_the_print_is_off_by_the_square_of_the_inertia():
    """2: 1/m^2 = 0.359 on forces, 1/I^2 = 23574 on the moment."""
    body = PAPER.body
    assert 1 / body.mass**2 == pytest.approx(0.359, abs=5e-4)
    assert 1 / body.yaw_inertia**2 == pytest.approx(23574, rel=1e-3)
    pure_yaw = make_inverse_dynamics(PAPER)(0.0, 0.0, 10.0, 0.0)
    assert (pure_yaw[1] * body.l_f - pure_yaw[2] * body.l_r
            == pytest.approx(10.0 * body.yaw_inertia, rel=1e-12))


# 3: gains and amplitudes of the steering map

def test_locks_of_the_steering_map():
    """Read literally the print locks at +30.5 / -33.9 deg; the car at +17.6 / -20.2."""
    p = PAPER_PRINTED.steering
    assert [math.degrees(make_steering(p)(s)) for s in (1, -1)] == pytest.approx([17.6, -20.2],
                                                                                abs=0.1)

    def literal(s):
        c = s + p.s0
        w = 0.5 * (math.tanh(30 * c) + 1)
        return (w * p.k_left * math.tanh(p.a_left_rad * c)
                + (1 - w) * p.k_right * math.tanh(p.a_right_rad * c))

    assert [math.degrees(literal(s)) for s in (1, -1)] == pytest.approx([30.5, -33.9], abs=0.1)


# 4: tyre values per degree

def test_tyre_values_are_per_degree():
    """Front 34.27 N/rad and rear 22.30 N/rad at small slip; per radian 0.6 and 0.39."""
    front, rear = make_tyres(PAPER.tyres, PAPER.body)
    assert front(1e-6) / 1e-6 == pytest.approx(34.27, abs=0.01)
    assert rear(1e-6) / 1e-6 == pytest.approx(22.30, abs=0.01)


# 5: yaw inertia

def test_yaw_inertia_is_that_of_the_rectangle_of_18_by_12_cm():
    """The text's l x w with w = 0.1 m gives 0.005654, not the printed 0.006513."""
    mass = PAPER.body.mass
    assert PAPER.body.yaw_inertia == pytest.approx(0.006513, abs=5e-7)
    assert mass / 12 * (0.175**2 + 0.1**2) == pytest.approx(0.005654, abs=5e-7)


# 7: digits

def test_printed_digits_and_those_of_the_code_are_two_sets():
    """Rounded to two digits the code's b is 13.31 and its d 28.89; the table has 13.32, 28.88."""
    assert (round(PAPER.friction.b, 2), round(PAPER.motor.d, 2)) == (13.31, 28.89)
    assert (PAPER_PRINTED.friction.b, PAPER_PRINTED.motor.d) == (13.32, 28.88)
    same = {"a": 2, "c": 2}
    assert all(round(getattr(PAPER.friction, k), n) == getattr(PAPER_PRINTED.friction, k)
               for k, n in same.items())


# 12: the reference point

def test_position_is_that_of_the_centre_of_mass():
    """Turning without slip the centre of mass moves left with l_r omega; the rear axle does not."""
    rates = make_kinematic(PAPER)
    td = math.tan(0.2)
    v = 1.0
    dx, dy, om, _ = rates(0.0, v, 0.0, 0.0, 0.0, td)
    assert (dx, om) == pytest.approx((v, v * td / PAPER.body.wheelbase))
    assert dy == pytest.approx(PAPER.body.l_r * om)
    assert dy > 0.1
    at_rear = replace(PAPER.body, l_f=0.145, l_r=0.03)
    assert make_kinematic(replace(PAPER, body=at_rear))(0.0, v, 0.0, 0.0, 0.0, td)[1] < dy / 3


# 13, 19: what the print leaves out

def test_geometry_that_the_print_leaves_out():
    """Wheelbase 0.175 m, centre of mass 0.54 of it before the rear axle."""
    body = PAPER.body
    assert (body.wheelbase, body.l_r, body.l_f) == pytest.approx((0.175, 0.0945, 0.0805))


def test_rear_wheel_frame_is_the_body_frame():
    """Only the front force turns with the steering angle: the rear one acts along y whole."""
    def sideways(delta):
        return make_acceleration(PAPER)(2.0, 0.0, 0.0, 0.0, delta)

    moment = sideways(0.2)[2] * PAPER.body.yaw_inertia
    b = PAPER.body
    lateral = sideways(0.2)[1] * b.mass
    assert moment == pytest.approx(b.l_f * lateral, rel=1e-9)   # v_y = omega = 0: no rear slip
