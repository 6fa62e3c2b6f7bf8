"""A step within a box: no lower point is in it, however correlated the parameters."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.vehicle.fitting.levenberg_marquardt import (
    JACOBIAN_TOLERANCE,
    descend,
    solve_box_quadratic,
)


def quadratic(normal, slope, move):
    return 0.5 * move @ normal @ move + slope @ move


@given(st.integers(0, 10**6), st.integers(1, 20), st.floats(0.0, 0.3))
def test_every_slope_at_the_end_points_out_of_the_box(seed, n, pinned):
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(n + 2, n)) * 10.0**rng.uniform(-2.0, 2.0, n)
    a[:, -1] = a[:, 0] + 1e-3 * rng.normal(size=n + 2)  # two that nearly do the same
    normal = a.T @ a + 1e-6 * np.eye(n)
    slope = 10.0 * rng.normal(size=n)
    low, high = (sign * rng.uniform(size=n) * (rng.random(n) >= pinned) for sign in (-1.0, 1.0))
    move = solve_box_quadratic(normal, slope, low, high)
    assert ((low <= move) & (move <= high)).all()
    g = (slope + normal @ move) / np.sqrt(np.diag(normal))
    assert (g[move > low] < 1e-5).all()
    assert (g[move < high] > -1e-5).all()


def step_in_box(normal, slope, low, high):
    """What is tempting: the free minimum, and all that leaves the box stays at its edge."""
    move = np.zeros(len(slope))
    free = np.ones(len(slope), dtype=bool)
    while free.any():
        rest = slope[free] + normal[np.ix_(free, ~free)] @ move[~free]
        move[free] = -np.linalg.solve(normal[np.ix_(free, free)], rest)
        out = free & ((move < low) | (move > high))
        if not out.any():
            break
        move[out] = np.clip(move, low, high)[out]
        free &= ~out
    return move


def test_holding_all_that_leaves_the_box_ends_above_the_beginning():
    a = np.array([[0.5, -0.9, 0.7], [1.7, 1.4, 1.7], [-1.1, -1.1, -1.0], [1.9, 2.3, 2.0]])
    box = np.array([-0.2, -0.7, 0.0]), np.array([0.6, 1.0, 0.9])
    of = a.T @ a + 0.01 * np.eye(3), np.array([0.9, 0.6, 0.4])
    assert quadratic(*of, step_in_box(*of, *box)) > 12.0
    assert quadratic(*of, solve_box_quadratic(*of, *box)) < 0.0


def test_without_a_bound_it_is_the_newton_step():
    normal = np.array([[2.0, 0.5], [0.5, 1.0]])
    slope = np.array([1.0, -3.0])
    far = np.full(2, 1e9)
    newton = -np.linalg.solve(normal, slope)
    assert solve_box_quadratic(normal, slope, -far, far) == pytest.approx(newton)


@pytest.mark.parametrize(("reach", "ends"), [(0.5, 0.5 * np.pi), (np.inf, 5.5 * np.pi)])
def test_no_step_goes_further_than_its_slope_is_believed(reach, ends):
    """Where a slope is nearly flat a step would leap over the nearest bottom; beyond others."""
    found = descend(lambda x: np.cos(x), lambda x, r: -np.sin(x)[:, None], np.array([0.04]),
                    np.array([-50.0]), np.array([50.0]), robust=1e6, prior=0.0, max_step=reach)
    assert found.x[0] == pytest.approx(ends, abs=1e-2)


@pytest.mark.parametrize("bend", [0.02, 1.0])
def test_slopes_are_kept_while_steps_gain_what_they_promise(bend):
    """The same bottom as with slopes of every step, from fewer of them; most where all is flat."""
    rng = np.random.default_rng(4)
    mix = rng.normal(size=(30, 5))
    target = rng.normal(size=5)
    counts = {}

    def count_calls(kept):
        counts[kept] = 0

        def residual(x):
            z = x - target
            return mix @ (z + bend * z**2) + 0.3

        def jacobian(x, r):
            counts[kept] += 1
            return mix * (1.0 + 2.0 * bend * (x - target))

        return descend(residual, jacobian, np.zeros(5), np.full(5, -9.0), np.full(5, 9.0),
                       robust=3.0, prior=1e-9, cost_tolerance=1e-6,
                       jacobian_tolerance=kept)

    often = count_calls(0.0)
    seldom = count_calls(JACOBIAN_TOLERANCE)
    assert seldom.x == pytest.approx(often.x, abs=2e-3)
    assert counts[JACOBIAN_TOLERANCE] < counts[0.0]
    assert bend > 0.1 or counts[JACOBIAN_TOLERANCE] == 1
