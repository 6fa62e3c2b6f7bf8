"""No window holds or crosses a gap of the mocap or of the messages, in any schema."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.recording.dart import grid, marker, read
from dart_hal.recording.dart.sensors import MAX_MESSAGE_GAP
from dart_lab.identification.prediction.windows import CLEAN_BEFORE, CLEAN_SAMPLES, find_windows
from tests.recorded.simulated_recording import simulate_recording, table_of, write_table

EDGE_S = 1e-6  # s


def cut_gaps(table: dict[str, np.ndarray], gaps) -> dict[str, np.ndarray]:
    """The table without the rows between ``gaps`` (start, end) [s] of its mocap clock."""
    t = table["vicon time"] - table["vicon time"][0]
    keep = np.ones(len(t), dtype=bool)
    for start, end in gaps:
        keep &= (t < start) | (t >= end)
    return {name: column[keep] for name, column in table.items()}


def windows_of(path, frame):
    g = grid(read(path), frame)
    return g, find_windows(g).start


def assert_clean(g, starts, gaps, first: float = 0.0) -> None:
    """first [s]: how much of the start of the recording is missing, where its clock begins."""
    for start, end in gaps:
        low = start - first
        high = end - first
        inside = (g.t > low + EDGE_S) & (g.t < high - EDGE_S)
        assert g.bad[inside].all(), "samples of a gap are bad"
        begin = g.t[starts - CLEAN_BEFORE]
        finish = g.t[np.minimum(starts + CLEAN_SAMPLES, len(g) - 1)]
        assert not ((begin < high) & (finish > low)).any(), "no window reaches into a gap"


@pytest.fixture(scope="module")
def driven():
    return simulate_recording(11, seconds=40.0)


@pytest.mark.parametrize("schema", ["B", "C"])
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.slow_except("0-C")
def test_random_gaps_of_the_mocap_are_in_no_window(driven, tmp_path, schema, seed):
    recording, frame = driven
    rng = np.random.default_rng(seed)
    starts = np.sort(rng.uniform(1.0, 38.0, 4))
    gaps = [(s, s + rng.uniform(0.08, 1.5)) for s in starts]
    g, windows = windows_of(write_table(cut_gaps(table_of(recording, schema), gaps),
                                        tmp_path / "gaps.csv"), frame)
    assert len(windows) > 10
    assert_clean(g, windows, gaps)


@pytest.mark.parametrize("schema", ["B", "C"])
def test_gaps_at_the_start_and_the_end_are_in_no_window(driven, tmp_path, schema):
    recording, frame = driven
    gaps = [(0.05, 3.0), (36.0, 39.9)]
    g, windows = windows_of(write_table(cut_gaps(table_of(recording, schema), gaps),
                                        tmp_path / "ends.csv"), frame)
    assert len(windows) > 10
    assert_clean(g, windows, gaps)


def test_windows_reach_into_gaps_when_gaps_are_not_looked_for(driven, tmp_path, monkeypatch):
    """Negative control: schema C once marked nothing in a gap as bad."""
    recording, frame = driven
    gaps = [(12.0, 12.2), (20.0, 21.0)]
    path = write_table(cut_gaps(table_of(recording), gaps), tmp_path / "gaps.csv")
    monkeypatch.setattr(marker, "_in_gap", lambda t, stamp: np.zeros(len(t), dtype=bool))
    monkeypatch.setattr(marker, "MAX_MESSAGE_GAP", 1e9)
    g, windows = windows_of(path, frame)
    with pytest.raises(AssertionError):
        assert_clean(g, windows, gaps)


@pytest.mark.parametrize("schema", ["B", "C"])
@pytest.mark.slow_except("C")
def test_repeated_rows_and_single_lost_rows_are_no_gap(driven, tmp_path, schema):
    recording, frame = driven
    table = table_of(recording, schema)
    rng = np.random.default_rng(4)
    n = len(table["vicon time"])
    twice = np.sort(np.concatenate([np.arange(n), rng.choice(n, 200, replace=False)]))
    keep = np.ones(n, dtype=bool)
    keep[rng.choice(np.arange(10, n - 10, 7), 100, replace=False)] = False
    whole = windows_of(write_table(table, tmp_path / "whole.csv"), frame)[1]
    for name, rows in (("twice", twice), ("lost", np.flatnonzero(keep))):
        changed = {c: v[rows] for c, v in table.items()}
        assert np.array_equal(
            windows_of(write_table(changed, tmp_path / f"{name}.csv"), frame)[1], whole)


@pytest.mark.slow
def test_silent_sensors_are_a_gap_although_the_mocap_goes_on(driven, tmp_path):
    """Commands, encoder and IMU of schema B come with the messages: none for a second."""
    recording, frame = driven
    table = table_of(recording, "B")
    t = table["vicon time"] - table["vicon time"][0]
    silent = (t >= 15.0) & (t < 16.0)
    last = int(np.flatnonzero(silent)[0]) - 1
    for name in table:
        if not name.startswith("vicon"):
            table[name][silent] = table[name][last]
    g, windows = windows_of(write_table(table, tmp_path / "silent.csv"), frame)
    assert_clean(g, windows, [(15.1 + MAX_MESSAGE_GAP, 16.0)])


def test_silent_commands_of_a_run_are_a_gap(driven):
    recording, frame = driven
    m = recording.messages
    keep = (m.t < 15.0) | (m.t >= 16.5)
    thinned = replace(m, **{name: getattr(m, name)[keep] for name in (
        "t", "arrival", "segment", "throttle", "throttle_raw", "steering", "gate", "speed",
        "yaw_rate", "accel_x", "accel_y")})
    for schema in ("B", "C", "run"):
        g = grid(replace(recording, messages=thinned, schema=schema), frame)
        assert_clean(g, find_windows(g).start, [(15.0 + MAX_MESSAGE_GAP, 16.4)])
