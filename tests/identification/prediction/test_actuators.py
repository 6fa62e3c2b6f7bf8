"""Delay by whole samples, lag by its recursion, both from the start of the recording."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dart_hal.core.errors import UsageError
from dart_hal.vehicle.delay import first_order_lag, low_pass
from dart_hal.vehicle.effect import ActiveEffect, Effect, Parameter, PureDelay, Stateful, Static
from dart_hal.vehicle.effects import apply, catalogue
from dart_hal.vehicle.sets import PAPER, UPSTREAM_2024
from dart_hal.vehicle.steering import make_steering
from dart_lab.identification.prediction.actuators import (
    actuator_outputs,
    apply_command_effects,
    delay_command,
)


def recursion(u, lag):
    y = [u[0]]
    for i in range(1, len(u)):
        y.append(y[-1] + (1.0 - math.exp(-0.01 / lag)) * (u[i - 1] - y[-1]))
    return np.array(y)


@pytest.mark.parametrize("lag", [0.003, 0.0843, 0.5])
def test_lag_is_its_recursion(lag):
    u = np.random.default_rng(1).normal(size=400)
    assert np.abs(first_order_lag(u, lag) - recursion(u, lag)).max() < 1e-12


def test_a_step_reaches_its_share_after_one_time_constant():
    u = np.where(np.arange(200) < 50, 0.0, 1.0)
    assert first_order_lag(u, 0.2)[50 + 20] == pytest.approx(1.0 - math.exp(-1.0), abs=1e-12)
    assert first_order_lag(u, 0.2)[50] == 0.0, "the lag answers one sample later"
    assert np.array_equal(first_order_lag(u, 0.0), u)


@pytest.mark.parametrize("lag", [0.003, 0.0843])
def test_a_lag_may_be_taken_in_the_middle_of_a_sample_or_as_its_mean(lag):
    parts = 1000  # of a sample, in which the recursion is all but continuous
    u = np.random.default_rng(4).normal(size=30)
    step, y, dense = math.exp(-0.01 / parts / lag), u[0], []
    for held in np.repeat(u, parts):
        dense.append(y)
        y = held + step * (y - held)
    dense = np.reshape(dense, (30, parts))
    for sampled, expected in (("start", dense[:, 0]), ("middle", dense[:, parts // 2]),
                              ("mean", dense.mean(axis=1))):
        assert np.abs(first_order_lag(u, lag, sampled) - expected).max() < 3e-2 / parts / lag
        assert np.array_equal(first_order_lag(u, 0.0, sampled), u)
    assert np.abs(dense[:, 0] - dense.mean(axis=1)).max() > 0.05, "the three differ"


@pytest.mark.parametrize("shape", [(1,), (63,), (65,), (3, 200)])
@pytest.mark.parametrize("keep", [0.0, 1e-8, 0.5, 0.9999])
def test_blocks_of_a_lag_are_its_recursion(shape, keep):
    u = np.random.default_rng(3).normal(size=shape)
    y = [u[..., 0]]
    for i in range(1, shape[-1]):
        y.append(keep * y[-1] + (1.0 - keep) * u[..., i - 1])
    assert np.abs(low_pass(u, keep) - np.stack(y, axis=-1)).max() < 1e-12


@pytest.mark.parametrize(("delay", "samples"), [(0.0, 0), (0.004, 0), (0.15, 15), (0.1501, 15),
                                                (0.156, 16), (9.0, 30)])
def test_delay_shifts_by_whole_samples_and_holds_the_first_value(delay, samples):
    u = np.arange(1.0, 31.0)
    expected = np.concatenate([np.full(samples, 1.0), u])[:30]
    assert np.array_equal(delay_command(u, delay), expected)
    assert np.array_equal(delay_command(u[::-1], -delay), expected[::-1])


def test_delay_then_lag_then_map(empty):
    rng = np.random.default_rng(2)
    g = replace(empty(300), throttle=rng.uniform(0, 0.5, 300), steering=rng.uniform(-1, 1, 300))
    p = replace(UPSTREAM_2024, delay=replace(UPSTREAM_2024.delay, steering_s=0.07))
    throttle, angle = actuator_outputs(p, g)
    d = p.delay
    late = np.concatenate([np.full(7, g.steering[0]), g.steering[:-7]])
    curve = make_steering(p.steering)
    expected = [curve(float(s)) for s in recursion(late, d.steering_lag_s)]
    assert np.abs(angle - expected).max() < 1e-12
    assert np.abs(throttle - recursion(g.throttle, d.throttle_lag_s)).max() < 1e-12


def test_the_paper_delays_steering_alone(empty):
    g = replace(empty(60), throttle=np.arange(60.0) / 60, steering=np.arange(60.0) / 60)
    throttle, angle = actuator_outputs(PAPER, g)
    assert np.array_equal(throttle, g.throttle)
    assert angle[40] == pytest.approx(make_steering(PAPER.steering)(25.0 / 60), abs=1e-12)


def carrying(p, *values, **hooks):
    """The vehicle with an effect of these hooks."""
    effect = Effect("made_up", "is made up", "none", "command",
                    tuple(Parameter(f"k{i}", "-", -1.0, 1.0, (0.1, 0.2, 0.3))
                          for i in range(len(values))), (), "none", **hooks)
    return replace(p, effects=(ActiveEffect(effect, values),))


@pytest.mark.parametrize("name", [n for n, e in catalogue().items() if "steering" in e.signals])
def test_where_the_servo_is_does_not_hang_on_the_rest_of_the_car(empty, name):
    """The diagnosis keeps it while map, tyres and motor move."""
    s, g = np.random.default_rng(5).uniform(-1, 1, 100), empty(100)
    k = catalogue()[name].parameters[0].sizes[2]
    other = replace(UPSTREAM_2024, steering=replace(PAPER.steering, k_left=3.0))
    a, b = (apply_command_effects(apply(p, name, k=k), "steering", s, g, "mean") for p
            in (PAPER, other))
    assert np.array_equal(a, b)
    assert not np.array_equal(a, s)


def test_effects_on_commands_enter_where_they_state(empty):
    rng = np.random.default_rng(3)
    g = replace(empty(300), throttle=rng.uniform(0, 0.5, 300), steering=rng.uniform(-1, 1, 300))
    throttle, angle = actuator_outputs(PAPER, g)
    fading = Static(lambda p, f, k: lambda u, now: u * (1.0 - k * now.t))
    got = actuator_outputs(carrying(PAPER, 0.1, signals={"throttle": fading}), g)
    assert np.allclose(got[0], throttle * (1.0 - 0.1 * g.t), atol=1e-15)
    assert np.array_equal(got[1], angle)
    offset = Static(lambda p, f, k: lambda u, now: u + k)
    got = actuator_outputs(carrying(PAPER, 0.02, signals={"steering": offset}), g)
    s = delay_command(g.steering, PAPER.delay.steering_s)
    assert np.allclose(got[1], make_steering(PAPER.steering, np)(s + 0.02), atol=1e-12)
    late = PureDelay(lambda k: k)
    assert np.array_equal(actuator_outputs(carrying(PAPER, 0.05, signals={"angle": late}), g)[1],
                          delay_command(angle, 0.05))

    def slack(p, f, dt, width):
        def step(u, now, held):
            held = min(max(held, u - width), u + width)
            return held, held
        return (lambda u: (u,)), step

    got = actuator_outputs(carrying(PAPER, 0.1, signals={"angle": Stateful(slack)}), g)[1]
    assert np.abs(got - angle).max() == pytest.approx(0.1)
    assert got[0] == angle[0]


def test_effects_on_parameters_are_applied_first(empty):
    g = replace(empty(60), steering=np.full(60, 0.5))

    def slower(p, seconds):
        return replace(p, delay=replace(p.delay, steering_s=p.delay.steering_s + seconds))

    g = replace(g, steering=np.arange(60.0) / 60)
    got = actuator_outputs(carrying(PAPER, 0.1, vehicle=slower), g)[1]
    assert np.array_equal(got, actuator_outputs(slower(PAPER, 0.1), g)[1])


def test_an_effect_that_needs_the_motion_is_refused(empty):
    hook = Static(lambda p, f, k: lambda u, now: u + k * now.v_x)
    with pytest.raises(UsageError, match="made_up"):
        actuator_outputs(carrying(PAPER, 0.1, signals={"angle": hook}), empty(50))
