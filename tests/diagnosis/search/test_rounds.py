"""What one round passes to the next: the same answer, from fewer rollouts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_lab.diagnosis.parameters.sets import MAX_LINEAR_RISE, GroupFits, _subsets
from dart_lab.diagnosis.policy import USUAL
from dart_lab.diagnosis.search import scan as scanning
from dart_lab.diagnosis.search.scan import scan
from dart_lab.identification.objective import change_noise, evaluate_point
from tests.diagnosis.searched import ALL_FREE, drive, evidence, fit_start

SEARCHED_EFFECTS = ("grip", "quadratic_drag", "motor_gain", "steering_gain", "gyro_scale",
                    "steering_lag",
                    "mass", "road_slope_x")


@pytest.fixture(scope="module")
def evidence_of_drive():
    return evidence(drive(("steering_lag", 0.06), seconds=24.0))


@pytest.fixture(scope="module")
def point(evidence_of_drive):
    return fit_start(evidence_of_drive)[1]


@pytest.fixture
def rollouts(monkeypatch):
    """Names of what is rolled out."""
    out = []
    best = scanning.EffectScan.best_trial
    monkeypatch.setattr(scanning.EffectScan, "best_trial", lambda self, name, *known: (
        out.append(name), best(self, name, *known))[1])
    return out


def finer(again, first):
    """One more parabola through the best sizes may gain a little more, and loses nothing."""
    return first - 1e-3 < again < 1.05 * first


@pytest.mark.slow
def test_what_promised_nothing_is_not_rolled_out_again(evidence_of_drive, point, rollouts):
    first = scan(evidence_of_drive, point, SEARCHED_EFFECTS)
    assert sorted(rollouts) == sorted(SEARCHED_EFFECTS)
    rollouts.clear()
    lines = {t.effect: t.sweeps for t in first}
    again = scan(evidence_of_drive, point, SEARCHED_EFFECTS, previous=lines)
    gains = {t.effect: t.gain for t in first}
    assert again[0].effect == "steering_lag"
    assert finer(again[0].gain, gains["steering_lag"])
    without_gain = {n for n, g in gains.items() if g < USUAL.scan.min_predicted_loss}
    assert without_gain
    assert len(rollouts) < len(SEARCHED_EFFECTS)
    for trial in again:  # what is screened out hides nothing
        assert abs(trial.gain - gains[trial.effect]) < 1.0 or finer(trial.gain, gains[trial.effect])


@pytest.mark.slow
def test_a_cause_that_another_hid_is_rolled_out_again(rollouts):
    """In a round before, all that is left of it was nothing; with the other gone it is there."""
    both = evidence(drive(("steering_lag", 0.06), ("gyro_scale", 0.05), seconds=24.0))
    before = fit_start(both)[1]
    first = scan(both, before, SEARCHED_EFFECTS)
    nothing = {t.effect: t.sweeps for t in first}
    rollouts.clear()
    found = scan(both, before, SEARCHED_EFFECTS, previous=nothing)
    assert {"steering_lag", "gyro_scale"} <= set(rollouts)
    assert {t.effect for t in found[:2]} == {"steering_lag", "gyro_scale"}


@pytest.mark.slow
def test_a_best_size_that_was_tried_before_needs_no_ladder(evidence_of_drive, point, monkeypatch):
    """No less gain at about that size, from few rollouts; from lines that lie, by the ladder."""
    tried = []
    residuals = type(evidence_of_drive).residuals
    monkeypatch.setattr(type(evidence_of_drive), "residuals", lambda self, p, *at: (tried.append(p),
                                                                      residuals(self, p, *at))[1])
    first, = scan(evidence_of_drive, point, ["steering_lag"])
    ladder = len(tried)
    lines = {"steering_lag": first.sweeps}
    tried.clear()
    again, = scan(evidence_of_drive, point, ["steering_lag"], previous=lines)
    assert 0 < len(tried) < ladder
    assert finer(again.gain, first.gain)
    assert again.values["k"] == pytest.approx(first.values["k"], rel=0.2)
    plain = evidence_of_drive.residuals(point.vehicle, point.timing)
    all_of_it = np.nan_to_num(-0.9 * np.concatenate(
        [plain.motion.ravel(), plain.sensors.ravel()])).astype(np.float32)
    lying = tuple(replace(line, changes={**line.changes, sorted(line.changes)[1]: all_of_it})
                  for line in first.sweeps)
    tried.clear()
    found, = scan(evidence_of_drive, point, ["steering_lag"], previous={"steering_lag": lying})
    rungs, _ = scanning.ladder(first.sweeps[0].parameter)
    assert rungs[0] in [a.values[0] for p in tried for a in p.effects]
    assert found.gain == pytest.approx(first.gain, rel=1e-9)


@pytest.mark.slow
def test_a_residual_at_its_limit_hides_nothing_from_the_next_round(evidence_of_drive, point):
    """A large cause brings residuals to their limit; what the others do is known all the same."""
    quiet = replace(point.noise, motion=1e3 * point.noise.motion)
    limited = evaluate_point(evidence_of_drive, quiet, point.space, point.x)
    assert (np.abs(limited.residual) == quiet.policy.max_residual).mean() > 0.2
    lines = {t.effect: t.sweeps for t in scan(evidence_of_drive, limited, SEARCHED_EFFECTS)}
    again, fresh = (scan(evidence_of_drive, point, SEARCHED_EFFECTS, previous=known)[0]
                    for known in (lines,
                                                                                                      {}))
    assert again.effect == fresh.effect == "steering_lag"
    assert again.gain == pytest.approx(fresh.gain, rel=0.01)


@pytest.mark.slow
def test_slopes_weighted_by_another_noise_are_those_it_whitens_itself(evidence_of_drive, point):
    other, _ = fit_start(evidence_of_drive, noise=None)
    other_noise = fit_start(evidence_of_drive, p=PAPER, free=("motor.d",))[0]
    here = evaluate_point(evidence_of_drive, point.noise, point.space, point.x)
    for noise in (other, other_noise):
        carried = change_noise(evidence_of_drive, noise, here).jacobian
        own = evaluate_point(evidence_of_drive, noise, point.space, point.x).jacobian
        size = np.abs(own).max(axis=0)
        assert np.abs(carried - own).max(axis=0) == pytest.approx(0.0, abs=0.01 * size.max())


@pytest.mark.slow
def test_a_set_near_the_last_fit_has_the_losses_of_its_own_fit(evidence_of_drive):
    """Without rollouts; further off it is fitted, and there a first order would be wrong."""
    full = fit_start(evidence_of_drive, free=ALL_FREE)[1]
    unit = np.arange(len(full.residual)) % 16
    sets = GroupFits(evidence_of_drive, PAPER, full, unit, {}, USUAL)
    near = [s for s in _subsets(sets.all_groups) if sets.rise(s) < MAX_LINEAR_RISE]
    assert len(near) > 3
    quick = {s: sets.losses(s).sum() - sets.losses(sets.all_groups).sum() for s in near}
    assert not sets._fits
    for s in sorted(near, key=len)[:4]:
        assert quick[s] == pytest.approx(sets.fit(s).loss() - sets.fit(sets.all_groups).loss(),
                                         abs=0.5 + 0.15 * quick[s])
