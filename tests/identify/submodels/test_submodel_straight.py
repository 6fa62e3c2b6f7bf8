"""Friction and motor: the truth lies within the stated errors, and what would be wrong is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.identify.fit import Estimate
from dart_hal.identify.submodels import fit_submodels
from dart_hal.identify.submodels.guess import first_guess
from dart_hal.identify.submodels.report import Ledger
from dart_hal.identify.submodels.speeds import speeds_of
from dart_hal.identify.submodels.straight import NAMES, solve_straight
from dart_hal.identify.submodels.stretches import cut
from dart_hal.vehicle import PAPER

LEVELS = (0.2, 0.22, 0.24, 0.27, 0.29, 0.32, 0.36, 0.4)
TRUTH = {**{n: getattr(PAPER.friction, n) for n in "abc"},
         **{n: getattr(PAPER.motor, n) for n in "deg"}}
SEEDS = 5


@pytest.fixture(scope="module")
def sets(workshop, steps, lively):
    """Eight recordings of throttle steps per seed; all seeds simulated side by side."""
    rng = np.random.default_rng(1)
    throttle = np.concatenate([steps(LEVELS, rng) for _ in range(SEEDS)])
    driven = workshop.drive(lively, throttle, np.zeros_like(throttle), rng)
    m = len(LEVELS)
    return [workshop.recordings(driven, seed, lanes=range(seed * m, (seed + 1) * m))
            for seed in range(SEEDS)]


@pytest.fixture(scope="module")
def fits(sets):
    return [fit_submodels(recordings, ("friction", "motor"))[0] for recordings in sets]


def scores(values, errors):
    return np.array([(values[n] - TRUTH[n]) / errors[n] for n in TRUTH])


def prepared(recordings):
    series = [speeds_of(r, None, Ledger()) for r in recordings]
    return series, cut(series), first_guess(series, PAPER, PAPER.body.mass)


def test_the_truth_lies_within_the_stated_intervals(fits):
    z = []
    for fit in fits:
        both = {**fit["friction"].parameters, **fit["motor"].parameters}
        z.append(scores({n: e.value for n, e in both.items()}, {n: e.std for n, e in both.items()}))
    assert np.mean(np.abs(z) < 1.645) >= 0.75
    assert np.sqrt(np.mean(np.square(z))) < 1.5
    assert all(f.converged for fit in fits for f in fit.values())


def test_the_values_are_worth_having(fits):
    for name, share in (("a", 0.15), ("d", 0.12), ("e", 0.25), ("g", 0.08)):
        got = [(f["friction"].parameters | f["motor"].parameters)[name].value for f in fits]
        assert np.std(got) < share * abs(TRUTH[name])


def test_samples_taken_as_independent_would_promise_too_much(sets, fits):
    ratio = []
    for recordings, fit in zip(sets[:1], fits, strict=False):
        series, s, x0 = prepared(recordings)
        naive = replace(s, block=np.arange(len(s.v)))
        alone = solve_straight(series, naive, PAPER, x0, NAMES, PAPER.body.mass)
        ratio += [fit["motor"].parameters[n].std / alone.std(n) for n in "de"]
    assert np.mean(ratio) > 1.5


def test_without_its_delay_the_motor_is_biased(workshop, lively):
    """Throttle that changes every half second: 0.19 s of delay and lag turn into less motor."""
    rng = np.random.default_rng(4)
    throttle = np.repeat(rng.choice([0.18, 0.24, 0.3, 0.36], (4, 40)), 50, axis=1)
    throttle[:, -300:] = 0.0
    car = replace(lively, delay=replace(lively.delay, throttle_s=0.14))
    series, s, x0 = prepared(workshop.recordings(
        workshop.drive(car, throttle, 0.0 * throttle, rng), 40, name="fast"))
    right = solve_straight(series, s, PAPER, x0, NAMES, PAPER.body.mass)
    x0[6:] = 0.0
    wrong = solve_straight(series, s, PAPER, x0, NAMES[:6], PAPER.body.mass)
    assert abs(wrong.value("d") - TRUTH["d"]) > 2.0 * abs(right.value("d") - TRUTH["d"])
    assert abs(wrong.value("d") / TRUTH["d"] - 1.0) > 0.1
    assert wrong.rmse > 1.2 * right.rmse
    total = right.value("throttle_s") + right.value("throttle_lag_s")
    assert total == pytest.approx(0.19, abs=0.03)


def test_the_error_of_the_mass_is_in_every_force(sets, fits):
    plain = fits[0]
    vague = fit_submodels(sets[0], ("friction", "motor"),
                          mass=Estimate(PAPER.body.mass, 0.2, "kg"))[0]
    for name in ("d", "e"):
        share = vague["motor"].parameters[name]
        own = plain["motor"].parameters[name].std
        assert share.std == pytest.approx(np.hypot(own, share.value * 0.2 / 1.67), rel=0.02)
    assert vague["motor"].parameters["g"].std == pytest.approx(plain["motor"].parameters["g"].std)


def test_twice_the_mass_is_twice_the_forces(sets, fits):
    twice = fit_submodels(sets[0], ("motor",), mass=Estimate(3.34, 0.0, "kg"))[0]["motor"]
    once = fits[0]["motor"]
    assert twice.values()["d"] == pytest.approx(2.0 * once.values()["d"], rel=0.02)
    assert twice.values()["g"] == pytest.approx(once.values()["g"], abs=0.002)


def test_one_throttle_level_tells_no_dead_band(workshop, steps, lively):
    rng = np.random.default_rng(5)
    throttle = steps([0.3] * 4, rng)
    recordings = workshop.recordings(
        workshop.drive(lively, throttle, 0.0 * throttle, rng), 50, name="one")
    motor = fit_submodels(recordings, ("motor",))[0]["motor"]
    assert not motor.parameters["g"].identifiable
    assert np.isinf(motor.parameters["g"].std)
    assert motor.parameters["g"].value == PAPER.motor.g
    assert any("cannot be told" in note for note in motor.notes)


def test_without_coasting_the_friction_is_not_told(workshop, steps, lively):
    rng = np.random.default_rng(6)
    throttle = np.repeat([[0.22], [0.25], [0.3], [0.35]], 700, axis=1)
    recordings = workshop.recordings(
        workshop.drive(lively, throttle, 0.0 * throttle, rng), 60, name="driven")
    fits = fit_submodels(recordings, ("friction", "motor"))[0]
    assert not any(e.identifiable for e in fits["friction"].parameters.values())
    assert not fits["friction"].converged
    assert fits["friction"].n == 0
    assert any("friction held" in note for note in fits["motor"].notes)


def test_friction_alone_needs_only_the_coasting(sets):
    friction = fit_submodels(sets[0], ("friction",))[0]["friction"]
    for name in "ac":
        entry = friction.parameters[name]
        assert abs(entry.value - TRUTH[name]) < 3.5 * entry.std
    assert "0 driven" in friction.notes[0]


def test_mocap_and_encoder_see_the_same_car(workshop, steps, lively):
    rng = np.random.default_rng(8)
    throttle = steps(LEVELS, rng)
    driven = workshop.drive(lively, throttle, 0.0 * throttle, rng)
    encoder = fit_submodels(workshop.recordings(driven, 70, "A"), ("motor",))[0]["motor"]
    mocap = fit_submodels(workshop.recordings(driven, 70, "B"), ("motor",))[0]["motor"]
    for name in "deg":
        a, b = encoder.parameters[name], mocap.parameters[name]
        assert abs(a.value - b.value) < 3.0 * np.hypot(a.std, b.std)
    assert mocap.rmse < encoder.rmse  # no counting noise
