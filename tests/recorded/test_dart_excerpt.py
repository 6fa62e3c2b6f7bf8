"""What real recordings of every schema must give, on the committed excerpt."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.recording.dart import grid, read, read_all, reference_for


def read_part(excerpt, part: str):
    return read(next(excerpt.rglob(f"*{part}*.csv.gz")))


@pytest.mark.slow
def test_every_file_of_the_excerpt_reads(excerpt):
    recordings, skipped = read_all([excerpt])
    assert not skipped
    assert {r.schema for r in recordings} == {"A", "B", "C"}
    assert (excerpt / "LICENSE").read_text().startswith("MIT License")


def test_excerpt_is_small(excerpt):
    assert sum(f.stat().st_size for f in excerpt.rglob("*") if f.is_file()) < 2_000_000


@pytest.mark.parametrize(("part", "quantum"), [
    ("01_22_2024_12_05_14", 0.0516), ("01_24_2024_16_43_29", 0.02294),
    ("racetrack_lap_v060", 0.0412708), ("01_22_2024_15_01_37", 0.0516)])
def test_encoder_quantum_of_each_campaign(excerpt, part, quantum):
    assert read_part(excerpt, part).quantum == pytest.approx(quantum, rel=2e-3)


def test_gate_of_a_real_file(excerpt):
    m = read_part(excerpt, "15_01_37").messages
    closed = (m.throttle_raw != 0.0) & ~m.gate
    assert closed.sum() == 10
    assert np.all(m.throttle[closed] == 0.0)


def test_leading_rows_of_a_real_file(excerpt):
    recording = read_part(excerpt, "10_00_45")
    assert any(n.rows == 11 and "before the first" in n.why for n in recording.notes)


def test_false_lock_of_the_race_track(excerpt):
    g = grid(read_part(excerpt, "racetrack"))
    locked = (g.t > 5.7) & (g.t < 8.5)
    assert g.bad[locked].all()
    assert not g.bad[(g.t > 2.0) & (g.t < 4.4)].any()
    speed = np.hypot(np.diff(g.x), np.diff(g.y))[locked[1:]] / 0.01
    assert np.median(speed) < 0.05
    assert np.median(g.encoder[locked]) > 0.25


def test_dead_encoder_of_27_september(excerpt):
    recording = read_part(excerpt, "12_06_55")
    assert recording.encoder == "dead"
    g = grid(recording)
    assert g.v_x[~g.bad].max() > 0.3


def test_outlier_of_4_april(excerpt):
    recording = read_part(excerpt, "2025-04-04")
    assert recording.mocap.t[recording.mocap.outlier] == pytest.approx([2.2106], abs=1e-3)
    assert recording.encoder == "none"
    assert np.isnan(recording.messages.speed).all()


def test_20_hz_recording_gets_a_spline(excerpt):
    recording = read_part(excerpt, "2025-04-24")
    g = grid(recording)
    assert np.median(np.diff(recording.mocap.t)) == pytest.approx(0.05, abs=2e-3)
    assert np.diff(g.t) == pytest.approx(0.01)
    at = np.interp(recording.mocap.t, g.t, np.hypot(g.x, g.y))
    raw = np.hypot(recording.mocap.x, recording.mocap.y)
    assert np.abs(at - raw)[2:-2].max() < 0.02


@pytest.mark.slow
def test_reference_points_by_date(excerpt):
    assert reference_for(read_part(excerpt, "racetrack")).lx == 0.0862
    assert reference_for(read_part(excerpt, "12_06_55")).lx == 0.1150
    assert reference_for(read_part(excerpt, "2025-04-24")).lx == 0.0930
    assert reference_for(read_part(excerpt, "12_05_14")) is None
