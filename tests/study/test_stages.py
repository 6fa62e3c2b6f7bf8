"""A study runs its stages in order, keeps their results, and repeats one alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.car.runs import read_any
from dart_hal.core.config.model import Covariance
from dart_hal.core.errors import RecordingError, UsageError
from dart_hal.recording.dart import Reference
from dart_hal.vehicle.flat import with_values
from dart_hal.vehicle.load import find_model
from dart_hal.vehicle.sets import PAPER
from dart_lab.identification.shooting.identifiability import Identifiability
from dart_lab.study import StageResult, Study, load_results, run_stage, split_recordings, stages
from dart_lab.study.stages import describe_changes
from tests.identification.test_speed_loop_fit import driven
from tests.recorded.simulated_recording import simulate_recording, table_of, write_table

FRAME = Reference(0.1, 0.01, 0.0, "of the simulation")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("recordings")
    for seed in (3, 4):
        recording, _ = simulate_recording(seed, seconds=30.0, frame=FRAME)
        write_table(table_of(recording, "C"), path / f"{seed}.csv")
    return path


@pytest.fixture
def study(folder, tmp_path):
    recordings, _ = read_any([folder], reference=FRAME)
    return Study(tmp_path, tuple(recordings), find_model("paper")[0])


@pytest.mark.slow
def test_the_last_third_tests(study):
    one, two = study.recordings
    assert split_recordings((one, two)) == ((one,), (two,))
    train, test = split_recordings((one,))
    assert train[0].sha256 == test[0].sha256
    assert train[0].spans
    assert not set(train[0].spans) & set(test[0].spans)


def test_the_check_says_what_each_recording_is_good_for(study):
    result = run_stage(study, "check")
    assert result.sound
    assert "2 of 2" in result.verdict
    assert load_results(study.folder)["check"].rows == result.rows


@pytest.mark.slow
def test_recordings_without_a_frame_of_their_poses_are_not_used(folder, tmp_path):
    recordings, _ = read_any([folder])
    unknown = [replace(r, marker=None) for r in recordings]
    result = run_stage(Study(tmp_path, tuple(unknown), find_model("paper")[0]), "check")
    assert not result.sound


@pytest.mark.slow
def test_identifiability_names_what_is_missing_and_what_to_drive(study):
    result = run_stage(study, "identifiability")
    determined = {p["name"]: p["determined"] for p in result.facts["parameters"]}
    assert determined["tyres.rear_cornering_stiffness"]
    assert not determined["friction.b"]
    assert any("coast" in line for line in result.lines)


def test_study_goes_on_where_parameters_are_determined_together_alone(study, monkeypatch):
    """As in 20 Hz logs with a speed loop: the fit lowers the error of each channel all the same."""
    together = (Identifiability("friction.a", 1.7, 1.0, "N", False, "let the car coast"),)
    monkeypatch.setattr(stages, "predict_identifiability", lambda *given: together)
    result = run_stage(study, "identifiability")
    assert result.verdict.startswith("0 of 1 parameters")
    assert result.sound


def test_what_a_fit_changed_is_stated_in_quantities_of_the_workshop():
    names = ("steering.s0", "steering.k_left", "delay.steering_lag_s", "friction.a")
    stds = (0.005, 0.5, 0.004, 0.3)
    fitted = with_values(PAPER, {"steering.s0": 0.12, "delay.steering_lag_s": 0.08})
    joint = Covariance(names=names, matrix=tuple(map(tuple, np.diag(np.square(stds)).tolist())))
    first, *others = describe_changes(PAPER, fitted, joint)
    assert first.startswith("time from steering command to wheel: delay and lag")
    assert first.endswith("+- 4 ms")
    assert any(text.startswith("steering map: angle straight on") for text in others)
    assert not any("resistance" in text for text in others)
    assert describe_changes(PAPER, fitted, None) == []


@pytest.mark.slow
def test_a_stage_without_its_model_is_refused(study):
    for stage in ("validation", "diagnosis", "next"):
        with pytest.raises(UsageError, match="no fitted model yet"):
            run_stage(study, stage)
    with pytest.raises(UsageError, match="no stage"):
        run_stage(study, "guess")


@pytest.mark.slow
def test_a_damaged_result_names_its_stage(study):
    run_stage(study, "check").save(study.folder)
    (study.folder / "1_check.json").write_text("{")
    with pytest.raises(RecordingError, match="damaged") as error:
        load_results(study.folder)
    assert "--stage check" in error.value.remedy


@pytest.mark.slow
def test_the_next_drive_needs_the_diagnosis_of_this_folder(study):
    run_stage(study, "fit")
    with pytest.raises(UsageError, match="no diagnosis yet"):
        run_stage(study, "next")
    StageResult("diagnosis", "", facts={"next_drives": ["circles", "steps"]}).save(study.folder)
    result = run_stage(study, "next")
    assert (result.verdict, result.lines) == ("circles", ("steps",))
    # Where no cause needs a drive, what the fit lacks remains.
    StageResult("diagnosis", "", facts={"next_drives": []}).save(study.folder)
    run_stage(study, "identifiability")
    result = run_stage(study, "next")
    assert "nothing to suggest" in result.verdict
    assert any("coast" in line for line in result.lines)


@pytest.mark.slow
def test_recordings_of_a_speed_loop_start_from_a_model_of_duty(tmp_path):
    study = Study(tmp_path, (driven(1, 20.0), driven(2, 20.0)), find_model("paper")[0])
    determined = {p["name"] for p in run_stage(study, "identifiability").facts["parameters"]}
    assert {"motor.gain", "motor.max_force"} <= determined
    run_stage(study, "fit")
    pooled = run_stage(study, "validation").facts["pooled"]
    assert pooled["fitted"]["vx"] < pooled["start"]["vx"] < pooled["constant velocity"]["vx"]
