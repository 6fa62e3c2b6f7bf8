"""Low speed with stiff tyres: a step of milliseconds is stable, and converges."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from dart_hal.vehicle import PAPER, UPSTREAM_2024, batch, integrate
from dart_hal.vehicle.flat import replace_unchecked, stack
from dart_hal.vehicle.parameters import AxleTyres, Body
from dart_hal.vehicle.tyres import make_slip

STIFF_STEP = 2.5e-3
SPEEDS = (0.05, 0.1, 0.2, 0.35, 0.65, 1.0, 2.0)
STIFFNESS = (5.0, 20.0, 80.0, 200.0)
"""B of the magic formula [1/rad]: 5 is Zheng's car, 20 a MuSHR, 80 an F1TENTH, 200 the bound."""
V_Y = 4e-3
OMEGA = 0.012
PLACE = 2e-3
"""m/s, rad/s, m within which a step and an eighth of it agree; a mocap shows 0.02, 0.1, 0.005."""


def cars(seed: int = 0):
    """(stack of cars, start (6, n)): all speeds by all stiffnesses, sizes drawn."""
    rng = np.random.default_rng(seed)
    vehicles = []
    speeds = []
    for speed in SPEEDS:
        for stiffness in STIFFNESS:
            wheelbase = rng.uniform(0.17, 0.4)
            share = rng.uniform(0.4, 0.6)
            mass = rng.uniform(1.0, 5.0)
            body = Body(wheelbase=wheelbase, l_f=share * wheelbase,
                        l_r=wheelbase - share * wheelbase, mass=mass,
                        yaw_inertia=mass * wheelbase**2 * rng.uniform(0.12, 0.3))
            tyres = AxleTyres(front_D=rng.uniform(0.4, 1.2), front_C=1.4, front_B=stiffness,
                              rear_D=rng.uniform(0.4, 1.2), rear_C=1.4, rear_B=stiffness)
            vehicles.append(replace(PAPER, body=body, tyres=tyres))
            speeds.append(speed)
    start = np.zeros((6, len(vehicles)))
    start[3] = speeds
    return stack(vehicles), start


def drive(p, start, dt, method="rk4"):
    """States (3, 6, n) after 0.1, 0.2 and 0.4 s at about constant speed, steered both ways."""
    n = start.shape[1]
    v = start[3]
    force = p.friction.a * np.tanh(p.friction.b * v) + p.friction.c * v
    throttle = force / (p.motor.d - p.motor.e * v) - p.motor.g
    lock = np.minimum(0.3, 0.3 / v**2)  # within the grip
    angle = np.concatenate([np.tile(lock, (20, 1)), np.tile(-lock, (20, 1))])
    return batch.rollout(p, start, np.broadcast_to(throttle, (40, n)), angle,
                         output_samples=[10, 20, 40], substeps=round(0.01 / dt),
                         method=method, engine="numpy")


@cache
def reference():
    """States with an eighth of the step."""
    return drive(*cars(), STIFF_STEP / 8.0)


def disagreement(method="rk4"):
    """Of a step and an eighth of it: largest differences of v_y, yaw rate and place."""
    expected = reference()
    coarse = drive(*cars(), STIFF_STEP, method)
    off = np.abs(coarse - expected)
    return np.nanmax(off[:, 4]), np.nanmax(off[:, 5]), np.nanmax(off[:, :2]), coarse


@pytest.mark.parametrize("method", ["rk4", "midpoint"])
@pytest.mark.slow
def test_a_step_and_an_eighth_of_it_agree_down_to_5_cm_per_second(method):
    v_y, omega, place, states = disagreement(method)
    assert np.isfinite(states).all()
    assert v_y < V_Y
    assert omega < OMEGA
    assert place < PLACE


def test_control_plain_runge_kutta_is_unstable_there(monkeypatch):
    reference()
    monkeypatch.setitem(integrate.MAX_RELAXATION, "rk4", 1e9)
    with np.errstate(all="ignore"):
        _, omega, _, _ = disagreement()
    assert omega > 3.0 * OMEGA


def moved_by_a_millionth():
    """Largest change of v_x, v_y and yaw rate by tyres that are softer by a millionth."""
    p, start = cars()
    softer = replace_unchecked(p, {"tyres": {"rear_B": p.tyres.rear_B * (1.0 - 1e-6)}})
    return np.nanmax(np.abs(drive(p, start, STIFF_STEP) - drive(softer, start, STIFF_STEP))[:, 3:])


def test_a_small_change_of_a_stiff_tyre_moves_the_prediction_a_little():
    """The slope of a prediction is its own and not the noise of an unstable step."""
    assert moved_by_a_millionth() < 1e-5


def test_control_an_unstable_step_turns_a_small_change_into_noise(monkeypatch):
    monkeypatch.setitem(integrate.MAX_RELAXATION, "rk4", 1e9)
    with np.errstate(all="ignore"):
        assert moved_by_a_millionth() > 1e-3


@pytest.mark.slow_except("paper")
@pytest.mark.parametrize("vehicle", [PAPER, UPSTREAM_2024], ids=lambda p: p.name)
def test_the_published_cars_are_as_they_were_above_walking_pace(vehicle, monkeypatch):
    """Above 0.5 m/s not a bit changes, with steps of 2.5 and of 10 ms."""
    start = np.zeros((6, 4))
    start[3] = (0.5, 1.0, 2.0, 4.0)
    start[4], start[5] = 0.02, 0.5
    inputs = np.full((20, 4), 0.4), np.full((20, 4), 0.2)

    def rollouts():
        return [batch.rollout(vehicle, start, *inputs, substeps=n, engine="numpy") for n in (1, 4)]

    found = rollouts()
    monkeypatch.setitem(integrate.MAX_RELAXATION, "rk4", 1e9)
    for new, old in zip(found, rollouts(), strict=True):
        np.testing.assert_array_equal(new, old)


def test_the_divisor_is_never_below_its_least():
    slip = make_slip(PAPER.body, least=0.3)
    front, rear = slip(0.05, -1e-3, 0.0, 1.0, 0.0)
    assert front == pytest.approx(1e-3 / 0.3, rel=1e-4)
    assert rear == pytest.approx(1e-3 / 0.3, rel=1e-4)
    assert slip(2.0, 0.1, 0.5, 1.0, 0.0) == make_slip(PAPER.body)(2.0, 0.1, 0.5, 1.0, 0.0)
