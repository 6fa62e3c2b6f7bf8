"""Standard errors against closed forms, where few samples make every factor show."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.vehicle.fitting.covariance import (
    block_covariance,
    leverage_covariance,
    plain_covariance,
)
from dart_hal.vehicle.fitting.least_squares import Solution, least_squares


def mean_of(y, robust=None):
    """The simplest fit there is: one number for all samples."""
    return least_squares(lambda x: x[0] - y, [0.0], ([-1e3], [1e3]), robust=robust)


def test_independent_residuals_give_the_textbook_error_of_a_line():
    """s^2 (X'X)^-1 with n - 2 degrees of freedom: with five samples n would be 40 % less."""
    t = np.arange(5.0)
    y = np.array([1.0, 3.5, 4.0, 7.5, 8.0])
    s = least_squares(lambda x: x[0] + x[1] * t - y, [0.0, 0.0], ([-99, -99], [99, 99]))
    design = np.stack([np.ones(5), t], axis=1)
    value, rest = np.linalg.lstsq(design, y, rcond=None)[:2]
    assert s.x == pytest.approx(value, abs=1e-7)
    assert plain_covariance(s) == pytest.approx(rest[0] / 3 * np.linalg.inv(design.T @ design),
                                                rel=1e-5)


def test_blocks_count_as_one_sample_each():
    """Three blocks of 50 equal samples: the error of a mean of three numbers, not of 150."""
    level = np.array([1.0, 2.0, 6.0])
    y = np.repeat(level, 50)
    block = np.repeat(np.arange(3), 50)
    s = mean_of(y)
    assert block_covariance(s, block)[0, 0] == pytest.approx(level.var(ddof=1) / 3, rel=1e-6)
    assert plain_covariance(s)[0, 0] < 0.05 * block_covariance(s, block)[0, 0]


@pytest.mark.parametrize("far", [1e2, 1e4])
def test_a_wild_sample_moves_neither_value_nor_error_when_it_is_held_down(far):
    rng = np.random.default_rng(2)
    y = rng.normal(5.0, 0.1, 200)
    block = np.arange(200) // 10
    wild = y.copy()
    wild[7] = far
    clean = mean_of(y, robust=0.2)
    held = mean_of(wild, robust=0.2)
    assert held.weight[7] < 0.01 < 0.5 < held.weight[:7].min()
    assert abs(held.x[0] - clean.x[0]) < 0.003
    error, usual = (np.sqrt(block_covariance(s, block)[0, 0]) for s in (held, clean))
    assert error == pytest.approx(usual, rel=0.5)
    assert np.sqrt(block_covariance(mean_of(wild), block)[0, 0]) > 20 * usual


def test_a_prior_of_one_parameter_leaves_the_others_to_the_data():
    """In blocks of one sample: slope by the data, the other, which they do not determine, by 1."""
    rng = np.random.default_rng(8)
    column = rng.normal(0.0, 1.0, 4000)
    s = Solution(np.zeros(2), 0.5 * rng.normal(0.0, 1.0, 4000),
                 np.column_stack([column, np.zeros(4000)]), np.ones(4000), True,
                 np.zeros(2, dtype=bool))
    found = block_covariance(s, np.arange(4000), np.array([0.0, 0.25]))
    assert np.sqrt(found[0, 0]) == pytest.approx(0.5 / np.sqrt(4000), rel=0.05)
    assert found[1, 1] == pytest.approx(1.0)


def test_a_fit_of_many_parameters_counts_them():
    """Of 24 blocks 8 parameters are fitted: B / (B - p) of the scatter, not B / (B - 1)."""
    rng = np.random.default_rng(5)
    found = []
    plain = []
    for _ in range(40):
        design = rng.normal(size=(240, 8))
        noise = rng.normal(size=240)
        x = np.linalg.lstsq(design, noise, rcond=None)[0]
        s = Solution(x, design @ x - noise, design, np.ones(240), True, np.zeros(8, dtype=bool))
        block = np.repeat(np.arange(24), 10)
        for out, counted in ((found, True), (plain, False)):
            std = np.sqrt(np.diag(block_covariance(s, block, count_parameters=counted)))
            out.append(x / std)
    assert np.mean(np.abs(found) < 1.645) > np.mean(np.abs(plain) < 1.645) + 0.02
    assert 0.85 < np.mean(np.abs(found) < 1.645) < 0.95


@pytest.mark.parametrize("noise", [1.0, 5.0])
def test_a_robust_fit_is_as_uncertain_as_its_noise_is_larger_than_its_scale(noise):
    """With the weights of the least squares in place of the second derivative: 1.8 for noise 5."""
    rng = np.random.default_rng(0)
    x = rng.normal(size=600)
    block = np.repeat(np.arange(30), 20)
    deviations = []
    for _ in range(60):
        y = noise * rng.normal(size=600)
        fit = least_squares(lambda p, y=y: y - p[0] - p[1] * x, [0.0, 0.0],
                            ([-100.0] * 2, [100.0] * 2), robust=3.0)
        deviations += list(fit.x / np.sqrt(np.diag(leverage_covariance(fit, block))))
    assert np.sqrt(np.mean(np.square(deviations))) == pytest.approx(1.0, abs=0.2)
