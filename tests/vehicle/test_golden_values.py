"""Published figures of the three parameter sets, to the stated tolerance."""

from __future__ import annotations

import math

import pytest

from dart_hal.vehicle import (
    PAPER,
    UPSTREAM_2024,
    make_acceleration,
    make_dynamic,
    make_dynamic_step,
    make_friction,
    make_kinematic,
    make_kinematic_step,
    make_motor,
    make_motor_gains,
    make_slip,
    make_steering,
    make_tyres,
)

GOLDEN_COMMANDS = (-1.0, -0.5, 0.0, 0.5, 1.0)
GOLDEN_STEERING = {
    "paper": (PAPER, (-0.350532, -0.250762, 0.011022, 0.228342, 0.307543)),
    "upstream": (UPSTREAM_2024, (-0.402598, -0.253452, -0.014141, 0.211263, 0.320152)),
}


@pytest.mark.parametrize("name", GOLDEN_STEERING)
def test_steering_map(name):
    vehicle, expected = GOLDEN_STEERING[name]
    curve = make_steering(vehicle.steering)
    assert [curve(s) for s in GOLDEN_COMMANDS] == pytest.approx(expected, abs=1e-6)


def test_paper_forces():
    assert make_friction(PAPER.friction)(1.0) == pytest.approx(-2.009325, abs=1e-6)
    assert make_motor(PAPER.motor)(0.3, 1.0) == pytest.approx(3.424911, abs=1e-6)


def test_paper_front_tyre_takes_degrees_converted():
    front, _ = make_tyres(PAPER.tyres, PAPER.body)
    forces = [front(math.radians(a)) for a in (1, 2, 5, 10, 20)]
    assert forces == pytest.approx([0.6230, 1.2807, 2.2471, 2.4944, 2.5711], abs=1e-4)


def test_per_radian_misreading_is_visible():
    """Taken per radian the paper's tyre has about 2 % of its force."""
    front, _ = make_tyres(PAPER.tyres, PAPER.body)
    alpha = math.radians(2.0)
    assert front(math.radians(alpha)) / front(alpha) == pytest.approx(0.017, abs=0.003)


def test_acceleration_of_both_sets():
    state = (1.5, 0.05, 1.0)
    paper = make_acceleration(PAPER)(*state, 0.3, make_steering(PAPER.steering)(0.5))
    assert paper == pytest.approx((0.204592727, 0.379798625, 21.029857915), abs=1e-6)
    delta = make_steering(UPSTREAM_2024.steering)(0.5)
    upstream = make_acceleration(UPSTREAM_2024, slip="upstream")(*state, 0.3, delta)
    assert upstream == pytest.approx((-0.321283152, 2.444755185, 37.462198560), abs=1e-6)


@pytest.mark.parametrize("form", ["paper", "all_speeds"])
def test_slip_angles_divide_by_the_speed(form):
    delta = make_steering(PAPER.steering)(0.5)
    alpha = make_slip(PAPER.body, form=form)(1.5, 0.05, 1.0, math.cos(delta), math.sin(delta))
    assert [math.degrees(a) for a in alpha] == pytest.approx([8.1108, 1.6993], abs=1e-4)
    front, _ = make_slip(PAPER.body, form=form)(2.0, 0.2, 0.0, 1.0, 0.0)
    assert math.degrees(front) == pytest.approx(-5.71, abs=0.01)   # printed form: -11.3


SPEEDS = {
    "paper": (PAPER, (1.305, 2.195, 3.078, 3.780, 4.246)),
    "upstream": (UPSTREAM_2024, (0.871, 1.841, 3.088, 4.121, 4.705)),
}


@pytest.mark.parametrize("name", SPEEDS)
def test_steady_speeds(name):
    vehicle, expected = SPEEDS[name]
    motor = make_motor(vehicle.motor)
    friction = make_friction(vehicle.friction)

    def balance(tau: float) -> float:
        low = 0.1
        high = 6.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = ((middle, high) if motor(tau, middle) + friction(middle) > 0
                         else (low, middle))
        return low

    taus = (0.25, 0.3, 0.4, 0.6, 1.0)
    assert [balance(tau) for tau in taus] == pytest.approx(expected, abs=1e-3)


def roll_out(vehicle, slip):
    step = make_dynamic_step(make_dynamic(vehicle, slip=slip))
    delta = make_steering(vehicle.steering)(0.5)
    held = (*make_motor_gains(vehicle.motor)(0.25), 0.0, math.cos(delta), math.sin(delta))
    state = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    for _ in range(800):
        state = step(*state, 2.5e-3, held, held, held)
    x, y, eta, vx, vy, om = state
    return vx, vy, om, x, y, eta


def test_dynamic_roll_out():
    expected = (1.100525, 0.081570, 1.545032, 0.084387, 1.425780, 2.916695)
    assert roll_out(PAPER, "paper") == pytest.approx(expected, abs=1e-6)
    assert roll_out(PAPER, "all_speeds") == pytest.approx(expected, abs=1e-6)


def test_dynamic_roll_out_upstream():
    expected = (0.886512, 0.088488, 1.058608, 0.568963, 1.390666, 2.186952)
    assert roll_out(UPSTREAM_2024, "upstream") == pytest.approx(expected, abs=1e-6)


def test_kinematic_roll_out():
    step = make_kinematic_step(make_kinematic(PAPER))
    td = math.tan(make_steering(PAPER.steering)(0.5))
    held = (*make_motor_gains(PAPER.motor)(0.25), 0.0, td)
    state = (0.0, 0.0, 0.0, 1.0)
    for _ in range(800):
        state = step(*state, 2.5e-3, held, held, held)
    x, y, eta, v = state
    om = v * td / PAPER.body.wheelbase
    got = (v, PAPER.body.l_r * om, om, x, y, eta)
    assert got == pytest.approx((1.199672, 0.150551, 1.593132, -0.056854, 1.511027, 2.967128),
                                abs=1e-6)


def test_axle_loads_and_inertia():
    body = PAPER.body
    assert (body.front_load, body.rear_load) == pytest.approx((8.85, 7.54), abs=5e-3)
    assert body.yaw_inertia == pytest.approx(0.006513, abs=1e-6)
    assert UPSTREAM_2024.body.yaw_inertia == pytest.approx(0.0048061, abs=1e-7)
    assert UPSTREAM_2024.body.front_load == pytest.approx(8.309, abs=1e-3)
