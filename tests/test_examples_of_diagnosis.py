"""The examples that diagnose: what was hidden is named, and knowing it improves the drive.

With fewer effects and controllers to choose from than by default; that is
among the slow tests.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
TUNE = EXAMPLES / "tune_on_what_was_found.py"
UPGRADES = EXAMPLES / "what_two_upgrades_bought.py"
IN_CONTROL = EXAMPLES / "use_cases" / "diagnosis_in_control.py"
LAG = "sim://?nano=mock&effect=steering_lag:0.12"
STEERING_EFFECTS = ("steering_lag", "steering_delay", "yaw_inertia")
LOSSES = ("steering_backlash", "steering_trim", "battery_fade", "rolling_resistance")


def load_program(program):
    spec = importlib.util.spec_from_file_location(program.stem, program)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run_tune(url, short):
    example = load_program(TUNE)
    example.URL = url
    if short:
        example.ONLY = STEERING_EFFECTS
        example.LOOK_AHEAD = (0.2, 0.3)
        example.PREDICTION = (0.0, 0.04)
    return example.main()


def run_upgrades(seconds, only):
    example = load_program(UPGRADES)
    example.CARS = {k: url.replace("nano=avr", "nano=mock") for k, url in example.CARS.items()}
    example.ONLY = only
    return example.main(seconds)


@pytest.mark.long
def test_the_extended_model_tunes_the_better_controller():
    found, driven = run_tune(LAG, short=True)
    assert [c.effect for c in found.causes] == ["steering_lag"]
    assert found.causes[0].parameters["k"].value == pytest.approx(0.12, rel=0.1)
    assert driven["extended"] < 0.015
    assert driven["extended"] < 0.2 * driven["base"]


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_it_does_on_cars_that_differ_in_more_than_that(seed):
    found, driven = run_tune(f"{LAG}&seed={seed}", short=False)
    assert "steering_lag" in [c.effect for c in found.causes]
    assert driven["extended"] < 0.02
    assert driven["extended"] < 0.2 * driven["base"]


@pytest.mark.long
def test_where_nothing_is_hidden_nothing_is_gained():
    found, driven = run_tune("sim://?nano=mock", short=False)
    assert not found.causes
    assert driven["extended"] == driven["base"] < 0.01


def check_upgrades(results):
    before = results["before"]
    after = results["after"]
    values = {c.effect: c.parameters["k"].value for c in before[0].causes}
    assert set(values) == {"steering_backlash", "battery_fade"}
    assert values["steering_backlash"] == pytest.approx(0.1, rel=0.1)
    assert values["battery_fade"] == pytest.approx(-0.15, rel=0.1)
    assert not after[0].causes
    assert after[1] < 0.7 * before[1]
    assert before[3] / before[2] < 0.97 * after[3] / after[2]  # speed at last by that at first
    assert after[3] == pytest.approx(after[2], rel=0.03)


@pytest.mark.slow
def test_both_upgrades_are_found_by_a_drive_before_and_after():
    check_upgrades(run_upgrades(32.0, LOSSES))


@pytest.mark.long
def test_both_upgrades_are_found_among_all_effects():
    check_upgrades(run_upgrades(60.0, ()))


@pytest.mark.long
def test_contouring_control_by_what_was_found():
    """The car's own model without its lags swings; the one that names them does not."""
    found, driven = load_program(IN_CONTROL).main()
    named = {c.effect: c.parameters["k"].value for c in found.causes}
    assert named == {"steering_lag": pytest.approx(0.12, abs=0.015),
                     "throttle_lag": pytest.approx(0.08, abs=0.015)}
    without = driven["the car's, without its lags"]
    extended = driven["extended by diagnose"]
    assert extended[0] < 0.02
    assert extended[0] < 0.2 * without[0]


@pytest.mark.long
@pytest.mark.emulator
@pytest.mark.parametrize("program", [TUNE, UPGRADES], ids=lambda p: p.stem)
def test_it_runs_unchanged(program, tmp_path):
    env = {k: v for k, v in os.environ.items() if k not in ("DART_HAL_URL", "DART_NANO")}
    done = subprocess.run([sys.executable, str(program)], capture_output=True, text=True,
                          cwd=tmp_path, env=env, check=False)
    assert done.returncode == 0, done.stderr
    assert "steering_" in done.stdout
