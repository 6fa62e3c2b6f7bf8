"""The mounting of the accelerometer is fitted with the model and goes into the car's own file."""

from __future__ import annotations

from dataclasses import replace

import pytest

from dart_hal.recording.dart import RUN
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.file import vehicle_from
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.mounted import describe_imu_mounting, fit_mounting
from dart_lab.diagnosis.result import ParameterEstimate
from dart_lab.diagnosis.run import make_evidence
from dart_lab.diagnosis.search.forward import ForwardSearch
from dart_lab.diagnosis.search.selection import Settings
from dart_lab.diagnosis.write import extended_model
from dart_lab.identification.evidence.noise import estimate_noise
from dart_lab.identification.evidence.space import (
    MESSAGE_AGE,
    MESSAGE_AGE_REACH,
    MessageTiming,
    Space,
)
from dart_lab.identification.objective import refit
from studies.diagnosis import hidden_drive
from studies.diagnosis.known_frame import read
from tests.diagnosis import made_by_hand as made
from tests.diagnosis import onboard_files, searched


def fit_mounting_of(of_drive, p=PAPER):
    noise, point = searched.fit_start(of_drive, p)
    at = fit_mounting(ForwardSearch(of_drive, p, Settings()), of_drive, point, noise)
    return at, describe_imu_mounting(at, of_drive)


@pytest.mark.slow
def test_a_drive_shows_how_the_accelerometer_is_mounted(tmp_path):
    places = (("imu_yaw", 0.04), ("imu_lever_arm", 0.02), ("imu_offset_y", 0.02))
    misaligned = PAPER
    for name, true in places:
        misaligned = apply(misaligned, name, k=true)
    of_drive = onboard_files.evidence(onboard_files.record_onboard(tmp_path, misaligned))
    _, mounting = fit_mounting_of(of_drive)
    for name, true in places:
        number = mounting[name]["k"]
        assert 0.0 < number.std < 0.5 * true
        assert number.value == pytest.approx(true, abs=3.0 * number.std)
    assert not {"gyro_scale", "gyro_bias"} & mounting.keys()


@pytest.mark.slow
@pytest.mark.parametrize("knows", [True, False])
def test_a_model_with_the_mounting_names_nothing_and_states_the_present_one(tmp_path, knows):
    misaligned = apply(PAPER, "imu_yaw", k=0.1)
    drives = [onboard_files.record_onboard(tmp_path, misaligned, seed, 40.0) for seed in (1, 2)]
    file, p = find_model("paper")
    p = apply(p, "imu_yaw", k=0.08) if knows else p
    found = diagnose(file, p, drives[:1], drives[1:], only=("imu_yaw",))
    assert [c.effect for c in found.causes] == ([] if knows else ["imu_yaw"])
    if knows:
        moved = found.refitted["imu_yaw.k"]
        assert moved.before == 0.08
        assert moved.after == pytest.approx(0.1, abs=3.0 * moved.std)
        entry = next(e for e in extended_model(found, file, drives).effects if e.name == "imu_yaw")
        assert entry.parameters["k"].std == moved.std
    else:
        assert "imu_yaw" not in found.refitted


@pytest.mark.slow
def test_what_the_model_has_is_not_fitted_twice(tmp_path):
    of_drive = onboard_files.evidence(onboard_files.record_onboard(tmp_path, seconds=15.0))
    at, mounting = fit_mounting_of(of_drive, apply(PAPER, "imu_yaw", k=0.01))
    assert "imu_yaw" not in at.names
    assert "imu_yaw" not in mounting
    assert "imu_lever_arm" in mounting


def test_with_motion_capture_no_mounting_is_assumed(tmp_path):
    path = hidden_drive.write(tmp_path / "car_1_a.csv", PAPER, 1, hidden_drive.Plan(seconds=15.0))
    of_drive = make_evidence([read(path)], PAPER.body.l_r)[0]
    at, mounting = fit_mounting_of(of_drive)
    assert at.names == ()
    assert mounting == {}


@pytest.mark.slow
def test_with_motion_capture_a_run_shows_how_its_gyro_is_scaled(tmp_path):
    wrong = apply(PAPER, "gyro_scale", k=0.008)  # less than what gets a name
    path = hidden_drive.write(tmp_path / "car_1_a.csv", wrong, 1, hidden_drive.Plan(seconds=30.0))
    of_drive = make_evidence([read(path)], PAPER.body.l_r)[0]
    runs = [replace(d, recording=replace(d.recording, schema=RUN)) for d in of_drive.drives]
    at, mounting = fit_mounting_of(type(of_drive)(runs, PAPER.body.l_r))
    assert at.names == ("gyro_scale",)
    number = mounting["gyro_scale"]["k"]
    assert 0.0 < number.std < 0.004
    assert number.value == pytest.approx(0.008, abs=3.0 * number.std)


@pytest.mark.slow
def test_poses_of_a_run_may_be_as_late_as_those_of_an_optical_system(tmp_path):
    late = apply(PAPER, "mocap_latency", k=0.02)
    path = hidden_drive.write(tmp_path / "car_1_a.csv", late, 1, hidden_drive.Plan(seconds=30.0))
    published = make_evidence([read(path)], PAPER.body.l_r)[0]
    own = type(published)([replace(d, recording=replace(d.recording, schema=RUN))
                           for d in published.drives], PAPER.body.l_r)

    def fit_timing(of_drive):
        space = Space(PAPER, (), message_age=of_drive.message_age)
        start = MessageTiming(of_drive.message_age)
        noise = estimate_noise(of_drive.residuals(PAPER, start), of_drive.blocks())
        return refit(of_drive, noise, space, space.point(start)).timing.message_age

    age = 0.0035  # a message is heard 1 to 6 ms late
    assert fit_timing(own) == pytest.approx(age - 0.02, abs=0.001)
    assert fit_timing(published) == pytest.approx(MESSAGE_AGE - MESSAGE_AGE_REACH, abs=1e-6)


def test_the_extended_model_carries_it_with_its_error():
    file, _ = find_model("paper")
    d = replace(made.diagnosis("parameters_only", 0, False),
                mounting={"imu_yaw": {"k": ParameterEstimate(0.04, 0.001, "rad")}})
    model = extended_model(d, file, [])
    entry = next(e for e in model.effects if e.name == "imu_yaw")
    assert (entry.parameters["k"].value, entry.parameters["k"].std) == (0.04, 0.001)
    assert [a.values for a in vehicle_from(model).effects if a.name == "imu_yaw"] == [(0.04,)]
    assert d.to_json()["mounting"] == {
        "imu_yaw": {"k": {"value": 0.04, "std": 0.001, "unit": "rad", "null": 0.0}}}
