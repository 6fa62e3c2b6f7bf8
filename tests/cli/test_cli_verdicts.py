"""Reports in the terminal begin with three lines: verdict, figures, the first thing to do."""

from __future__ import annotations

import re
from types import SimpleNamespace

import pytest

from dart_hal.calibration.acceptance import STEP_NAMES
from dart_hal.car import Car
from dart_lab.cli import accept, study
from dart_lab.pages import identify_table
from dart_lab.pages.accept_page import AcceptanceReport
from dart_lab.study.stages import CHANNEL_LABELS, StageResult
from tests.cli.test_cli_accept import ACCEPTED_CAR, EMULATED, only
from tests.common import EXCERPT, MOCK_3_URL

FREE_DRIVE = EXCERPT / "91_free_driving_16_sept_2024"
STEP_INPUTS = EXCERPT / "19_step_input_data"


def beginning(text: str) -> list[str]:
    """The first three lines."""
    return text.splitlines()[:3]


@pytest.mark.slow
def test_data_check_begins_with_its_verdict(verb):
    verdict, uses, first = beginning(verb("data", "check", FREE_DRIVE).out)
    assert verdict == "1 of 1 recordings is good for a fit or an evaluation, 67.8 s in total."
    assert uses.startswith("good for: motor 1, steering 1, delay 1, tyres 1, evaluation 1; 220")
    assert first == "First: dart-hal evaluate FILES, then dart-hal diagnose --train FILES"


@pytest.mark.slow
def test_evaluate_begins_with_its_verdict(verb):
    ran = verb("evaluate", FREE_DRIVE)
    verdict, errors, first = beginning(ran.out)
    assert re.fullmatch(r"The model paper predicts the position 1 s ahead with an error of "
                        r"0\.\d{2,3} m \(RMSE\), \d+ % (smaller|larger)( \[.* %\])? than by "
                        r"constant velocity\.", verdict)
    assert re.search(r"v_x 0\.\d+ m/s, v_y 0\.\d+ m/s, yaw rate 0\.415 rad/s", errors)
    assert errors.endswith("windows of 1 of 1 recordings")
    assert first.startswith("First: dart-hal diagnose")


@pytest.mark.slow
def test_evaluate_counts_notices_and_lists_them_with_full(verb):
    assert re.search(r"^\d+ notices? \(--full\)$", verb("evaluate", FREE_DRIVE, STEP_INPUTS).err,
                     re.MULTILINE)
    full = verb("evaluate", "--full", FREE_DRIVE, STEP_INPUTS)
    assert "notice: skipped 13 file(s)" in full.err
    assert "(--full)" not in full.err


@pytest.mark.parametrize(("identified", "step"), [
    ({"friction": False, "tyres": True},
     "record a drive that determines friction.a: dart-hal experiment friction"),
    ({"tyres": False}, "dart-hal identify all FILES, unless --base has the steering delay and map "
                       "of this car: the tyres take both as exact"),
    ({"friction": True}, "dart-hal evaluate on recordings that were not used in this fit")])
def test_first_step_after_identify_is_a_command_for_its_result(monkeypatch, identified, step):
    monkeypatch.setattr(identify_table, "why_unsound", lambda fit: "")
    fits = {name: SimpleNamespace(parameters={"a": SimpleNamespace(identifiable=one)})
            for name, one in identified.items()}
    assert identify_table._first_step(SimpleNamespace(fits=fits)) == step


def test_identify_begins_with_its_verdict(verb):
    verdict, residuals, first = beginning(
        verb("identify", "friction", "--as-paper", EXCERPT, "--dry-run").out)
    assert verdict == "3 of 3 parameters identified, from 1173 samples of 13 of 13 recordings."
    assert residuals == "residuals (RMSE): friction 0.19 N"
    assert first == "First: dart-hal evaluate on recordings that were not used in this fit"


@pytest.mark.slow
def test_identify_names_a_fit_that_is_not_sound(verb):
    verdict, _, first = beginning(
        verb("identify", "tyres", "--as-paper", EXCERPT, "--dry-run").out)
    assert "parameters identified" in verdict
    assert "front_C stopped at the edge of the allowed interval" in first


@pytest.mark.slow
def test_accept_begins_with_its_verdict(verb):
    done = verb("accept", "--yes", "--url", ACCEPTED_CAR, "--emulator", EMULATED, *only("rotation"))
    verdict, steps, first = beginning(done.out)
    assert re.fullmatch(r"\d of \d values are as the emulated car predicts, within 3 standard "
                        r"errors and 5%, or as much as sound parts differ\.", verdict)
    assert steps.startswith(f"1 of {len(STEP_NAMES)} steps measured; skipped: ")
    assert first == "First: dart-hal calibrate all"


@pytest.mark.slow
def test_accept_lists_values_and_notices_with_full(verb):
    words = ("accept", "--yes", "--url", ACCEPTED_CAR, "--emulator", EMULATED, *only("rotation"))
    short = verb(*words)
    full = verb(*words, "--full")
    assert "as predicted" not in short.out
    assert "as predicted" in full.out
    assert len(short.out.splitlines()) == 3 + len(STEP_NAMES)


def test_accept_counts_the_notices_of_the_car(capsys):
    report = AcceptanceReport((), (), {"notices": ["the files of dart-01 are not used"]})
    for full, line in ((False, "1 notice (--full)"), (True, "notice: the files of dart-01")):
        accept._print_report(report, full)
        assert line in capsys.readouterr().err


@pytest.mark.slow
def test_accept_begins_with_the_step_that_failed(verb):
    done = verb("accept", "--yes", "--url", f"{ACCEPTED_CAR}&fail=enc:off@0", "--emulator",
                EMULATED, *only("rotation"))
    _, steps, first = beginning(done.out)
    assert "failed: " in steps
    assert len(first) > len("First: ")


@pytest.mark.slow
def test_report_begins_with_its_verdict(verb, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with Car.open(MOCK_3_URL, record=tmp_path / "runs" / "at_rest.mcap") as car:
        for _ in car.states(duration=1.0):
            pass
    ran = verb("report", "--car", "sim-3")
    verdict, runs, first = beginning(ran.out)
    assert re.fullmatch(r"sim-3: 0 quantities are measured, \d+ are not, 0 changed by more than 3 "
                        r"standard errors\.", verdict)
    assert re.fullmatch(r"runs: 1, \S+ s, 0 m, 0 frames lost or damaged", runs)
    assert first.startswith("First: never measured: ")
    assert "notices (--full)" in ran.err
    assert ran.err.count("notice: never measured") == 0
    assert verb("report", "--car", "sim-3", "--full").err.count("notice: never measured") > 1


def stage(name: str, verdict: str, *lines: str, sound: bool = True, **facts) -> StageResult:
    return StageResult(name, verdict, lines, (), facts, sound)


def test_study_begins_with_its_verdict(capsys):
    pooled = {name: dict.fromkeys(CHANNEL_LABELS, error)
              for name, error in (("start", 0.31234), ("fitted", 0.1))}
    study._show({"check": stage("check", "2 of 2 recordings are good", "train: a"),
                 "validation": stage("validation", "the fit is better", pooled=pooled),
                 "diagnosis": stage("diagnosis", "Nothing is missing.", "one", "two"),
                 "next": stage("next", "drive circles")}, full=False)
    printed = capsys.readouterr()
    verdict, errors, first = beginning(printed.out)
    assert verdict == "Nothing is missing."
    assert errors.startswith("errors 1 s ahead on the test recordings, start model -> "
                             "model.toml: speed 0.312 -> 0.1 m/s, ")
    assert first == "First: drive circles"
    assert "3 notices (--full)" in printed.err


def test_study_begins_with_the_stage_at_which_it_ends(capsys):
    study._show({"check": stage("check", "0 of 1 recordings are good", "no poses", sound=False)},
                full=True)
    printed = capsys.readouterr()
    assert printed.out.splitlines()[:2] == ["The study ends at check: 0 of 1 recordings are good.",
                                            "First: no poses"]
    assert "notice: check: no poses" in printed.err
