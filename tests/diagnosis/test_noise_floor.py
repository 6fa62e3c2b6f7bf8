"""The noise floor is the error of a faultless model, and a model far above it is not faultless."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_lab.diagnosis import conclude as conclusion
from dart_lab.diagnosis.error_summaries import Excess, find_excesses
from dart_lab.diagnosis.noise_floor import (
    estimate_noise_floor,
    floor_of_errors,
    possible_ages,
)
from dart_lab.diagnosis.report import page
from dart_lab.diagnosis.report.summary import headline
from dart_lab.identification.evaluation.prediction import CHANNELS
from dart_lab.identification.evidence.space import MessageTiming
from dart_lab.pages.diagnose_table import show_full
from studies.diagnosis.events import add_gusts
from tests.diagnosis import made_by_hand as made
from tests.diagnosis.searched import fitted_side

NOISE_WINDOWS = 400
NOISE_STD = np.array([0.03, 0.01, 0.1])


def rms(errors):
    return np.sqrt(np.mean(errors**2, axis=0))


def noise(seed):
    return NOISE_STD * np.random.default_rng(seed).normal(size=(NOISE_WINDOWS, 3))


def floor(errors, by_age=None, fault=0.0, method=0.0):
    nothing = np.zeros_like(errors)
    return floor_of_errors(errors, errors[None] if by_age is None else by_age, nothing + fault,
                           nothing + method)


def test_floor_of_normal_errors_is_their_rms():
    errors = noise(1)
    assert floor(errors) / rms(errors) == pytest.approx(1.0, abs=0.05)


def test_events_exceed_the_floor_and_hardly_raise_it():
    errors = noise(2)
    clean = floor(errors)
    errors[::10] *= 10.0
    assert floor(errors) / clean == pytest.approx(1.0, abs=0.15)
    assert np.all(rms(errors) > 2.0 * floor(errors))


def drawn_ages(seed):
    """Errors of which a third depends on an age between -0.05 and 0.05 s, and the same by age."""
    rng = np.random.default_rng(seed)
    slope = np.where(rng.random((NOISE_WINDOWS, 1)) < 0.3, rng.normal(size=(NOISE_WINDOWS, 1)),
                     0.0) * (
        100.0 * NOISE_STD)
    ages = np.linspace(-0.05, 0.05, 21)
    true = rng.uniform(-0.05, 0.05, size=(NOISE_WINDOWS, 1))
    errors = noise(seed + 1) + slope * true
    return errors, errors - slope * ages[:, None, None]


def test_floor_contains_what_unknown_ages_of_commands_do():
    errors, by_age = drawn_ages(3)
    assert floor(errors, by_age) / rms(errors) == pytest.approx(1.0, abs=0.1)


def test_floor_without_the_ages_is_too_low():
    """The negative control."""
    errors, _ = drawn_ages(3)
    assert np.all(floor(errors) < 0.8 * rms(errors))


def test_ages_that_commands_do_not_have_do_not_raise_the_floor():
    _, by_age = drawn_ages(5)
    errors = by_age[10] - np.median(by_age[10], axis=0)
    known = noise(6)
    assert np.all(floor(known, by_age - errors + known) < 1.15 * rms(known))


@pytest.mark.parametrize("share", [-0.5, 0.0, 0.5])
def test_floor_contains_the_error_of_the_evaluation(share):
    u = noise(7)
    method = share * u + noise(8)
    assert floor(u, method=method) / rms(u + method) == pytest.approx(1.0, abs=0.05)


def test_floor_excludes_what_the_driving_predicts():
    u = noise(9)
    fault = 5.0 * NOISE_STD * np.sin(np.arange(NOISE_WINDOWS) / 9.0)[:, None]
    assert floor(u + fault, fault=fault) / rms(u) == pytest.approx(1.0, abs=0.05)
    assert np.all(floor(u + fault) > 2.0 * rms(u))


@pytest.mark.parametrize(("stamped", "age", "ends"), [
    (True, 0.0, (-0.010, 0.010)), (False, 0.009, (0.0, 0.0)), (False, 0.04, (-0.05, 0.07))])
def test_possible_ages_are_those_that_the_log_allows(stamped, age, ends):
    ages = possible_ages(SimpleNamespace(commands_stamped=stamped), MessageTiming(command_age=age))
    assert (ages[0], ages[-1]) == pytest.approx(ends)
    assert np.all(np.diff(ages) < 0.0051)


def simulate_drive(hide=lambda car: None):
    """Floor and errors of the true model in 40 s of a car whose commands keep step with messages.
    """
    side, fit = fitted_side(hide, 40.0)
    logged = fit.timing.shift_delays(fit.vehicle)
    found = estimate_noise_floor(side, fit.vehicle, fit.timing, logged)
    return found, side.horizons(logged)


@pytest.mark.slow
def test_the_true_model_is_at_the_floor_and_gusts_lift_it_above():
    found, horizons = simulate_drive()
    rmse = horizons["1.0"]["pooled"]
    assert set(found) == set(CHANNELS)
    assert [found[c] / rmse[c] for c in CHANNELS] == pytest.approx([1.0] * 5, abs=0.15)
    assert find_excesses(horizons, found) == ()
    gusty, horizons = simulate_drive(lambda car: add_gusts(car, 2.0, seed=1))
    assert "vx" in [e.channel for e in find_excesses(horizons, gusty)]
    assert gusty["vx"] < 1.5 * found["vx"]


def test_few_windows_and_sensors_alone_have_no_floor():
    side = made.side()
    cases = side.prepared.cases
    few = replace(cases[0], windows=replace(cases[0].windows, start=cases[0].windows.start[:39]))
    short = replace(side, prepared=replace(side.prepared, cases=(few,)))
    for without in (short, replace(side, prepared=None)):
        assert estimate_noise_floor(without, PAPER, MessageTiming(), PAPER) == {}


NOISE_FLOOR = {"vx": 0.02, "vy": 0.01, "yaw_rate": 0.02, "position": 1.0, "yaw_deg": 9.0}
ABOVE = Excess("yaw_rate", 0.5, 0.1)


@pytest.mark.parametrize(("causes", "left", "expected"), [
    ((), (), "nothing_wrong"), ((), (ABOVE,), "unexplained"),
    ((made.diagnosis().causes[0],), (), "explained"),
    ((made.diagnosis().causes[0],), (ABOVE,), "partly_explained")])
def test_an_error_above_the_floor_is_not_explained(causes, left, expected):
    question = SimpleNamespace(refit=False)
    assert conclusion._verdict(question, None, causes, left, {}, (), ()) == expected


def test_terminal_and_page_state_the_floor_and_what_is_above_it(capsys):
    d = replace(made.diagnosis("unexplained", 0, False), noise_floor=NOISE_FLOOR, considered=())
    error = d.stages[-1].horizons["1.0"]["pooled"]["yaw_rate"]
    assert [e.channel for e in d.excesses if e.channel == "yaw_rate"] == ["yaw_rate"]
    assert d.to_json()["noise_floor"] == NOISE_FLOOR
    show_full(d)
    text = " ".join(capsys.readouterr().out.split())
    line = (f"yaw rate {error:.3g} rad/s after 1 s, {error / 0.02:.1f} times the noise floor of "
            "0.02 rad/s")
    assert f"above the noise floor: {line}" in text
    assert "floor: noise floor" in text
    assert "yaw rate [rad/s] 0.02 " in text
    assert line in page(d)
    assert "noise floor" in page(d)
    assert line in headline(d)


def test_a_diagnosis_without_a_floor_does_not_mention_one(capsys):
    """The control."""
    d = made.diagnosis("nothing_wrong", 0, False)
    show_full(d)
    assert "noise floor" not in capsys.readouterr().out
    assert d.excesses == ()
