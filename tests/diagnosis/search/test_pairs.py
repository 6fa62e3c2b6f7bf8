"""Two causes that hide each other are looked for together."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from dart_lab.diagnosis.evidence.noise import Noise
from dart_lab.diagnosis.search.fit import Point
from dart_lab.diagnosis.search.pairs import find_masked_effect, find_masking_pairs, pair_gains
from dart_lab.diagnosis.search.scan import Trial

RESIDUAL_ROWS = 400
MAX_GAIN = 20.0


def unit(x):
    return x / np.linalg.norm(x)


RNG = np.random.default_rng(3)
BASE, PLAY, SEPARATE, ELSE, OTHER_DIRECTION = np.linalg.qr(RNG.normal(size=(RESIDUAL_ROWS, 5)))[0].T
TRIM = unit(SEPARATE - 0.3 * PLAY)
"""Turns against the play: each takes most of what the other does to the residuals away."""
GAIN = unit(PLAY + SEPARATE + 0.8 * ELSE)
MAX_STEP = 2.0
PAIR_NAMES = ("steering_backlash", "steering_trim", "steering_gain", "steering_lag")
TRUE_RESIDUAL = 20.0 * PLAY + 14.0 * TRIM


def point(residual, jacobian=BASE[:, None]):
    k = jacobian.shape[1]
    noise = Noise(np.eye(1), np.ones(4), np.ones(5))
    return Point(noise, SimpleNamespace(prior_weight=np.zeros(k)), np.zeros(k), residual,
                 np.ones(RESIDUAL_ROWS), jacobian)


def trials(fit, directions):
    out = []
    for name, d in zip(PAIR_NAMES, directions, strict=False):
        k = max(float(-d @ fit.residual), 0.0)
        out.append(Trial(name, {"k": k}, k**2, fit.residual + k * d))
    return sorted(out, key=lambda t: -t.gain)


def fit_with_direction(fit, trial):
    """Least squares with one direction more."""
    columns = np.column_stack([fit.jacobian, unit(trial.residual - fit.residual)])
    x = np.linalg.lstsq(columns, fit.residual, rcond=None)[0]
    return point(fit.residual - columns @ x, columns)


def select_pairs(fit, directions, limit=MAX_GAIN):
    of = trials(fit, directions)
    limits = dict.fromkeys(PAIR_NAMES, limit)
    passed = [t for t in of if t.gain > limit]
    best = of[0].effect
    found = find_masked_effect(fit, passed, of, limits, {best: fit_with_direction(fit, of[0])},
                               fit_with_direction, MAX_STEP)
    return best, found and found.effect


def test_one_of_two_that_hide_each_other_goes_before_their_impostor():
    best, first = select_pairs(point(TRUE_RESIDUAL), [-PLAY, -TRIM, -GAIN, -OTHER_DIRECTION])
    assert best == "steering_gain"
    assert first == "steering_backlash"


def test_two_that_together_are_an_impostor_do_not_go_before_the_cause():
    best, first = select_pairs(point(20.0 * GAIN + 2.0 * OTHER_DIRECTION),
                               [-PLAY, -SEPARATE, -GAIN, -OTHER_DIRECTION])
    assert (best, first) == ("steering_gain", None)


def test_a_cause_that_chance_could_do_better_is_no_reason():
    fit = point(TRUE_RESIDUAL)
    with_both = float(fit.residual @ fit.residual)
    assert select_pairs(fit, [-PLAY, -TRIM, -GAIN, -OTHER_DIRECTION], limit=with_both)[1] is None


def test_a_promise_that_a_fit_does_not_keep_is_none():
    fit = point(TRUE_RESIDUAL)
    of = trials(fit, [-PLAY, -TRIM, -GAIN, -OTHER_DIRECTION])
    limits = dict.fromkeys(PAIR_NAMES, MAX_GAIN)
    alone = fit_with_direction(fit, of[0])
    assert find_masking_pairs(fit, of, limits, MAX_STEP)
    assert find_masked_effect(fit, of, of, limits, {of[0].effect: alone},
                         lambda near, trial: alone, MAX_STEP) is None


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.slow_except("[0-4]")
def test_gains_of_two_are_those_of_bounded_least_squares(seed):
    rng = np.random.default_rng(seed)
    d = rng.normal(size=(8, 4))
    r = 2.0 * rng.normal(size=8)
    alone, both = pair_gains(d.T @ r, d.T @ d, 1.0)

    def exact(*some):
        return r @ r - 2.0 * lsq_linear(d[:, list(some)], -r, (0.0, 1.0)).cost

    for i in range(4):
        assert alone[i] == pytest.approx(exact(i), abs=1e-6)
        for j in range(i + 1, 4):
            assert both[i, j] == both[j, i]
            assert both[i, j] <= exact(i, j) + 1e-6
            assert both[i, j] >= max(alone[i], alone[j])
            within = lsq_linear(d[:, [i, j]], -r, (0.0, 1.0)).x
            if (within > 1e-3).all() and (within < 1.0 - 1e-3).all():
                assert both[i, j] == pytest.approx(exact(i, j), abs=1e-6)
