"""Delay by whole samples, lag by its recursion, both from the start of the recording."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dart_hal.identify.evaluation.commands import actuated, delayed, lagged
from dart_hal.vehicle.sets import PAPER, UPSTREAM_2024
from dart_hal.vehicle.steering import make_steering


def recursion(u, lag):
    y = [u[0]]
    for i in range(1, len(u)):
        y.append(y[-1] + (1.0 - math.exp(-0.01 / lag)) * (u[i - 1] - y[-1]))
    return np.array(y)


@pytest.mark.parametrize("lag", [0.003, 0.0843, 0.5])
def test_lag_is_its_recursion(lag):
    u = np.random.default_rng(1).normal(size=400)
    assert np.abs(lagged(u, lag) - recursion(u, lag)).max() < 1e-12


def test_a_step_reaches_its_share_after_one_time_constant():
    u = np.where(np.arange(200) < 50, 0.0, 1.0)
    assert lagged(u, 0.2)[50 + 20] == pytest.approx(1.0 - math.exp(-1.0), abs=1e-12)
    assert lagged(u, 0.2)[50] == 0.0, "the lag answers one sample later"
    assert np.array_equal(lagged(u, 0.0), u)


@pytest.mark.parametrize(("delay", "samples"), [(0.0, 0), (0.004, 0), (0.15, 15), (0.1501, 15),
                                                (0.156, 16), (9.0, 30)])
def test_delay_shifts_by_whole_samples_and_holds_the_first_value(delay, samples):
    u = np.arange(1.0, 31.0)
    expected = np.concatenate([np.full(samples, 1.0), u])[:30]
    assert np.array_equal(delayed(u, delay), expected)


def test_delay_then_lag_then_map(empty):
    rng = np.random.default_rng(2)
    g = replace(empty(300), throttle=rng.uniform(0, 0.5, 300), steering=rng.uniform(-1, 1, 300))
    p = replace(UPSTREAM_2024, delay=replace(UPSTREAM_2024.delay, steering_s=0.07))
    throttle, angle = actuated(p, g)
    d = p.delay
    late = np.concatenate([np.full(7, g.steering[0]), g.steering[:-7]])
    curve = make_steering(p.steering)
    expected = [curve(float(s)) for s in recursion(late, d.steering_lag_s)]
    assert np.abs(angle - expected).max() < 1e-12
    assert np.abs(throttle - recursion(g.throttle, d.throttle_lag_s)).max() < 1e-12


def test_the_paper_delays_steering_alone(empty):
    g = replace(empty(60), throttle=np.arange(60.0) / 60, steering=np.arange(60.0) / 60)
    throttle, angle = actuated(PAPER, g)
    assert np.array_equal(throttle, g.throttle)
    assert angle[40] == pytest.approx(make_steering(PAPER.steering)(25.0 / 60), abs=1e-12)
