"""How sure a name is, and whether its size is constant."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hidden_drive import Plan, write
from known_frame import read
from searched import drive

from dart_hal.diagnose import diagnose, judge
from dart_hal.diagnose.evidence.drive import prepare
from dart_hal.diagnose.evidence.noise import measure
from dart_hal.diagnose.evidence.residuals import Evidence
from dart_hal.diagnose.evidence.space import Space, Timing
from dart_hal.diagnose.grade import names
from dart_hal.diagnose.grade.bag import Problem, probability, sizes
from dart_hal.diagnose.grade.constancy import constancy
from dart_hal.diagnose.grade.names import impossible_size, shown, sure_ratio
from dart_hal.diagnose.grade.secants import secants
from dart_hal.diagnose.policy import USUAL
from dart_hal.diagnose.search.fit import refit
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.load import find_model

UNITS, ROWS, DRAWS = 16, 40, 400


def problem(rng, signal, beside=(), pull=1.0):
    """Units of rows with noise of size 1: residuals of a fit whose effect, of so much signal, is
    taken out at step -1; beside: directions that may follow, with a prior of size 1 / pull."""
    effect = rng.normal(size=(UNITS, ROWS))
    columns = [*(f(effect, rng) for f in beside), effect]
    z = np.stack(columns, axis=2) * np.array([1.0] * len(beside) + [signal])
    noise = rng.normal(size=(UNITS, ROWS))
    flat = z.reshape(-1, z.shape[2])
    noise -= (flat @ np.linalg.lstsq(flat, noise.ravel(), rcond=None)[0]).reshape(noise.shape)
    return Problem(np.einsum("uri,urj->uij", z, z), np.einsum("uri,ur->ui", z, noise),
                   np.array([pull] * len(beside) + [0.0]), np.zeros(z.shape[2]))


def test_what_is_there_is_sure_and_what_is_not_is_not():
    rng = np.random.default_rng(1)
    assert probability(problem(rng, 0.3), -1.0, DRAWS, 0) > 0.97
    faint = [probability(problem(rng, 0.02), -1.0, DRAWS, i) for i in range(20)]
    assert np.median(faint) < USUAL.grade.shown


def test_what_the_family_of_another_explains_is_no_second_cause():
    """The same direction but for a tenth: with the family beside it the name is not sure."""
    def alike(effect, rng):
        return effect + 0.1 * rng.normal(size=effect.shape)

    rng = np.random.default_rng(2)
    free, held = (probability(problem(rng, 0.3, [alike], pull), -1.0, DRAWS, 0)
                  for pull in (1e-3, 1e6))
    assert free < USUAL.grade.shown
    assert held > 0.95  # the control: without the family it is


def test_an_effect_that_bags_want_with_the_other_sign_is_not_wanted():
    p = problem(np.random.default_rng(3), 0.3)
    turned = Problem(p.normal, p.slope + 1.5 * p.normal[:, :, -1], p.pull, p.start)
    assert probability(turned, -1.0, DRAWS, 0) < 0.05


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """name -> secants of the fit with one effect, of a drive with another one hidden in it."""
    folder = tmp_path_factory.mktemp("grade")

    def fit(named, hidden, **values):
        plan = Plan(seconds=60.0)
        recording = read(write(folder / "hidden.csv", apply(PAPER, hidden, **values), 12, plan))
        evidence = Evidence([prepare(recording, PAPER.body.l_r)], PAPER.body.l_r)
        noise = measure(evidence.residuals(PAPER), evidence.blocks(2.0))
        space = Space(apply(PAPER, named), ())
        return secants(evidence, refit(evidence, noise, space, space.point(Timing())), [named],
                       USUAL)

    return fit


def test_a_constant_cause_is_constant_and_of_its_size(fitted):
    of = fitted("motor_gain", "motor_gain", k=0.08)
    assert constancy(of, "motor_gain", USUAL.grade, 0).constant
    ((size, error),) = sizes(of, "motor_gain")
    assert size == pytest.approx(1.0, abs=0.1)
    assert 0.0 < error < 0.1


@pytest.mark.more
def test_a_battery_that_runs_down_is_no_constant_gain(fitted):
    found = constancy(fitted("motor_gain", "battery_fade", k=-0.3), "motor_gain", USUAL.grade, 0)
    assert not found.constant
    places = [size for _, size, _ in found.curve]
    assert max(places) - min(places) > 0.5


@pytest.mark.more
def test_what_does_nothing_has_no_size_that_changes(fitted):
    of = fitted("motor_gain", "motor_gain", k=0.1)
    still = replace(of, tangent={"motor_gain": np.zeros_like(of.tangent["motor_gain"])})
    assert constancy(still, "motor_gain", USUAL.grade, 0).constant
    assert constancy(still, "motor_gain", USUAL.grade, 0).curve == ()


def test_a_name_comes_back_that_left_before_what_hid_it(monkeypatch):
    """c hides a and b from each other and leaves last; the same without d, which is never sure."""
    sure = {"abcd": (0.7, 0.6, 0.75, 0.1), "abc": (0.7, 0.6, 0.75), "ac": (0.65, 0.75),
            "c": (0.7,), "a": (0.99,), "ab": (0.95, 0.9)}
    monkeypatch.setattr(names, "secants", lambda evidence, fit, kept, policy: "".join(kept))
    monkeypatch.setattr(names, "grades", lambda of, kept, *rest: dict(
        zip(kept, sure.get(of, (0.5,) * len(of)), strict=True)))
    monkeypatch.setattr(names, "sizes", lambda *given: ())
    monkeypatch.setattr(names, "constancy", lambda *given: None)
    search = SimpleNamespace(fit=lambda at, noise, kept, near: "".join(kept),
                             steps=lambda base, at, noise, kept: (base, *kept))
    found = shown(grading(search, (1.5, 1.4, 1.6)), ("", *"abcd"), "", None, "abcd")
    assert found.names == ("a", "b")
    assert [found.grades[n].probability for n in "ab"] == [0.95, 0.9]
    assert {n: one.probability for n, one in found.left_out.items()} == {"c": 0.7, "d": 0.1}


@pytest.mark.parametrize(("beside_b", "found_then"), [(1.01, "bc"), (0.98, "c")])
def test_an_unsure_name_comes_back_after_one_that_does_not_stand_elsewhere(
        beside_b, found_then, monkeypatch):
    """a hides b, and goes on the test recordings; if c did not stand beside b, b stays away."""
    sure = {"abc": (0.9, 0.6, 0.9), "ac": (0.9, 0.9), "c": (0.9,), "bc": (0.95, 0.9), "b": (0.95,)}
    monkeypatch.setattr(names, "secants", lambda evidence, fit, kept, policy: "".join(kept))
    monkeypatch.setattr(names, "grades", lambda of, kept, *rest: dict(
        zip(kept, sure.get(of, ()), strict=True)))
    for name in ("sizes", "constancy"):
        monkeypatch.setattr(names, name, lambda *given: ())
    search = SimpleNamespace(fit=lambda at, noise, kept, near: "".join(kept),
                             steps=lambda base, at, noise, kept: (base, *kept))

    def cost(name, kept):
        low = {"a": 0.98, "b": 1.01, "c": beside_b if "b" in kept else 1.01}[name]
        return low + 0.01, low, low + 0.02

    with_ = replace(grading(search, None),
                    costs=lambda fit, without: {n: cost(n, without) for n in without})
    found = shown(with_, ("", *"abc"), "", None, "abc")
    assert "".join(found.names) == found_then
    assert set(found.left_out) == set("abc") - set(found_then)
    assert all(one.why.startswith(names.NO_GAIN) for one in found.left_out.values())


@pytest.mark.parametrize(("low", "left"), [(1.001, set()), (1.0, {"a"}), (0.999, {"a"})])
def test_interval_of_the_test_ratio_that_includes_1_makes_a_name_possible(low, left, monkeypatch):
    """Also one of [1.00, 1.00]: predictions that are the same are no evidence."""
    monkeypatch.setattr(names, "secants", lambda *given: None)
    monkeypatch.setattr(names, "grades", lambda of, kept, *rest: dict.fromkeys(kept, 1.0))
    monkeypatch.setattr(names, "sizes", lambda *given: ())
    monkeypatch.setattr(names, "constancy", lambda *given: None)
    search = SimpleNamespace(fit=lambda at, noise, kept, near: "")
    for points in (("", "a"), ("", "a", "a, fitted again")):
        assert set(shown(grading(search, (low, low, 1.01)), points, "", None, "a").left_out) == left


def grading(search, cost, impossible=lambda fit, name: ""):
    return names.Grading(search, None, USUAL, 0,
                         lambda fit, without: dict.fromkeys(without, cost),
                         lambda kept, points: [None for _ in kept], impossible)


def test_cause_is_compared_with_the_fit_of_all_others(monkeypatch):
    """b is small beside a, and clear once a is in the fit: each ratio leaves out one name alone."""
    monkeypatch.setattr(names, "secants", lambda evidence, fit, kept, policy: "".join(kept))
    monkeypatch.setattr(names, "grades", lambda of, kept, *rest: dict.fromkeys(kept, 1.0))
    for name in ("sizes", "constancy"):
        monkeypatch.setattr(names, name, lambda *given: ())
    search = SimpleNamespace(fit=lambda at, noise, kept, near: "".join(kept),
                             steps=lambda base, at, noise, kept: (base, *kept))
    errors = {"": 10.0, "a": 3.0, "b": 9.9, "ab": 1.0}

    def costs(fit, without):
        ratios = {n: errors[other] / errors[fit] for n, other in without.items()}
        return {n: (ratio, ratio - 0.1, ratio + 0.1) for n, ratio in ratios.items()}

    with_ = replace(grading(search, None), costs=costs)
    found = shown(with_, ("", "b", "ab"), "", None, "ba")
    assert found.names == ("b", "a")
    assert found.judged["b"].cost[0] == 3.0
    errors["a"] = 1.0  # the control: with a alone nothing is missed
    found = shown(with_, ("", "b", "ab"), "", None, "ba")
    assert found.names == ("a",)
    assert found.judged["a"].cost[0] == 10.0


@pytest.mark.parametrize("why", ["", "k = 1.5 is on the end of the interval"])
def test_impossible_size_makes_a_name_possible_however_sure_it_is(why, monkeypatch):
    monkeypatch.setattr(names, "secants", lambda *given: None)
    monkeypatch.setattr(names, "grades", lambda of, kept, *rest: dict.fromkeys(kept, 1.0))
    monkeypatch.setattr(names, "sizes", lambda *given: ())
    monkeypatch.setattr(names, "constancy", lambda *given: None)
    search = SimpleNamespace(fit=lambda at, noise, kept, near: "".join(kept),
                             steps=lambda base, at, noise, kept: (base, *kept))
    with_ = grading(search, (1.2, 1.1, 1.3), lambda fit, name: why if name == "b" else "")
    found = shown(with_, ("", *"ab"), "", None, "ab")
    assert found.names == (("a",) if why else ("a", "b"))
    assert {n: one.why for n, one in found.left_out.items()} == ({"b": why} if why else {})


def test_size_of_a_fit_is_judged_by_the_catalogue():
    fit = SimpleNamespace(vehicle=apply(apply(PAPER, "encoder_axle", k=1.2), "gyro_scale", k=0.02))
    assert "outside its physical range 0 to 1 share" in impossible_size(fit, "encoder_axle")
    assert impossible_size(fit, "gyro_scale") == ""


def test_a_name_that_lowers_no_error_elsewhere_is_left_out():
    """By its interval where there are stretches enough for one; else by what it costs."""
    harms, unsure, helps = (0.98, 0.97, 0.99), (1.02, 0.99, 1.05), (1.2, 1.1, 1.3)
    assert sure_ratio(harms) < 1.0
    assert sure_ratio(unsure) < 1.0
    assert sure_ratio(helps) > 1.0
    assert sure_ratio((1.2, np.nan, np.nan)) > 1.0  # too few stretches for an interval
    assert "1.020 [0.990, 1.050] times as large" in names.no_gain(unsure)


@pytest.mark.more
@pytest.mark.cpu(30)
@pytest.mark.parametrize("asked", [True, False])
def test_where_it_makes_errors_larger_a_name_is_only_possible(asked, monkeypatch, tmp_path):
    """The same drives with the cost turned about: the negative control is the name itself."""
    if not asked:
        real = judge.ratio
        monkeypatch.setattr(judge, "ratio", lambda with_, without: real(without, with_))
    train, test = (drive(("gyro_scale", 0.05), seconds=30.0, seed=s) for s in (3, 4))
    file, p = find_model("paper")
    found = diagnose(file, p, [train], [test], refit=False, only=("gyro_scale", "gyro_bias"))
    assert [c.effect for c in found.causes] == ["gyro_scale"] * asked
    assert [c.effect for c in found.possible] == ["gyro_scale"] * (not asked)
    assert asked or "no fit has seen" in found.possible[0].why
    assert not {a.name for a in found.extended.effects} or asked
