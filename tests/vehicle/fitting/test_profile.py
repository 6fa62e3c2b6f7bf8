"""A standard error is believed where the loss at two of it agrees with the quadratic."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.vehicle.fitting.covariance import fixed_value_covariance
from dart_hal.vehicle.fitting.least_squares import Solution
from dart_hal.vehicle.fitting.profile import agrees_with_quadratic

DESIGN = np.column_stack([np.ones(40), np.linspace(-1.0, 1.0, 40)])
LOW = np.full(2, -10.0)
HIGH = np.full(2, 10.0)


def solve_step(residual, x, h=1e-4):
    jacobian = np.column_stack([(residual(x + h * e) - residual(x - h * e)) / (2.0 * h)
                                for e in np.eye(len(x))])
    r = residual(x)
    return Solution(x, r, jacobian, np.ones(len(r)), True, np.zeros(len(x), dtype=bool))


def plain(x):
    return DESIGN @ (x - 1.0)


def rough(x):
    """As an unstable rollout: noise that changes with the last digits of the second parameter."""
    noise = np.sin(1e5 * x[1] * (1.0 + np.arange(40)))
    return plain(x) + 0.02 * noise


def bent(x):
    """The second parameter acts more and more on one side."""
    return DESIGN[:, 0] * (x[0] - 1.0) + DESIGN[:, 1] * np.expm1(3.0 * (x[1] - 1.0))


@pytest.mark.parametrize(("residual", "expected"), [
    (plain, [True, True]), (bent, [True, False]), (rough, [True, False])])
def test_only_a_parabola_agrees(residual, expected):
    solution = solve_step(residual, np.ones(2), 1e-7 if residual is rough else 1e-4)
    agrees = agrees_with_quadratic(residual, solution, np.array([0.3, 0.3]), LOW, HIGH)
    assert agrees.tolist() == expected


def test_control_a_small_error_of_a_bent_loss_agrees():
    assert agrees_with_quadratic(bent, solve_step(bent, np.ones(2)), np.array([0.3, 0.01]), LOW,
                           HIGH).tolist() == [True, True]


def test_a_bound_cuts_a_side_off_and_two_leave_nothing():
    solution = solve_step(plain, np.ones(2))
    one = agrees_with_quadratic(plain, solution, np.full(2, 0.3), np.array([1.0, -10.0]), HIGH)
    both = agrees_with_quadratic(plain, solution, np.full(2, 0.3), np.ones(2), np.ones(2))
    assert one.tolist() == [True, True]
    assert both.tolist() == [False, False]


def test_an_error_that_is_not_finite_never_agrees():
    assert not agrees_with_quadratic(plain, solve_step(plain, np.ones(2)), np.array([np.inf, 0.0]),
                                     LOW,
                               HIGH).any()


def test_a_held_quantity_adds_what_it_moves_the_fit_by():
    """An offset of the data of 0.1 moves the mean by 0.1 and the slope by nothing."""
    found = fixed_value_covariance(solve_step(plain, np.ones(2)), np.full((40, 1), 0.1))
    assert found == pytest.approx(np.array([[0.01, 0.0], [0.0, 0.0]]), abs=1e-12)
