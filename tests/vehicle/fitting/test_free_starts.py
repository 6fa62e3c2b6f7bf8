"""Free starts are eliminated, not guessed: parameters and errors are those of one large fit."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.vehicle.fitting.covariance import plain_covariance, pool_blocks
from dart_hal.vehicle.fitting.free_starts import FreeStarts, fit_free_starts

TIMES = np.tile(np.linspace(0.0, 1.0, 12), 5)
STRETCH = np.repeat(np.arange(5), 12)


def readings(p: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Exponential decay (P, n) to a level, by rate and level p (P, 2), from starts (P, 5)."""
    fade = np.exp(-p[:, :1] * TIMES)
    return p[:, 1:] * (1.0 - fade) + starts[:, STRETCH] * fade


@pytest.fixture
def problem():
    rng = np.random.default_rng(0)
    truth = readings(np.array([[2.0, 0.5]]), rng.uniform(1.0, 3.0, (1, 5)))[0]
    return FreeStarts(readings, truth + rng.normal(0.0, 0.01, len(TIMES)), STRETCH,
                      np.array([0.1, -1.0]), np.array([9.0, 2.0]), np.array([1e-4, 1e-4]))


def test_it_finds_what_one_fit_of_parameters_and_starts_together_finds(problem):
    from scipy.optimize import least_squares

    found, starts = fit_free_starts(problem, np.array([1.0, 0.0]), problem.measured[::12].copy())
    whole = least_squares(lambda x: readings(x[None, :2], x[None, 2:])[0] - problem.measured,
                          np.concatenate([found.x, starts]), xtol=1e-12)
    assert found.converged
    jac = whole.jac
    error = np.sqrt(np.diag(np.linalg.inv(jac.T @ jac))[:2] * np.mean(whole.fun**2))
    assert found.x == pytest.approx(whole.x[:2], abs=0.2 * error.min())  # its loss is robust
    assert np.sqrt(np.diag(plain_covariance(found))) == pytest.approx(error, rel=0.15)


def test_a_parameter_ends_at_its_bound_and_reports_it(problem):
    from dataclasses import replace

    found, _ = fit_free_starts(replace(problem, high=np.array([1.5, 2.0])), np.array([1.0, 0.0]),
                     problem.measured[::12].copy())
    assert found.at_bound.tolist() == [True, False]
    assert found.x[0] == 1.5


def test_blocks_of_parts_stay_separate():
    owner, block = pool_blocks([np.array([4, 4, 9]), np.array([4, 5])])
    assert owner.tolist() == [0, 0, 0, 1, 1]
    assert block.tolist() == [0, 0, 1, 2, 3]
