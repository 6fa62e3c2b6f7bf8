"""Any subset of the sensors is enough for what it determines; the rest is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dart_hal.car.runs import read_run
from dart_hal.core.config.car import parse_config
from dart_hal.core.errors import RecordingError
from dart_hal.recording.imported import write_imported
from dart_hal.vehicle.sets import PAPER
from dart_lab.diagnosis.inputs import check_inputs
from dart_lab.diagnosis.run import make_evidence
from dart_lab.importing import convert_tables
from dart_lab.importing.maps import parse_map
from dart_lab.importing.tables import Table
from tests.importing.logs import MAP, make_log

STREAMS = ("poses", "encoder", "gyro", "accelerometer")


@pytest.fixture(scope="module")
def log():
    return make_log(40.0)


def record(log, path, streams):
    """Write an imported recording with these streams, and read it."""
    parts = MAP.split("[")
    text = "[".join([parts[0], *(p for p in parts[1:] if p.split("]")[0] in
                                 ("steering", "throttle", *streams))])
    write_imported(convert_tables([Table("log", log)], parse_map(text, "map")), path)
    return read_run(path)


@pytest.mark.slow
@pytest.mark.parametrize("streams", [
    ("poses",), ("poses", "encoder"), ("poses", "gyro"), ("poses", "accelerometer"),
    ("poses", "encoder", "gyro"), ("encoder", "gyro"), STREAMS],
    ids="+".join)
def test_a_diagnosis_takes_what_there_is_and_names_what_is_missing(log, tmp_path, streams):
    r = record(log, tmp_path / "run.mcap", streams)
    inputs = check_inputs([r], [], PAPER)
    notes = " ".join(inputs.notes)
    for name in STREAMS[1:]:
        is_reported = f"no {name}" in notes
        assert is_reported == ("poses" in streams and name not in streams), notes
    assert "is dead" not in notes
    evidence, windows = make_evidence(inputs.train, PAPER.body.l_r)
    assert sum(windows) > 0
    found = evidence.residuals(PAPER)
    assert np.isfinite(found.motion).all()
    channels = np.isfinite(found.sensors).any(axis=0)
    if "poses" in streams:
        assert channels.tolist() == [name in streams for name in
                                     ("encoder", "gyro", "accelerometer", "accelerometer")]


@pytest.mark.slow
@pytest.mark.parametrize(("streams", "what"), [
    (("encoder",), "the turns of the car are unknown"),
    (("encoder", "accelerometer"), "the turns of the car are unknown"),
    (("gyro", "accelerometer"), "the motion of the car is unknown")], ids=lambda v: str(v)[:20])
def test_sensors_that_do_not_determine_the_motion_are_refused(log, tmp_path, streams, what):
    r = record(log, tmp_path / "run.mcap", streams)
    with pytest.raises(RecordingError, match=what):
        check_inputs([r], [], PAPER)


@pytest.mark.slow
def test_recordings_of_two_cars_are_not_pooled(log, tmp_path):
    r = record(log, tmp_path / "run.mcap", ("poses",))
    text = (Path(__file__).parents[2] / "cars" / "dart-01" / "car.toml").read_text()
    cars = [parse_config(text.replace("dart-01", name), "car.toml") for name in ("red", "blue")]
    two = [replace(r, car=car, sha256=car.name) for car in cars]
    with pytest.raises(RecordingError, match="recordings of 2 cars") as error:
        check_inputs(two, [], PAPER)
    assert "red: " in error.value.found
    check_inputs([two[0], replace(two[0], sha256="other")], [], PAPER)


@pytest.mark.slow
def test_logs_with_different_angles_of_the_full_command_are_not_pooled(log, tmp_path):
    r = record(log, tmp_path / "run.mcap", ("poses",))
    two = [replace(r, steering_scale=scale, sha256=str(scale)) for scale in (0.38, 0.41)]
    with pytest.raises(RecordingError, match="different scales of the steering") as error:
        check_inputs(two, [], PAPER)
    assert "0.38 rad" in error.value.found
    assert "same map" in error.value.remedy
