"""One car, a batch and a rollout of windows are the same equations."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dart_hal.core.errors import ConfigError, UsageError
from dart_hal.vehicle import PAPER, SETS, UPSTREAM_2024, Batch, rollout, stack
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.flat import bounds, names, unit, value, with_values
from dart_hal.vehicle.load import find_model, vehicle_of
from dart_hal.vehicle.parameters import Delay
from dart_hal.vehicle.step import make_car_step, make_motion_step

LAGGED = replace(PAPER, delay=Delay(steering_lag_s=0.12, throttle_lag_s=0.08))
each_car = pytest.mark.parametrize("vehicle", [LAGGED, UPSTREAM_2024,
                                               replace(LAGGED, kind="kinematic")],
                                   ids=lambda v: f"{v.name}-{v.kind}")


def drive(vehicle, dt, seconds=0.4, method="rk4"):
    """Step responses with both actuators lagging: state after 0.4 s."""
    step = make_car_step(vehicle, math, dt, method)
    state = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.2, 0.1)
    for _ in range(round(seconds / dt)):
        state = step(*state, 0.35, 0.6)
    return np.array(state)


@each_car
def test_halving_the_step_divides_the_error_by_sixteen(vehicle):
    exact = drive(vehicle, 1.0 / 6400)
    coarse, fine = (np.abs(drive(vehicle, dt) - exact).max() for dt in (1 / 200, 1 / 400))
    assert math.log2(coarse / fine) == pytest.approx(4.0, abs=0.35)


@pytest.mark.parametrize(("method", "order"), [("midpoint", 2.0), ("euler", 1.0)])
def test_cheaper_methods_are_of_lower_order(method, order):
    exact = drive(LAGGED, 1.0 / 3200)
    coarse, fine = (np.abs(drive(LAGGED, dt, method=method) - exact).max()
                    for dt in (1 / 400, 1 / 800))
    assert math.log2(coarse / fine) == pytest.approx(order, abs=0.15)


def test_lags_follow_the_exponential_and_none_acts_at_once():
    state = drive(LAGGED, 0.01)
    assert state[6] == pytest.approx(0.35 - 0.15 * math.exp(-0.4 / 0.08), rel=1e-12)
    assert state[7] == pytest.approx(0.6 - 0.5 * math.exp(-0.4 / 0.12), rel=1e-12)
    without = replace(PAPER, delay=Delay())
    held = make_motion_step(without, math, 0.01)
    from dart_hal.vehicle import make_steering
    angle = make_steering(PAPER.steering)(0.6)
    car = make_car_step(without, math, 0.01)(0, 0, 0, 1.0, 0, 0, -0.2, -0.3, 0.35, 0.6)
    assert car[:6] == pytest.approx(held(0, 0, 0, 1.0, 0, 0, 0.35, angle), rel=1e-12)
    assert car[6:] == (0.35, 0.6)


@each_car
def test_a_batch_is_many_single_cars(vehicle):
    rng = np.random.default_rng(3)
    n = 7
    steps = 40
    start = np.vstack([rng.uniform(-1, 1, (3, n)), rng.uniform(0.3, 3, (1, n)),
                       rng.uniform(-0.2, 0.2, (2, n)), rng.uniform(0, 0.4, (1, n)),
                       rng.uniform(-1, 1, (1, n))])
    commands = rng.uniform((0.0, -1.0), (0.5, 1.0), (steps, n, 2))
    batch = Batch(vehicle, n, dtype=np.float64)
    batch.state[:] = start
    for row in commands:
        batch.advance(row[:, 0], row[:, 1])
    step = make_car_step(vehicle, math, 0.01)
    for lane in range(n):
        state = tuple(start[:, lane].tolist())
        for row in commands:
            state = step(*state, *row[lane].tolist())
        np.testing.assert_allclose(batch.state[:, lane], state, rtol=1e-11, atol=1e-12)


def test_every_lane_may_be_another_vehicle():
    heavy = with_values(PAPER, {"body.mass": 2.0})
    start = np.array([[0, 0], [0, 0], [0, 0], [1.0, 1.0], [0, 0], [0, 0]])
    inputs = np.full((50, 2), 0.3), np.full((50, 2), 0.1)
    both = rollout(stack([PAPER, heavy]), start, *inputs, output_samples=[10, 50])
    for lane, vehicle in enumerate((PAPER, heavy)):
        one = rollout(vehicle, start[:, :1], inputs[0][:, :1], inputs[1][:, :1],
                      output_samples=[10, 50])
        np.testing.assert_allclose(both[:, :, lane], one[:, :, 0], rtol=1e-13)
    assert abs(both[1, 3, 0] - both[1, 3, 1]) > 0.005
    with pytest.raises(UsageError, match="different equations"):
        stack([PAPER, UPSTREAM_2024])


def test_rollout_reads_the_requested_samples():
    start = np.array([[0.0], [0.0], [0.2], [1.0], [0.0], [0.0]])
    throttle = np.full((20, 1), 0.3)
    angle = np.full((20, 1), 0.1)
    every = rollout(PAPER, start, throttle, angle)
    some = rollout(PAPER, start, throttle, angle, output_samples=[0, 7, 20])
    np.testing.assert_array_equal(some, [start, every[6], every[19]])
    with pytest.raises(UsageError, match="shapes"):
        rollout(PAPER, start, throttle, angle[:, 0])
    with pytest.raises(UsageError, match="read there"):
        rollout(PAPER, start, throttle, angle, output_samples=[21])


@pytest.mark.parametrize("vehicle", SETS.values(), ids=SETS)
def test_names_and_values_lead_back_to_the_vehicle(vehicle, tmp_path):
    same = with_values(vehicle, {name: value(vehicle, name) for name in names(vehicle)})
    assert same == vehicle
    low, high = bounds(vehicle, "friction.a")
    assert low <= vehicle.friction.a <= high
    assert unit(vehicle, "friction.a") == "N"
    assert vehicle_of(model_of(vehicle)) == vehicle
    assert find_model(vehicle.name)[1] == vehicle


def test_wrong_names_and_values_are_refused():
    with pytest.raises(UsageError, match=r"friction\.z"):
        with_values(PAPER, {"friction.z": 1.0})
    with pytest.raises(ConfigError, match="out of range"):
        with_values(PAPER, {"body.mass": 1670.0})
    with pytest.raises(ConfigError, match="kind"):
        replace(PAPER, kind="holonomic")
    with pytest.raises(UsageError, match="no model is called"):
        find_model("papper")


@pytest.mark.parametrize("engine", ["numpy", "auto"])
def test_a_start_of_integers_is_not_cut_off(engine):
    """Integers in, real numbers out: 0.2 m are not 0."""
    start = np.zeros((6, 2), dtype=int)
    start[3] = 1
    throttle = np.full((20, 2), 0.3)
    angle = np.full((20, 2), 0.1)
    got = rollout(PAPER, start, throttle, angle, output_samples=[20], engine=engine)
    assert got.dtype == np.float64
    np.testing.assert_allclose(got, rollout(PAPER, start.astype(float), throttle, angle,
                                            output_samples=[20], engine=engine))
    assert got[0, 0, 0] > 0.2


@pytest.mark.parametrize("wrong", [
    {"substeps": 0}, {"substeps": -1}, {"sample": 0.0}, {"sample": -0.01}, {"sample": math.nan},
    {"output_samples": [1.5]}, {"output_samples": [21]}, {"output_samples": [-1]}])
@pytest.mark.parametrize("engine", ["numpy", "auto"])
def test_a_rollout_that_makes_no_sense_is_refused(engine, wrong):
    start = np.zeros((6, 2))
    inputs = np.zeros((20, 2))
    with pytest.raises(UsageError):
        rollout(PAPER, start, inputs, inputs, engine=engine, **wrong)


@pytest.mark.parametrize("engine", ["numpy", "auto"])
def test_a_stack_of_another_size_is_refused(engine):
    two = stack([PAPER, with_values(PAPER, {"body.mass": 2.0})])
    with pytest.raises(UsageError, match="for each car"):
        rollout(two, np.zeros((6, 3)), np.zeros((5, 3)), np.zeros((5, 3)), engine=engine)
    with pytest.raises(UsageError, match="for each car"):
        Batch(two, 3, engine=engine)
    with pytest.raises(UsageError, match="real numbers"):
        Batch(PAPER, 3, dtype=int, engine=engine)
