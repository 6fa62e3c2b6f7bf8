"""A sensor that repeats one value is missing, and copies that differ are reported."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.core.errors import RecordingError
from dart_hal.recording.check.findings import SERIOUS_KINDS
from dart_hal.recording.dart.reader import read
from dart_hal.vehicle.sets import PAPER
from dart_lab.identification.shooting import fit_from_recordings
from tests.recorded.simulated_recording import simulate_recording


def list_kinds(recording):
    return [note.kind for note in recording.notes]


@pytest.mark.parametrize("column", ["W (IMU)", "acc x (IMU)", "acc y (IMU)"])
def test_a_stuck_channel_is_missing(write, table_b, column):
    table = table_b()
    table[column][:] = -0.002
    recording = read(write(table))
    channel = {"W (IMU)": "yaw_rate", "acc x (IMU)": "accel_x", "acc y (IMU)": "accel_y"}[column]
    assert np.isnan(getattr(recording.messages, channel)).all()
    assert "sensor_stuck" in list_kinds(recording)
    assert "sensor_stuck" in SERIOUS_KINDS


def test_control_one_other_value_is_a_measurement(write, table_b):
    table = table_b()
    table["W (IMU)"][:] = -0.002
    table["W (IMU)"][300:310] = -0.003
    recording = read(write(table))
    assert "sensor_stuck" not in list_kinds(recording)
    assert np.isfinite(recording.messages.yaw_rate).all()


@pytest.mark.parametrize("stuck_at", [0.0, 0.1032])
def test_an_encoder_whose_cable_breaks_is_missing_from_then_on(write, table_b, stuck_at):
    table = table_b(n=900, speed=0.6)
    table["vel encoder"][400:] = stuck_at
    recording = read(write(table))
    missing = np.isnan(recording.messages.speed)
    assert not missing[:40].any()
    assert missing[40:].all()
    assert "sensor_stuck" in list_kinds(recording)
    assert "false_lock" not in list_kinds(recording)


def test_control_an_encoder_at_a_constant_speed_is_believed(write, table_b):
    table = table_b(n=900, speed=0.6)
    table["vel encoder"][400:] = 0.6
    recording = read(write(table))
    assert "sensor_stuck" not in list_kinds(recording)
    assert np.isfinite(recording.messages.speed).all()


def test_copies_that_differ_are_reported(write, table_b):
    table = table_b()
    assert "differing_copies" not in list_kinds(read(write(table, "held.csv")))
    table["steering"] = np.where(np.arange(600) % 10, 0.1, 0.3)
    recording = read(write(table, "differ.csv"))
    (note,) = [note for note in recording.notes if note.kind == "differing_copies"]
    assert "steering" in note.why
    assert note.rows == 540
    assert np.all(recording.messages.steering == 0.3)


def test_a_joint_fit_of_one_block_is_refused():
    recording, frame = simulate_recording(1, seconds=4.0)
    with pytest.raises(RecordingError, match="too little driving") as refused:
        fit_from_recordings([recording], PAPER, reference=frame)
    assert "longer drive" in refused.value.remedy
