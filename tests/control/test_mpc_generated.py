"""Contouring control in C does what it does on numpy (extra ``mpc``)."""

from __future__ import annotations

import sys
from math import inf

import numpy as np
import pytest

from dart_hal.control.mpc import generated
from dart_hal.control.mpc.admm import Constraints, solve
from dart_hal.control.mpc.model import linearise, make_stage
from dart_hal.core.errors import UsageError
from studies.control.mpc_loop import Loop, P, controller
from tests.control.test_mpc import CORNERING, TRACK

TEST_STATES = np.array([CORNERING, (1.0, 2.0, -3.0, 0.4, 0.0, 0.1, 0.2, -0.4),
                        (0.0, 0.0, 2.0, 2.1, -0.1, -2.5, 0.35, -0.8),
                        (0.0, 0.0, 2.0, 2.1, -0.1, -2.5, 0.05, -0.8)])
INPUTS = np.array([(0.3, 0.2), (0.25, -0.5), (0.4, -0.9), (0.0, -0.9)])
pytest.importorskip("casadi", reason="casadi is absent: pip install 'dart-hal[mpc]'")


def programme(seed: int) -> tuple[np.ndarray, np.ndarray, Constraints]:
    """20 variables, 30 rows: held, passed at a price, and without an end to one side."""
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(20, 20))
    c = rng.normal(size=(30, 20))
    price = np.where(np.arange(30) < 10, inf, 0.5)
    low = np.where(np.arange(30) % 3 == 0, -inf, -0.4)
    return half @ half.T + np.eye(20), rng.normal(scale=9.0, size=20), Constraints(
        c, low, np.full(30, 0.3), price, np.full(30, 1.0))


@pytest.mark.slow
def test_stages_and_slopes_agree():
    """The differences of numpy err by their step of 1e-6 times the bend of the tyres."""
    for ours, theirs in zip(generated.compile_lineariser(P)(TEST_STATES, INPUTS),
                            linearise(make_stage(P), TEST_STATES, INPUTS), strict=True):
        assert ours == pytest.approx(theirs, abs=2e-3)
    after = generated.compile_lineariser(P)(TEST_STATES, INPUTS)[0]
    assert pytest.approx(np.array(make_stage(P)(*TEST_STATES.T, *INPUTS.T)), abs=1e-9) == after.T


@pytest.mark.parametrize("seed", range(3))
def test_the_splitting_agrees(seed):
    ours = solve(*programme(seed), 40, sweep=generated.compile_sweep())
    assert ours == pytest.approx(solve(*programme(seed), 40), abs=1e-9)


def test_the_splitting_finds_what_osqp_finds():
    """A soft row is a pair of slack variables there."""
    osqp = pytest.importorskip("osqp", reason="osqp is absent: pip install 'dart-hal[mpc]'")
    from scipy.sparse import csc_matrix

    h, g, rows = programme(1)
    n = 20
    m = 30
    soft = np.isfinite(rows.price)
    none = np.zeros((m, m))
    big = np.block([[h, np.zeros((n, 2 * m))], [np.zeros((2 * m, n + 2 * m))]])
    price = np.where(soft, rows.price, 0.0)
    a = np.block([[rows.c, np.eye(m), -np.eye(m)], [np.zeros((m, n)), np.eye(m), none],
                  [np.zeros((m, n)), none, np.eye(m)]])
    free = np.where(soft, inf, 0.0)
    solver = osqp.OSQP()
    solver.setup(csc_matrix(big), np.concatenate([g, price, price]), csc_matrix(a),
                 np.concatenate([rows.low, np.zeros(2 * m)]),
                 np.concatenate([rows.high, free, free]),
                 verbose=False, eps_abs=1e-8, eps_rel=1e-8, max_iter=100000)
    assert solve(h, g, rows, 2000) == pytest.approx(solver.solve().x[:n], abs=1e-5)


@pytest.mark.slow
def test_the_same_plans():
    loops = [Loop(controller(P, TRACK, 1.5, compiled=of_c)) for of_c in (False, True)]
    for _ in range(15):
        ours, theirs = (loop.step() for loop in loops)
    assert ours.inputs == pytest.approx(theirs.inputs, abs=1e-4)
    assert ours.states == pytest.approx(theirs.states, abs=1e-4)


def test_missing_casadi_is_reported(monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(UsageError, match="needs casadi") as caught:
        controller(P, TRACK, 1.0, compiled=True)
    assert "casadi>=" in str(caught.value)


def test_missing_a_compiler_is_reported(monkeypatch, tmp_path):
    monkeypatch.setenv("CC", "/nowhere/gcc")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(UsageError, match="needs a compiler"):
        controller(P, TRACK, 1.0, compiled=True)
