"""Recordings of different days in one map are named; those of one day are not."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import numpy as np
import pytest

from dart_hal.calibration.from_recordings import FileNote, merge_notes, steering_from_recordings
from dart_hal.calibration.sessions import cautions, day_of, make_groups
from dart_hal.recording.dart import Messages, Note, Recording
from dart_hal.vehicle.sets import PAPER
from dart_hal.vehicle.steering import make_steering


@pytest.fixture
def recorded():
    """``recorded(path, trim)`` -> a recording of held levels with the paper's map plus a trim."""
    def make(path: str, trim_deg: float = 0.0, seed: int = 0, speed: float = 1.0) -> Recording:
        command = np.repeat(np.linspace(-0.8, 0.8, 17), 50)
        n = len(command)
        noise = np.random.default_rng(seed).normal(0.0, 0.02, n)
        angle = make_steering(PAPER.steering, np)(command) + np.radians(trim_deg) + noise
        t, ones, zeros = 0.1 * np.arange(n), np.ones(n), np.zeros(n)
        messages = Messages(t, t, np.zeros(n, dtype=np.int64), 0.2 * ones, 0.2 * ones, command,
                            ones > 0, speed * ones, speed * np.tan(angle) / 0.175, zeros, zeros)
        return Recording(Path(path), "A", messages, None, "ok", None, "",
                         (Note("held copies of the last sensor message", 7),))
    return make


JANUARY = "a/car_1_Datarecording_01_22_2024_12_05_14.csv"
NEXT_DAY = "b/car_1_Datarecording_01_23_2024_12_05_14.csv"
APRIL = "83/csv/2025-04-24-18-18-35.csv"


@pytest.mark.parametrize(("path", "day"), [
    (JANUARY, date(2024, 1, 22)), (APRIL, date(2025, 4, 24)),
    ("a/x_09_09_2024_15_46_50steer02_ramp.csv", date(2024, 9, 9)),
    ("a/run.mcap", None), ("a/x_13_40_2024_.csv", None), ("a/102024.csv", None)])
def test_day_by_the_name_of_the_file(recorded, path, day):
    assert day_of(recorded(path)) == day


def test_one_day_of_one_map_has_no_caution(recorded):
    result = steering_from_recordings([recorded(JANUARY, seed=1), recorded(JANUARY, seed=2)])
    assert not any("caution" in note for note in result.notes)


@pytest.mark.slow
def test_neighbouring_days_of_one_map_have_no_caution(recorded):
    """Noise alone is no difference between maps."""
    for seed in range(10):
        result = steering_from_recordings([recorded(JANUARY, seed=seed),
                                           recorded(NEXT_DAY, seed=seed + 100)])
        assert not any("caution" in note for note in result.notes)


def test_distant_days_are_named(recorded):
    result = steering_from_recordings([recorded(APRIL), recorded(JANUARY)])
    found = [note for note in result.notes if "caution" in note]
    assert len(found) == 1
    assert "458 days" in found[0]
    assert found[0].endswith("2024-01-22 a, 2025-04-24 83")


@pytest.mark.parametrize("other", [NEXT_DAY, "c/undated.csv", JANUARY.replace("a/", "c/")])
def test_another_trim_is_named_with_both_groups(recorded, other):
    result = steering_from_recordings([recorded(JANUARY), recorded(other, trim_deg=2.0, seed=1)])
    found = [note for note in result.brief if "caution" in note]
    assert len(found) == 1
    assert "2.0 deg rms" in found[0]
    assert "2024-01-22 a" in found[0]


def test_only_the_same_commands_are_compared(recorded):
    parts = [(recorded(JANUARY), np.full(100, -0.5), np.full(100, 0.0)),
             (recorded(NEXT_DAY), np.full(100, 0.5), np.full(100, 0.1))]
    assert cautions(make_groups(parts)) == []
    both = np.repeat([-0.5, 0.5], 100)
    close = [(r, both, np.full(200, residual[0])) for r, _, residual in parts]
    assert len(cautions(make_groups(close))) == 1


def test_notes_of_one_kind_are_one_line(recorded):
    result = steering_from_recordings([recorded(f"a/{i}.csv", seed=i) for i in range(4)])
    assert "held copies of the last sensor message: 28 rows in 4 files" in result.brief
    assert sum("held copies" in note for note in result.notes) == 4
    assert len(result.brief) < len(result.notes)
    assert "not pulses" in result.notes[-1]
    assert result.dropped == "no sample excluded"


def test_what_was_dropped_adds_up(recorded):
    slipping, slow = recorded("a/1.csv", speed=2.2), recorded("a/2.csv", speed=0.1)
    result = steering_from_recordings([slipping, slow, recorded("a/3.csv")])
    slow_rows, slipping_rows = (int(word) for word in result.dropped.replace(",", "").split()
                                    if word.isdigit())
    assert slow_rows == 850
    assert slipping_rows > 100
    assert result.n == 3 * 850 - slow_rows - slipping_rows


def test_grouped_lines():
    slow = [FileNote(f"{i}.csv", "slow", f"slow: {v} m/s", value=v, value_unit="m/s")
            for i, v in enumerate((0.6, 0.4))]
    alone = FileNote("c.csv", "no encoder")
    assert merge_notes([slow[0], alone, slow[1]]) == ("slow: in 2 files (0.40 to 0.60 m/s)",
                                                  "no encoder: in c.csv")
    assert str(slow[0]) == "0.csv: slow: 0.6 m/s"
