"""The disturbance has the same effect with any step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_lab.sim.light import Disturbance, LightBatch, LightConfig
from dart_lab.sim.light.force import RandomForce

CARS = 4000
SIGMA = 0.05


def variance(disturbance, step, seconds=0.6):
    """Variance of v_x over many cars that coast from 2 m/s."""
    batch = LightBatch(PAPER, CARS, LightConfig(sensors=None, step=step, disturbance=disturbance),
                       seed=7)
    start = np.zeros((6, CARS))
    start[3] = 2.0
    batch.reset(start)
    batch.advance(np.zeros(CARS), np.zeros(CARS), round(seconds / step))
    return float(np.var(batch.state[3]))


STEP_LENGTHS = (0.005, 0.01, 0.02)


@pytest.mark.slow
def test_white_noise_has_the_variance_of_theory():
    """dv = -c/m v dt + density/m dW: friction beyond 1 m/s is linear."""
    damp = PAPER.friction.c / PAPER.body.mass
    expected = (SIGMA / PAPER.body.mass) ** 2 * (1 - math.exp(-2 * damp * 0.6)) / (2 * damp)
    assert variance(Disturbance(SIGMA, 0.0, 0.0), 0.01) == pytest.approx(expected, rel=0.08)


@pytest.mark.parametrize("disturbance", [
    Disturbance(SIGMA, 0.0, 0.0), Disturbance(0.12, 0.0, 0.15)],
                         ids=["white", "correlated"])
@pytest.mark.slow
def test_the_effect_does_not_depend_on_the_step(disturbance):
    got = [variance(disturbance, step) for step in STEP_LENGTHS]
    assert max(got) / min(got) < 1.12


@pytest.mark.slow
def test_noise_without_the_root_of_the_step_would_fail():
    """The negative control: one kick of the same size per step, as is often written."""
    got = [variance(Disturbance(SIGMA * math.sqrt(0.01 / step), 0.0, 0.0), step)
           for step in STEP_LENGTHS]
    assert max(got) / min(got) > 2.0


@pytest.mark.parametrize("step", STEP_LENGTHS)
def test_a_correlated_force_has_its_size_and_its_memory(step):
    rng = np.random.default_rng(3)
    kick = RandomForce(Disturbance(0.12, 0.12, 0.15), 1.5, step)
    kick.force = kick.start(rng.standard_normal((2, CARS)))
    state = tuple(np.zeros((8, CARS)))
    first = kick.force[0].copy()
    for _ in range(round(0.15 / step)):
        state = kick(state, rng.standard_normal((2, CARS)))
    assert np.std(first) == pytest.approx(0.12, rel=0.04)
    assert np.std(kick.force[0]) == pytest.approx(0.12, rel=0.04)
    lags = round(0.15 / step) * step / 0.15
    assert np.corrcoef(first, kick.force[0])[0, 1] == pytest.approx(math.exp(-lags), abs=0.05)
    assert np.corrcoef(kick.force[0], kick.force[1])[0, 1] == pytest.approx(0.0, abs=0.05)


def test_no_force_changes_nothing():
    quiet, none = (LightBatch(PAPER, 2, LightConfig(disturbance=d)) for d in (
        Disturbance(0.0, 0.0, 0.0), Disturbance()))
    for batch in (quiet, none):
        batch.advance(np.full(2, 0.3), np.full(2, 0.2), 100)
    np.testing.assert_array_equal(np.array(quiet.state), np.array(none.state))
