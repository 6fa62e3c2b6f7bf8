"""A steering map out of real recordings: the published figures, and honest notes."""

from __future__ import annotations

import json

import numpy as np
import pytest

from dart_hal.calibration.from_recordings import steering_from, steering_from_recordings
from dart_hal.core.errors import CalibrationFailed, RecordingError
from dart_hal.recording.dart import read_all
from dart_hal.vehicle.sets import PAPER
from dart_hal.vehicle.steering import make_steering

CONTRACT = {"car", "source", "n", "duration_s", "map", "paper_form", "residual_rms_rad",
            "backlash_rad", "written", "notes"}


@pytest.fixture(scope="module")
def levels(excerpt):
    return steering_from([excerpt / "30_step_steering_data"])


def test_map_of_folder_30_is_the_papers(levels):
    assert levels.n == 3381
    assert levels.residual_rms <= 0.0205
    assert levels.residual_rms == pytest.approx(0.02005, rel=1e-3)
    paper = make_steering(PAPER.steering, np)(levels.command)
    assert np.degrees(np.abs(levels.angle - paper)).max() < 0.5
    published = {"k_left": 1.662, "a_left_rad": 0.3284, "s0": 0.0194, "a_right_rad": 0.3784,
                 "k_right": 1.662}
    assert levels.paper_form == pytest.approx(published, abs=6e-4)


def test_map_increases_over_the_covered_range_only(levels):
    assert len(levels.command) >= 9
    assert np.all(np.diff(levels.command) > 0.0)
    assert np.all(np.diff(levels.angle) > 0.0)
    assert (levels.command[0], levels.command[-1]) == (-1.0, 1.0)
    assert np.all(levels.angle_std > 0.0)


def test_residual_is_over_the_samples_used(levels):
    command, angle, _ = levels.samples
    residual = angle - make_steering(levels_form(levels), np)(command)
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(levels.residual_rms, rel=1e-6)


def levels_form(result):
    from dart_hal.vehicle.parameters import Steering

    return Steering(**result.paper_form)


def test_standard_errors_cover_the_scatter_of_level_means(levels):
    """Samples as independent would claim 0.03 deg; level means leave the form by 0.5 deg."""
    command, angle, _ = levels.samples
    at = np.interp(command, levels.command, levels.angle)
    std = np.interp(command, levels.command, levels.angle_std)
    means = [(angle - at)[command == c].mean() / std[command == c].mean()
             for c in np.unique(command) if (command == c).sum() > 20]
    assert 0.6 < np.mean(np.abs(means) < 1.645) <= 1.0
    naive = levels.residual_rms / np.sqrt(levels.n / 5.0)
    assert levels.angle_std.mean() > 5.0 * naive


def test_json_is_the_contract(levels):
    data = json.loads(json.dumps(levels.to_json(), allow_nan=False))
    assert set(data) >= CONTRACT
    assert set(data["map"]) == {"command", "pulse_us", "angle_rad", "angle_std_rad"}
    assert data["map"]["pulse_us"] is None
    assert set(data["paper_form"]) == {"k_left", "a_left_rad", "s0", "a_right_rad", "k_right"}
    assert data["written"] is None
    assert len(data["source"]) == 8
    assert any("safety gate" in note for note in data["notes"])


def test_slow_recording_states_that_it_is_slow(excerpt):
    found, _ = read_all([excerpt / "30_step_steering_data",
                         excerpt / "steering_identification_25_sept_2024"])
    result = steering_from_recordings(found)
    notes = [n for n in result.notes if "10_00_45" in n]
    assert any("0.3 m/s" in n and "slow" in n for n in notes)
    assert result.n > 3381


@pytest.mark.slow
def test_dead_encoder_and_schema_c_fall_back_to_the_mocap(excerpt):
    result = steering_from([excerpt])
    assert any("encoder dead: speed and yaw rate from the mocap" in n for n in result.notes)
    assert any("no encoder and no IMU" in n for n in result.notes)


def test_one_level_is_no_map(excerpt):
    with pytest.raises(CalibrationFailed, match="too little"):
        steering_from([excerpt / "29_step_input_data"])


def test_car_at_rest_gives_no_map(tmp_path, write, table_a):
    table = table_a()
    table["vel encoder"][:] = 0.0
    with pytest.raises(CalibrationFailed, match="no recording holds a sample"):
        steering_from([write(table)])


def test_bad_file_is_refused_by_name_and_skipped_in_a_folder(excerpt, tmp_path, write, table_a):
    bad = tmp_path / "bad.csv"
    bad.write_text("not,a,recording\n1,2,3\n")
    with pytest.raises(RecordingError, match=r"bad\.csv"):
        steering_from([excerpt / "30_step_steering_data", bad])
    write(table_a(), "straight.csv")
    result = steering_from([excerpt / "30_step_steering_data", tmp_path])
    assert any("bad.csv: skipped" in n for n in result.notes)


@pytest.mark.slow
@pytest.mark.recordings
def test_levels_of_25_september(recordings):
    result = steering_from([recordings / "steering_identification_25_sept_2024"])
    assert result.n == 2534
    assert result.residual_rms < 0.03
    assert np.all(np.diff(result.angle) > 0.0)
    assert sum("0.3 m/s" in n and "slow" in n for n in result.notes) == 4
    assert any("no data between commands" in n for n in result.notes)
    assert result.to_json()["backlash_rad"] == {"value": None, "std": None}


@pytest.mark.recordings
@pytest.mark.slow
def test_everything_at_once(recordings):
    result = steering_from([recordings])
    assert np.all(np.diff(result.angle) > 0.0)
    assert len(result.source) == 83 - sum("skipped" in n for n in result.notes) - sum(
        " 0 of " in n for n in result.notes)


def sine_drive(table_a, lag: float) -> dict:
    """20 Hz rows of a sine in steering that the wheels answer ``lag`` s later, 1 m/s."""
    n = 1200
    table = table_a(n)
    t = 0.05 * np.arange(n)
    table["elapsed time sensors"] = 100.0 + t
    table["steering"] = np.sin(2.0 * np.pi * 0.4 * t)
    table["vel encoder"][:] = 1.0
    wheel = make_steering(PAPER.steering, np)(np.sin(2.0 * np.pi * 0.4 * (t - lag)))
    table["W (IMU)"] = np.tan(wheel) / 0.175
    return table


def test_changing_commands_are_taken_as_the_wheels_answer_them(write, table_a):
    result = steering_from([write(sine_drive(table_a, 0.2))])
    paper = make_steering(PAPER.steering, np)(result.command)
    assert np.degrees(np.abs(result.angle - paper)).max() < 0.5
    assert any("taken 0.20 s earlier" in n for n in result.notes)
    assert result.backlash is None


def test_held_levels_are_not_shifted(levels):
    assert not any("earlier" in n for n in levels.notes)
