"""The probability of a cause, and whether its size is constant."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.grade import accept
from dart_lab.diagnosis.grade.accept import accept_effects, impossible_size
from dart_lab.diagnosis.grade.bag import BootstrapProblem, estimate_sizes_by_recording, probability
from dart_lab.diagnosis.grade.constancy import assess_constancy
from dart_lab.diagnosis.grade.secants import secants
from dart_lab.diagnosis.policy import USUAL
from dart_lab.identification.evidence.drive import prepare_drive
from dart_lab.identification.evidence.noise import estimate_noise
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.evidence.space import MessageTiming, Space
from dart_lab.identification.objective import refit
from dart_lab.report.numbers import describe_change
from studies.diagnosis.hidden_drive import Plan, write
from studies.diagnosis.known_frame import read
from tests.diagnosis.searched import drive

UNITS = 16
BLOCK_ROWS = 40
BOOTSTRAP_DRAWS = 400


def problem(rng, signal, others=(), pull=1.0):
    """Units of rows with noise of size 1: residuals of a fit whose effect, of so much signal, is
    taken out at step -1; others: directions that may follow, with a prior of size 1 / pull."""
    effect = rng.normal(size=(UNITS, BLOCK_ROWS))
    columns = [*(f(effect, rng) for f in others), effect]
    z = np.stack(columns, axis=2) * np.array([1.0] * len(others) + [signal])
    noise = rng.normal(size=(UNITS, BLOCK_ROWS))
    flat = z.reshape(-1, z.shape[2])
    noise -= (flat @ np.linalg.lstsq(flat, noise.ravel(), rcond=None)[0]).reshape(noise.shape)
    return BootstrapProblem(np.einsum("uri,urj->uij", z, z), np.einsum("uri,ur->ui", z, noise),
                   np.diag([pull] * len(others) + [0.0]), np.zeros(z.shape[2]))


def test_what_is_there_is_certain_and_what_is_not_is_not():
    rng = np.random.default_rng(1)
    assert probability(problem(rng, 0.3), -1.0, BOOTSTRAP_DRAWS, 0) > 0.97
    weak = [probability(problem(rng, 0.02), -1.0, BOOTSTRAP_DRAWS, i) for i in range(20)]
    assert np.median(weak) < USUAL.grade.likely_probability


def test_what_the_family_of_another_explains_is_no_second_cause():
    """The same direction but for a tenth: with its family the cause is not certain."""
    def same_signal(effect, rng):
        return effect + 0.1 * rng.normal(size=effect.shape)

    rng = np.random.default_rng(2)
    free, held = (probability(problem(rng, 0.3, [same_signal], pull), -1.0, BOOTSTRAP_DRAWS, 0)
                  for pull in (1e-3, 1e6))
    assert free < USUAL.grade.likely_probability
    assert held > 0.95  # the control: without the family it is


def test_an_effect_with_another_sign_in_the_bootstrap_is_rejected():
    p = problem(np.random.default_rng(3), 0.3)
    turned = replace(p, slope=p.slope + 1.5 * p.normal[:, :, -1])
    assert probability(turned, -1.0, BOOTSTRAP_DRAWS, 0) < 0.05


@pytest.fixture(scope="module")
def secants_of_fits(tmp_path_factory):
    """name -> secants of the fit with one effect, of a drive with another one hidden in it."""
    folder = tmp_path_factory.mktemp("grade")

    def fit(named, hidden, **values):
        plan = Plan(seconds=60.0)
        recording = read(write(folder / "hidden.csv", apply(PAPER, hidden, **values), 12, plan))
        evidence = Evidence([prepare_drive(recording, PAPER.body.l_r)], PAPER.body.l_r)
        noise = estimate_noise(evidence.residuals(PAPER), evidence.blocks())
        space = Space(apply(PAPER, named), ())
        fit = refit(evidence, noise, space, space.point(MessageTiming()))
        return secants(evidence, fit, [named])

    return fit


def test_a_constant_cause_is_constant_and_of_its_size(secants_of_fits):
    of = secants_of_fits("motor_gain", "motor_gain", k=0.08)
    assert assess_constancy(of, "motor_gain", USUAL.grade, 0).constant
    ((size, error),) = estimate_sizes_by_recording(of, "motor_gain")
    assert size == pytest.approx(1.0, abs=0.1)
    assert 0.0 < error < 0.1


@pytest.mark.slow
def test_a_battery_that_runs_down_is_no_constant_gain(secants_of_fits):
    fit = secants_of_fits("motor_gain", "battery_fade", k=-0.3)
    found = assess_constancy(fit, "motor_gain", USUAL.grade, 0)
    assert not found.constant
    assert "time" in (found.along, *found.others)
    assert len({found.along, *found.others}) == 1 + len(found.others) <= 3
    places = [size for _, size, _ in found.curve]
    assert max(places) - min(places) > 0.5


@pytest.mark.slow
def test_what_does_nothing_has_no_size_that_changes(secants_of_fits):
    of = secants_of_fits("motor_gain", "motor_gain", k=0.1)
    still = replace(of, tangent={"motor_gain": np.zeros_like(of.tangent["motor_gain"])})
    assert assess_constancy(still, "motor_gain", USUAL.grade, 0).constant
    assert assess_constancy(still, "motor_gain", USUAL.grade, 0).curve == ()


@pytest.fixture
def letters(monkeypatch):
    """Accept effects that are letters, by made probabilities of each set of them."""
    monkeypatch.setattr(accept, "secants", lambda evidence, fit, kept, stated: "".join(kept))
    monkeypatch.setattr(accept, "estimate_sizes_by_recording", lambda *given: ())
    monkeypatch.setattr(accept, "assess_constancy", lambda *given: None)
    search = SimpleNamespace(fit_subset=lambda at, noise, kept, near: "".join(kept),
                             fit_nested=lambda base, at, noise, kept: (base, *kept),
                             linearise_stated=lambda evidence, fit: None)

    def run(probabilities, names, impossible=lambda fit, name: "", ratios=lambda fit, name: 1.1,
            low=0.9):
        monkeypatch.setattr(accept, "grade_effects", lambda of, kept, *rest: dict(
            zip(kept, probabilities.get(of, (0.5,) * len(of)), strict=True)))
        how = accept.Acceptance(search, None, USUAL, 0, impossible, lambda fit, without: {
            n: (ratios(fit, n), low, 1.3) for n in without})
        return accept_effects(how, ("", *names), "", None, names)

    return run


def test_effect_comes_back_that_was_dropped_before_what_hid_it(letters):
    """c hides a and b from each other and is dropped last; the same without d, never probable."""
    found = letters({"abcd": (0.7, 0.6, 0.75, 0.1), "abc": (0.7, 0.6, 0.75), "ac": (0.65, 0.75),
                     "c": (0.7,), "a": (0.99,), "ab": (0.99, 0.98)}, "abcd")
    assert found.names == ("a", "b")
    assert [found.grades[n].probability for n in "ab"] == [0.99, 0.98]
    assert {n: one.probability for n, one in found.rejected.items()} == {"c": 0.7, "d": 0.1}
    assert set(found.costs) == set("ab")


@pytest.mark.parametrize(("ratio", "accepted"), [(1.001, "ab"), (1.0, "b"), (0.999, "b")])
def test_effect_that_lowers_no_error_of_the_test_recordings_is_vetoed(ratio, accepted, letters):
    """Its interval may include 1, for a small effect lowers errors little; predictions that are
    the same are no evidence."""
    found = letters({"ab": (0.99, 0.99), "b": (0.98,)}, "ab",
                    ratios=lambda fit, name: ratio if name == "a" else 1.1)
    assert "".join(found.names) == accepted
    for one in found.rejected.values():
        assert f"without it the test errors are {describe_change(ratio, 0.9, 1.3)}" in one.why


def test_effect_does_not_come_back_against_a_veto(letters):
    """a was improbable with c; without c it is probable, and missed or not."""
    probabilities = {"abc": (0.7, 0.9, 0.75), "bc": (0.9, 0.6), "b": (0.99,), "ab": (0.98, 0.98)}
    for ratio, names in ((1.1, ("a", "b")), (0.9, ("b",))):
        found = letters(probabilities, "abc", ratios=lambda fit, n, r=ratio: r if n == "a" else 1.1)
        assert found.names == names


@pytest.mark.slow
def test_test_recordings_only_veto():
    """In one the effect is not there at all, so errors are larger with it."""
    train, same, without = (drive(*hidden, seconds=30.0, seed=s) for s, hidden in (
        (3, [("gyro_scale", 0.05)]), (4, [("gyro_scale", 0.05)]), (4, [])))
    file, p = find_model("paper")
    found, other = (diagnose(file, p, [train], [test], refit=False,
                             only=("gyro_scale", "gyro_bias")) for test in (same, without))
    assert [c.effect for c in found.causes] == ["gyro_scale"]
    assert found.causes[0].cost[0] > 1.0
    assert not other.causes
    one, = other.possible
    assert one.effect == "gyro_scale"
    assert one.grade == "likely"
    assert "the test recordings do not confirm it" in one.why


@pytest.mark.parametrize(("probability", "low", "accepted"), [
    (0.97, 0.9, True), (0.96, 0.9, False), (0.96, 1.01, True), (0.79, 1.01, False)])
def test_likely_effect_needs_the_interval_of_the_test_recordings(probability, low, accepted,
                                                                 letters):
    found = letters({"a": (probability,)}, "a", low=low)
    assert found.names == (("a",) if accepted else ())
    assert accepted or found.rejected["a"].probability == probability


@pytest.mark.parametrize("why", ["", "k = 1.5 is on the end of the interval"])
def test_impossible_size_rejects_an_effect_however_probable_it_is(why, letters):
    found = letters({"ab": (1.0, 1.0), "a": (1.0,)}, "ab",
                    lambda fit, name: why if name == "b" else "")
    assert found.names == (("a",) if why else ("a", "b"))
    assert {n: one.why for n, one in found.rejected.items()} == ({"b": why} if why else {})


def test_size_of_a_fit_is_judged_by_the_catalogue():
    fit = SimpleNamespace(vehicle=apply(apply(PAPER, "encoder_axle", k=1.2), "gyro_scale", k=0.02))
    assert "outside its physical range 0 to 1 share" in impossible_size(fit, "encoder_axle")
    assert impossible_size(fit, "gyro_scale") == ""
