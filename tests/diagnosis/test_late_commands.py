"""A change of a command that acts after the next message was lost, and no log explains it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import mkdtemp
from types import SimpleNamespace

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_lab.diagnosis import conclude as conclusion
from dart_lab.diagnosis.error_summaries import ErrorMoment, LateCommands
from dart_lab.diagnosis.gains import make_recording_set
from dart_lab.diagnosis.late_commands import MIN_GAIN, compare_ages, find_late_commands
from dart_lab.diagnosis.report import page
from dart_lab.diagnosis.report.summary import headline
from dart_lab.diagnosis.run import make_evidence
from dart_lab.diagnosis.search.forward import ForwardSearch
from dart_lab.diagnosis.search.selection import Settings
from dart_lab.identification.evidence.space import MessageTiming
from dart_lab.identification.shooting.fit import FREE, free_names
from dart_lab.pages.diagnose_table import show_full
from studies.diagnosis.events import add_gusts, lose_commands
from studies.diagnosis.known_frame import read
from studies.diagnosis.stranger import Car
from studies.diagnosis.stranger_files import COMMANDS, Habits, record
from tests.diagnosis import made_by_hand as made
from tests.diagnosis.searched import fitted_side

AGES = np.linspace(-0.11, 0.11, 45)
ERROR_WINDOWS = 300


def draw_errors(true_ages, seed=1):
    """Errors (k, n, 2) by age of windows of which half see a step at these ages [s]."""
    rng = np.random.default_rng(seed)
    slope = 200.0 * (rng.random(ERROR_WINDOWS) < 0.5) * rng.normal(size=ERROR_WINDOWS)
    noise = rng.normal(size=(ERROR_WINDOWS, 2))
    moved = slope * (true_ages - AGES[:, None])
    return noise + np.stack([moved, 0.5 * moved], axis=2), slope


@pytest.mark.slow
def test_commands_within_their_ages_gain_nothing():
    true = np.random.default_rng(2).uniform(0.0, 0.1, size=ERROR_WINDOWS)
    assert compare_ages(draw_errors(true)[0], AGES, -0.01, 0.11)[0] < 3.0
    assert compare_ages(draw_errors(np.zeros(ERROR_WINDOWS))[0], AGES, -0.01, 0.01)[0] < 3.0


def test_late_commands_gain_and_their_windows_are_found():
    late = np.random.default_rng(3).random(ERROR_WINDOWS) < 0.2
    errors, slope = draw_errors(np.where(late, -0.08, 0.0))
    gain, posterior = compare_ages(errors, AGES, -0.01, 0.01)
    assert gain > 10.0 * MIN_GAIN
    probability = posterior[AGES < -0.01].sum(axis=0)
    clear = np.abs(slope) > 100.0
    assert np.mean(probability[late & clear] > 0.9) > 0.9
    assert np.mean(probability[~late & clear] > 0.9) < 0.1


def test_events_that_no_age_explains_gain_nothing():
    """The negative control: errors as large, at as many windows."""
    errors, _ = draw_errors(np.zeros(ERROR_WINDOWS))
    late = np.random.default_rng(3).random(ERROR_WINDOWS) < 0.2
    errors[:, late] += 16.0 * np.random.default_rng(4).normal(size=(late.sum(), 2))
    assert compare_ages(errors, AGES, -0.01, 0.01)[0] < MIN_GAIN


def simulate_minute(hide=lambda car: None):
    """What is found in a minute of a car whose model is right."""
    side, fit = fitted_side(hide)
    return side, fit, find_late_commands((side,), fit.vehicle, (fit.timing,))


@pytest.mark.slow
def test_lost_commands_are_found_with_their_moments():
    side, fit, found = simulate_minute(lambda car: lose_commands(car, 0.35, seed=1))
    assert found.log_likelihood > 2.0 * MIN_GAIN
    assert 0.1 < found.share < 0.6
    assert 0.02 < found.delay < 0.11
    assert 1 <= len(found.moments) <= 5
    assert {Path(m.file).name for m in found.moments} == {"car_1_4.csv"}
    blind = replace(side, prepared=None)
    assert find_late_commands((blind,), fit.vehicle, (fit.timing,)) is None
    for name, kept in (("steering_rate_limit", False), ("steering_trim", True)):
        vehicle = apply(fit.vehicle, name)
        again = find_late_commands((side,), vehicle, (fit.timing,))
        assert (again is not None) == kept


@pytest.mark.slow
@pytest.mark.parametrize("hide", [lambda car: None, lambda car: add_gusts(car, 2.0, seed=1)])
def test_a_sound_link_has_none(hide):
    assert simulate_minute(hide)[2] is None


@pytest.mark.long
def test_lost_commands_are_flagged_in_most_kinds_of_driving():
    """Six styles, a refit of the paper's model: 35 % lost in 4 of 6 or more, of six sound links
    none. (Found: 4 and none.) Whole diagnoses: ``studies/diagnosis/noise_floor_cases.py``."""
    flagged = {0.35: 0, 0.0: 0}
    for k, style in enumerate(("steps", "waves", "prbs", "gentle", "ramps", "laps")):
        for share in flagged:
            car = Car()
            lose_commands(car, share, seed=k)
            recording = read(record(Path(mkdtemp()) / "car_1_4.csv", car,
                                    Habits(style=style, commands=COMMANDS[k % 4]), 90.0, 6000 + k))
            evidence, _ = make_evidence([recording], PAPER.body.l_r)
            side = make_recording_set(evidence, [recording], PAPER.body.l_r, None)
            search = ForwardSearch(evidence, PAPER, Settings(free=free_names(PAPER, tuple(FREE))))
            fit, _ = search._fit_and_measure_noise(search.make_space(PAPER),
                                                   MessageTiming(evidence.message_age))
            flagged[share] += find_late_commands((side,), fit.vehicle, (fit.timing,)) is not None
    assert flagged[0.35] >= 4
    assert flagged[0.0] == 0


LATE_COMMANDS = LateCommands(0.21, 0.062, 34.2,
                             (ErrorMoment("19/a.csv", 12.3, 0.9, 8.0, 1.2, 0.3, -0.4),))


def test_terminal_page_and_verdict_state_late_commands(capsys):
    question = SimpleNamespace(refit=False)
    assert conclusion._verdict(question, None, (), (LATE_COMMANDS,), {}, (), ()) == "unexplained"
    d = replace(made.diagnosis("unexplained", 0, False), late_commands=LATE_COMMANDS, considered=())
    assert d.to_json()["late_commands"]["moments"][0]["second"] == 12.3
    assert "some commands act later than they were logged" in headline(d)
    show_full(d)
    text = " ".join(capsys.readouterr().out.split())
    for words in ("21 % of the changes of a command act later", "by 0.06 s", "19/a.csv at 12.3 s"):
        assert words in text
        assert words.replace(" %", "\u00a0%") in page(d)
