"""Bad input of a diagnosis: refused, or reported, in words that name what is wrong."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from dart_hal.core.config import Quantity, plain
from dart_hal.core.errors import DartHalError, OtherCar, RecordingError, UsageError
from dart_hal.recording.dart import BatteryVoltage
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.file import model_of
from dart_lab.diagnosis.agreement import check_model, check_units, ratio, slope
from dart_lab.diagnosis.inputs import check_inputs, select_effects, warn_fitted_before
from dart_lab.diagnosis.motion import driving_seconds
from dart_lab.diagnosis.run import diagnose
from dart_lab.diagnosis.split import GUARD_S
from dart_lab.identification.evaluation import evaluate
from dart_lab.identification.evidence.drive import prepare_drive
from studies.diagnosis.known_frame import read
from tests.common import EXCERPT
from tests.diagnosis import made_by_hand as made


@pytest.fixture(scope="module")
def drive():
    return made.recording()


def test_a_voltage_that_not_all_recordings_have_is_not_used(drive):
    battery = BatteryVoltage(np.array([0.0, 60.0]), np.array([8.0, 7.5]))
    with_it = replace(drive, battery=battery)
    one_without = check_inputs([with_it], [other(drive)], PAPER)
    assert one_without.train[0].battery is None
    assert any("1 of 2 recordings" in note for note in one_without.notes)
    both = check_inputs([with_it], [other(with_it)], PAPER)
    assert both.train[0].battery is both.test[0].battery is battery
    assert not any("voltage" in note for note in both.notes)


def test_stretches_in_which_the_esc_brakes_are_left_out_and_stated(drive):
    messages = drive.messages
    brakes = (messages.arrival > 20.0) & (messages.arrival < 24.0)
    braking = replace(drive, messages=replace(
        messages, throttle=np.where(brakes, -0.3, messages.throttle)))
    word = "no model describes the brake of an ESC"
    for recording, stated in ((braking, True), (drive, False)):
        notes = check_inputs([recording], [other(recording)], PAPER).notes
        assert any(word in note for note in notes) == stated
    starts = [prepare_drive(r, PAPER.body.l_r).starts for r in (drive, braking)]
    assert 0 < len(starts[1]) < len(starts[0]) - 2


@pytest.mark.slow_except("None-True*")
@pytest.mark.parametrize(("motor_voltage", "measured", "expected"), [
    (None, True, "the model states no motor_voltage"),
    (7.4, False, "the motor is that of 7.4 V"), (None, False, ""), (7.4, True, "")])
def test_a_battery_fade_of_the_other_law_is_stated(drive, motor_voltage, measured, expected):
    battery = BatteryVoltage(np.array([0.0, 60.0]), np.array([8.0, 7.5])) if measured else None
    recording = replace(drive, battery=battery)
    fading = replace(apply(PAPER, "battery_fade", k=-0.1), motor_voltage=motor_voltage)
    for notes in (check_inputs([recording], [other(recording)], fading).notes,
                  evaluate(fading, [recording], limit=False).notes):
        assert [expected in note for note in notes] == [True] * bool(expected)
    assert evaluate(PAPER, [recording], limit=False).notes == ()


def other(recording, name="car_1_other.csv"):
    """The same drive as if it were another one, 1000 s later."""
    later = replace(recording.messages, t=recording.messages.t + 1000.0)
    return replace(recording, path=recording.path.with_name(name), sha256="f" * 64, messages=later)


def scale_column(tmp_path, recording, column, factor, offset=0.0):
    """The recording with one column of its file changed."""
    lines = recording.path.read_text().splitlines()
    at = lines[0].split(",").index(column)
    rows = [line.split(",") for line in lines[1:]]
    for row in rows:
        row[at] = repr(float(row[at]) * factor + offset)
    path = tmp_path / "car_1_changed.csv"
    path.write_text("\r\n".join([lines[0], *(",".join(row) for row in rows)]) + "\r\n")
    return path


def test_a_sound_pair_passes_without_a_word(drive):
    inputs = check_inputs([drive], [other(drive)], PAPER)
    assert inputs.notes == ()
    assert inputs.train == (drive,)


def test_train_equal_to_test_is_refused_even_under_another_name(drive, tmp_path):
    copy = tmp_path / "renamed.csv"
    shutil.copy(drive.path, copy)
    with pytest.raises(UsageError, match="the test recordings are the training recordings"):
        check_inputs([drive], [read(copy)], PAPER)
    with pytest.raises(UsageError, match="1 recording"):
        check_inputs([drive, other(drive)], [drive], PAPER)


def test_a_part_of_a_training_recording_is_refused(drive, tmp_path):
    lines = drive.path.read_text().splitlines()
    part = tmp_path / "second_half.csv"
    part.write_text("\r\n".join([lines[0], *lines[len(lines) // 2:]]) + "\r\n")
    with pytest.raises(UsageError, match="1 recording") as refused:
        check_inputs([drive], [read(part)], PAPER)
    assert "parts of one file" in refused.value.likely


@pytest.mark.slow
def test_a_copy_among_the_training_recordings_counts_once(drive, tmp_path):
    copy = tmp_path / "car_1_copy.csv"
    shutil.copy(drive.path, copy)
    inputs = check_inputs([drive, read(copy)], [other(drive)], PAPER)
    assert inputs.train == (drive,)
    assert "car_1_copy.csv" in inputs.notes[0]


@pytest.mark.slow_except("vicon x-*")
@pytest.mark.parametrize(("column", "factor"), [
    ("vicon x", 1000.0), ("vel encoder", 1000.0), ("vel encoder", 0.001), ("vel encoder", 3.6),
    ("vel encoder", 100.0), ("vel encoder", -1.0), ("W (IMU)", 57.2958), ("W (IMU)", 0.001),
    ("W (IMU)", 1000.0), ("W (IMU)", -1.0), ("vicon yaw", 57.2958), ("acc y (IMU)", 1 / 9.81),
    ("acc y (IMU)", 1000.0), ("elapsed time sensors", 1000.0)])
def test_a_wrong_unit_is_refused_by_column(drive, tmp_path, column, factor):
    with pytest.raises(RecordingError) as refused:
        check_units(read(scale_column(tmp_path, drive, column, factor)))
    assert column in refused.value.what
    assert "divide the column by" in refused.value.remedy


@pytest.mark.slow
def test_the_factor_is_named(drive, tmp_path):
    path = scale_column(tmp_path, drive, "vel encoder", 0.001)
    with pytest.raises(RecordingError, match="vel encoder") as refused:
        check_units(read(path))
    assert "divide the column by 0.001" in refused.value.remedy
    assert "km" in refused.value.likely


def test_positions_in_km_look_like_standstill_and_are_refused(drive, tmp_path):
    path = scale_column(tmp_path, drive, "vicon x", 0.001)
    path = scale_column(tmp_path, replace(drive, path=path), "vicon y", 0.001)
    with pytest.raises(RecordingError):
        check_inputs([read(path)], [], PAPER)


@pytest.mark.parametrize(("column", "factor"), [
    ("vel encoder", 1.06), ("W (IMU)", 0.9), ("acc y (IMU)", 1.2)])
@pytest.mark.slow_except("W (IMU)*")
def test_what_an_effect_may_do_passes(drive, tmp_path, column, factor):
    check_units(read(scale_column(tmp_path, drive, column, factor)))


def test_a_dead_encoder_is_reported_and_not_judged(drive, tmp_path):
    dead = read(scale_column(tmp_path, drive, "vel encoder", 0.0))
    inputs = check_inputs([dead], [other(drive)], PAPER)
    assert "encoder is dead" in " ".join(inputs.notes)
    assert not np.isfinite(prepare_drive(inputs.train[0], PAPER.body.l_r).readings[:, 0]).any()


@pytest.mark.slow
def test_a_dead_gyro_is_reported_and_not_judged(drive, tmp_path):
    dead = read(scale_column(tmp_path, drive, "W (IMU)", 0.0))
    inputs = check_inputs([dead], [other(drive)], PAPER)
    assert "gyro is dead" in " ".join(inputs.notes)
    found = prepare_drive(inputs.train[0], PAPER.body.l_r).readings
    assert not np.isfinite(found[:, 1]).any()
    assert np.isfinite(found[:, 0]).all()


def test_without_mocap_it_is_reported_what_cannot_be_known(drive):
    bare = [replace(r, mocap=None, schema="A") for r in (drive, other(drive))]
    inputs = check_inputs(bare[:1], bare[1:], PAPER)
    assert any("no motion capture" in n and "side slip" in n for n in inputs.notes)
    mixed = check_inputs([drive, replace(other(drive), mocap=None)], [], PAPER)
    assert [r.name for r in mixed.train] == [drive.name]
    assert "left out" in mixed.notes[0]


def test_mocap_on_one_side_alone_is_of_no_use(drive):
    bare = replace(drive, mocap=None, schema="A")
    inputs = check_inputs([bare], [other(drive)], PAPER)
    assert [r.mocap for r in (*inputs.train, *inputs.test)] == [None, None]


def test_neither_mocap_nor_encoder_is_refused(drive):
    blind = replace(drive, mocap=None, schema="A", encoder="zero")
    with pytest.raises(RecordingError, match="neither motion capture nor a working encoder"):
        check_inputs([blind], [], PAPER)


def test_a_car_at_rest_is_refused(drive):
    m = drive.mocap
    still = replace(drive, mocap=replace(m, x=0 * m.x, y=0 * m.y, yaw=0 * m.yaw),
                    messages=replace(drive.messages, speed=0 * drive.messages.speed,
                                     yaw_rate=0 * drive.messages.yaw_rate))
    with pytest.raises(RecordingError, match="does not drive"):
        check_inputs([still], [], PAPER)
    second = replace(other(drive), mocap=still.mocap, messages=still.messages)
    cautions = check_inputs([drive, second], [], PAPER)
    assert len(cautions.train) == 1
    assert any("at rest" in n for n in cautions.notes)


def first_part(drive, share):
    begin, end = drive.messages.arrival[[0, -1]].tolist()
    return replace(drive, spans=((begin, begin + share * (end - begin)),))


def test_a_short_drive_is_refused_and_a_meagre_one_is_reported(drive):
    with pytest.raises(RecordingError, match="too little driving to train on"):
        check_inputs([first_part(drive, 0.1)], [other(drive)], PAPER)
    with pytest.raises(RecordingError, match="too little driving to test"):
        check_inputs([drive], [other(first_part(drive, 0.04))], PAPER)
    meagre = check_inputs([first_part(drive, 0.4)], [other(drive)], PAPER)
    assert any("small effects" in n for n in meagre.notes)


def test_a_model_that_steers_the_other_way_is_another_cars(drive):
    mirrored = replace(drive, messages=replace(drive.messages, steering=-drive.messages.steering))
    with pytest.raises(OtherCar, match="other side"):
        check_model([mirrored], PAPER)


def test_a_model_that_turns_much_more_is_doubted_and_its_own_is_not(drive):
    b = PAPER.body
    long = replace(PAPER, body=replace(b, wheelbase=3 * b.wheelbase, l_f=3 * b.l_f, l_r=3 * b.l_r))
    warnings = check_model([drive], long)
    assert len(warnings) == 1
    assert re.search(r"turns (2\.[5-9]|3\.[0-3])\d times", warnings[0])
    assert check_model([drive], PAPER) == []


def test_without_test_recordings_stretches_are_held_out(drive):
    inputs = check_inputs([drive], [], PAPER)
    train = inputs.train[0]
    test = inputs.test[0]
    assert any("40 %" in n for n in inputs.notes)
    a, b = (prepare_drive(r, PAPER.body.l_r) for r in (train, test))
    whole = prepare_drive(drive, PAPER.body.l_r)
    assert set(a.starts) | set(b.starts) <= set(whole.starts)  # the clock has stayed
    distances = np.abs(a.starts[:, None] - b.starts[None, :]).min()
    # a window of one side ends before one of the other starts
    assert distances * 0.01 > 1.0 + GUARD_S
    assert len(a.starts) + len(b.starts) > 0.6 * len(whole.starts)
    np.testing.assert_allclose(b.grid.v_x, whole.grid.v_x)  # commands and motion are whole
    assert driving_seconds(test) == pytest.approx(0.4 * driving_seconds(drive), rel=0.3)
    assert test.messages is drive.messages


def test_a_model_fitted_to_the_test_recordings_is_reported(drive):
    assert "fitted to 1 of the test recordings" in warn_fitted_before([drive], {drive.sha256})[0]
    assert warn_fitted_before([drive], {"0" * 64}) == []


@pytest.mark.slow
def test_errors_from_the_training_recordings_are_no_prior(drive):
    """As a prior they would count these recordings twice: the refit would state smaller errors."""
    base = model_of(PAPER)
    model = msgspec.structs.replace(base, **{section: {
        key: Quantity(plain(entry), 0.02 * abs(plain(entry)) + 1e-4)
        for key, entry in getattr(base, section).items()}
        for section in ("friction", "motor", "steering", "tyres")})
    fitted = msgspec.structs.replace(model, provenance={"files": {"drive": drive.sha256}})
    inputs = check_inputs([drive], [], PAPER)
    once, again = (diagnose(file, PAPER, inputs.train, inputs.test, only=("grip",))
                   for file in (model, fitted))
    assert ["count twice" in " ".join(d.notes) for d in (once, again)] == [False, True]
    assert again.refitted.keys() == once.refitted.keys()
    assert np.median([once.refitted[name].std / again.refitted[name].std
                      for name in once.refitted]) < 0.9, "negative control: as a prior they count"


def test_effects_are_named_as_in_the_catalogue():
    assert select_effects(["grip"], []) == ("grip",)
    assert "grip" not in select_effects([], ["grip"])
    assert len(select_effects([], [])) > 40
    with pytest.raises(UsageError, match="steering_lug") as unknown:
        select_effects(["steering_lug"], [])
    assert "steering_lag" in unknown.value.remedy
    with pytest.raises(UsageError, match="no effect is left"):
        select_effects(["grip"], ["grip"])


@pytest.mark.slow
def test_the_recordings_of_the_real_car_are_not_refused_for_their_units():
    found = 0
    for path in sorted(EXCERPT.rglob("*.csv*")):
        try:
            recording = read(path)
        except DartHalError:
            continue
        check_units(recording)
        check_model([recording], PAPER)
        found += 1
    assert found > 5


def test_a_ratio_needs_to_be_one_and_a_slope_a_line():
    x = np.linspace(0.5, 2.0, 50)
    assert ratio(3.6 * x, x) == pytest.approx(3.6)
    assert ratio(-x, x) == pytest.approx(-1.0)
    assert np.isnan(ratio(np.where(np.arange(50) % 2, 1.0, 5.0), x))
    assert slope(2.0 * x + 7.0, x) == pytest.approx(2.0)
    assert np.isnan(slope(np.cos(40 * x), x))
