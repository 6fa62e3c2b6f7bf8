"""Each trap of a DART recording on a file made for it; the naive reading must differ."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.recording.dart import Reference, encoder_quantum, grid, read, read_all
from dart_hal.recording.dart.mocap import outliers, unwrap
from dart_hal.recording.dart.reference import SEP_24, fit_reference


def has_note(recording, words: str) -> bool:
    return any(words in str(note) for note in recording.notes)


def test_throttle_behind_a_closed_gate_is_zero_and_steering_is_not(write, table_a):
    table = table_a()
    table["safety_value"][10:25] = 0.0
    m = read(write(table)).messages
    assert np.all(m.throttle[10:25] == 0.0)
    assert np.all(m.throttle[~m.gate] == 0.0)
    assert np.all(m.throttle_raw == 0.25)
    assert np.all(m.steering == 0.3)
    assert m.gate.sum() == 45


def test_rows_before_the_first_message_are_dropped_first(write, table_b):
    table = table_b()
    for name in list(table)[:10]:
        table[name][:11] = 0.0
    recording = read(write(table))
    assert has_note(recording, "before the first sensor message: 11")
    assert recording.messages.t[0] > 0.0
    assert len(recording.mocap) == 589
    assert recording.mocap.epoch == pytest.approx(table["vicon time"][11])


def test_held_copies_are_not_data(write, table_b):
    table = table_b()
    recording = read(write(table))
    assert len(recording.messages) == 60
    assert np.all(np.diff(recording.messages.t) > 0.05)
    naive = np.diff(table["vel encoder"]) / 0.01
    assert np.mean(naive == 0.0) > 0.85  # what a derivative of the held column would give


def test_arrival_is_the_stamp_of_the_first_changed_row(write, table_b):
    recording = read(write(table_b()))
    assert recording.messages.arrival == pytest.approx(0.1 * np.arange(60), abs=1e-6)


def test_a_message_counts_from_its_own_grid_sample_on(write, table_b):
    g = grid(read(write(table_b())), SEP_24)
    first = 0.05161 * 10
    assert g.encoder[0] == pytest.approx(first)
    assert g.encoder[9] == pytest.approx(first)
    assert g.encoder[10] == pytest.approx(0.05161 * 11)


def test_false_lock_is_detected_against_the_encoder(write, table_b):
    table = table_b()
    rng = np.random.default_rng(1)
    for name in ("vicon x", "vicon y"):
        table[name][200:400] = -4.97 + 1e-4 * rng.normal(size=200)
    recording = read(write(table))
    assert has_note(recording, "false lock")
    bad = grid(recording, SEP_24).bad
    assert bad[185:415].all()
    assert not bad[:160].any()
    locked = table_b()
    for name in ("vicon x", "vicon y", "vicon yaw"):
        locked[name][:] = 1.0
    locked["vel encoder"][:] = 0.0
    assert not has_note(read(write(locked, "standing.csv")), "false lock")


def test_a_pause_of_the_recording_is_no_false_lock(write, table_b):
    """The last speed of the encoder holds in it, and the pose hardly moves between its ends."""
    table = table_b()
    for name in table:
        if "time" in name:
            table[name][300:] += 10.0
    recording = read(write(table))
    assert grid(recording, SEP_24).t[-1] > 15.0, "the pause is in the recording"
    assert not has_note(recording, "false lock")


def test_outlier_is_marked_and_does_not_turn_the_yaw(write, table_b):
    table = table_b(speed=1.0)
    table["vicon yaw"][300:302] += 3.5  # beyond pi: a plain unwrap keeps a turn of 2 pi
    recording = read(write(table))
    assert has_note(recording, "outliers of 1 to 3 rows, marked: 2")
    assert list(np.flatnonzero(recording.mocap.outlier)) == [300, 301]
    good = ~recording.mocap.outlier
    assert recording.mocap.yaw[good] == pytest.approx(0.01 * np.arange(600)[good], abs=1e-9)
    assert grid(recording, SEP_24).bad[299:303].all()


def test_real_motion_over_a_gap_is_no_outlier():
    t = np.concatenate([0.01 * np.arange(50), 0.55 + 0.01 * np.arange(50)])
    x = 3.5 * t  # 0.21 m within the 60 ms gap
    flat = np.zeros_like(t)
    assert not outliers(t, x, flat, flat).any()
    assert outliers(0.01 * np.arange(100), np.where(np.arange(100) == 50, 0.5, 0.0), flat,
                    flat).sum() == 1


def test_inside_a_mocap_gap_nothing_is_used(write, table_b):
    table = {k: np.delete(v, range(300, 308)) for k, v in table_b().items()}
    recording = read(write(table))
    assert has_note(recording, "mocap gap(s)")
    bad = grid(recording, SEP_24).bad
    assert bad[281:326].all()
    assert not bad[:270].any()


def test_lost_messages_are_not_bridged(write, table_b):
    table = table_b()
    for name in list(table)[:10]:
        table[name][300:350] = table[name][299]
    recording = read(write(table))
    assert recording.messages.segment[-1] == 1
    bad = grid(recording, SEP_24).bad
    assert bad[325:345].all()  # older than 0.3 s from sample 321 on
    assert not bad[:290].any()


def test_time_running_backwards_is_cut_and_not_sorted(write, table_a):
    table = table_a()
    table["elapsed time sensors"][30:] -= 50.0
    table["vel encoder"][:30], table["vel encoder"][30:] = 0.5161, 1.0322
    m = read(write(table)).messages
    assert np.all(np.diff(m.t) > 0.0)
    assert list(np.unique(m.segment)) == [0, 1]
    assert np.all(m.speed[:30] == 0.5161)  # sorting would put the second half first
    assert np.argmax(np.diff(m.segment)) == 29


def test_mocap_time_running_backwards_marks_a_gap(write, table_b):
    table = table_b()
    table["vicon time"][300:] -= 100.0
    recording = read(write(table))
    assert has_note(recording, "mocap time steps back")
    assert np.all(np.diff(recording.mocap.t) > 0.0)
    assert len(recording.mocap) == 600
    assert grid(recording, SEP_24).bad[310:390].all()


def test_encoder_always_zero_is_dead_only_if_the_car_moved(write, table_b, table_a):
    table = table_b()
    table["vel encoder"][:] = 0.0
    dead = read(write(table))
    assert dead.encoder == "dead"
    assert np.isnan(dead.messages.speed).all()
    for name in ("vicon x", "vicon y", "vicon yaw"):
        table[name][:] = 0.3
    assert read(write(table, "standing.csv")).encoder == "zero"
    table = table_a()
    table["vel encoder"][:] = 0.0
    alone = read(write(table, "alone.csv"))
    assert alone.encoder == "zero"
    assert np.all(alone.messages.speed == 0.0)


@pytest.mark.parametrize("quantum", [0.0516150, 0.02294, 0.0412708, 0.020646])
@pytest.mark.parametrize("decimals", [2, 9])
def test_encoder_quantum_is_found(quantum, decimals):
    rng = np.random.default_rng(3)
    counts = rng.integers(0, 40, 300)
    speed = np.round(counts * quantum, decimals)
    assert encoder_quantum(speed) == pytest.approx(quantum, rel=5e-3)


@pytest.mark.slow
def test_encoder_quantum_is_not_invented():
    assert encoder_quantum(np.random.default_rng(4).uniform(0.0, 2.0, 300)) is None
    assert encoder_quantum(np.array([0.0, 0.0, 0.05])) is None


def test_negative_zero_is_zero(write, table_a):
    table = table_a()
    table["steering"][:] = -0.0
    assert not np.signbit(read(write(table)).messages.steering).any()


def test_never_measured_columns_are_dropped_and_reported(write, table_a):
    recording = read(write(table_a()))
    assert has_note(recording, "current and voltage are zero")
    assert not hasattr(recording.messages, "voltage")


def test_unwrap_needs_the_outliers_removed_first():
    yaw = np.zeros(20)
    outlier = np.zeros(20, dtype=bool)
    yaw[10], outlier[10] = 4.0, True
    assert unwrap(yaw, outlier)[-1] == 0.0
    wrapped = (0.3 * np.arange(40) + np.pi) % (2.0 * np.pi) - np.pi
    assert unwrap(wrapped, np.zeros(40, dtype=bool)) == pytest.approx(0.3 * np.arange(40))


def test_arrays_are_read_only(write, table_b):
    recording = read(write(table_b()))
    for array in (recording.messages.speed, recording.mocap.x, grid(recording, SEP_24).v_x):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_velocities_of_a_circle(write, table_b):
    """Marker at (L_x, L_y) on a circle of the marker: body velocities follow by geometry."""
    recording = read(write(table_b(radius=1.0, speed=0.5)))
    g = grid(recording, SEP_24, l_r=0.0945)
    middle = slice(50, 500)
    assert g.omega[middle] == pytest.approx(0.5, abs=1e-4)
    v_x = 0.5 * np.cos(SEP_24.theta) + 0.5 * SEP_24.ly
    v_y = -0.5 * np.sin(SEP_24.theta) + 0.5 * (0.0945 - SEP_24.lx)
    assert g.v_x[middle] == pytest.approx(v_x, abs=1e-4)
    assert g.v_y[middle] == pytest.approx(v_y, abs=1e-4)


def test_one_constant_circle_does_not_fix_the_reference_point(write, table_b):
    assert fit_reference([read(write(table_b(n=1500)))]) is None


def test_a_single_lost_message_is_reported_and_does_not_cut(write, table_a):
    table = {k: np.delete(v, 30) for k, v in table_a().items()}
    recording = read(write(table))
    assert has_note(recording, "messages lost")
    assert np.all(recording.messages.segment == 0)
    assert np.diff(recording.messages.t)[29] == pytest.approx(0.2)


def test_speeds_of_two_decimals_keep_their_quantum_and_their_values(write, table_a):
    table = table_a()
    table["vel encoder"] = np.round(table["vel encoder"], 2)
    recording = read(write(table))
    assert recording.quantum == pytest.approx(0.05161, rel=5e-3)
    assert np.array_equal(recording.messages.speed, table["vel encoder"])


def rows_c(table_b) -> dict[str, np.ndarray]:
    table = {k: v for k, v in table_b().items() if k.startswith("vicon")}
    table["vicon time"] -= table["vicon time"][0]
    one = np.ones(len(table["vicon time"]))
    return {**table, "throttle": 0.3 * one, "steering": 0.2 * one, "safety_value": one}


def test_derived_columns_of_schema_c_are_not_believed(write, table_b):
    plain = rows_c(table_b)
    noise = np.random.default_rng(6).normal(size=600)
    derived = {**plain, "w": noise, "vx body": noise, "unwrapped yaw": noise}
    with_them = read(write(derived, "derived.csv"))
    assert with_them.schema == "C"
    assert has_note(with_them, "derived columns")
    without = read(write(plain, "plain.csv"))
    assert not has_note(without, "derived columns")
    frame = Reference(0.1, 0.0, 0.0, "of this test")
    a = grid(with_them, frame)
    b = grid(without, frame)
    assert np.array_equal(a.v_x, b.v_x)
    assert np.array_equal(a.omega, b.omega)


def test_files_are_never_joined(write, table_a, tmp_path):
    slow = table_a(t0=100.0)
    fast = table_a(t0=106.0)
    slow["vel encoder"][:], fast["vel encoder"][:] = 0.5161, 2.0644
    write(slow, "a.csv")
    write(fast, "b.csv")
    recordings, _ = read_all([tmp_path])
    inside = [np.abs(np.diff(r.messages.speed) / np.diff(r.messages.t)).max() for r in recordings]
    assert inside == [0.0, 0.0]
    speed = np.concatenate([r.messages.speed for r in recordings])
    assert np.abs(np.diff(speed)).max() / 0.1 > 15.0  # what a joined series would invent


def test_ground_speed_is_the_mocaps_where_the_wheels_spin(write, table_b):
    table = table_b(radius=1.0, speed=0.5)
    spun = {**table, "vel encoder": 4.0 * table["vel encoder"]}
    a, b = (grid(read(write(t, name)), SEP_24)
            for t, name in ((table, "grip.csv"), (spun, "spin.csv")))
    assert np.array_equal(a.v_x, b.v_x)
    assert b.encoder[100] == pytest.approx(4.0 * a.encoder[100])
