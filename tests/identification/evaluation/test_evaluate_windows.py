"""Which windows are used: the definition, sample by sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.car.runs import read_any
from dart_hal.core.errors import RecordingError
from dart_hal.recording.dart import RUN
from dart_lab.identification.evaluation import prepare
from dart_lab.identification.evaluation.cases import short
from dart_lab.identification.prediction.windows import find_windows, is_covered


@pytest.fixture
def moving(empty):
    def make(n: int, bad: tuple[int, ...] = ()):
        g = empty(n)
        flags = np.zeros(n, dtype=bool)
        flags[list(bad)] = True
        return replace(g, v_x=np.full(n, 1.0), bad=flags)
    return make


@pytest.mark.parametrize(("n", "count"), [(10, 0), (240, 0), (241, 1), (265, 1), (266, 2)])
def test_starts_every_quarter_second_while_220_samples_follow(moving, n, count):
    found = find_windows(moving(n))
    assert found.start.tolist() == [20 + 25 * k for k in range(count)]


@pytest.mark.parametrize(("bad", "kept"), [(20 - 9, True), (20 - 8, False), (20 + 207, False),
                                           (20 + 208, True)])
def test_no_bad_sample_from_eight_before_to_207_after(moving, bad, kept):
    found = find_windows(moving(241, (bad,)))
    assert (len(found) == 1) is kept
    assert found.bad == (0 if kept else 1)


def test_too_slow_at_the_start_is_left_out_and_counted_once(moving):
    g = moving(291, (270,))
    g = replace(g, v_x=np.where(np.arange(len(g)) < 40, 0.3, 0.31))
    found = find_windows(g)
    assert found.start.tolist() == [45]
    assert (found.slow, found.bad) == (1, 1)


def test_slow_and_bad_counts_as_slow(moving):
    g = moving(241, (100,))
    found = find_windows(replace(g, v_x=np.zeros(241)))
    assert (len(found), found.slow, found.bad) == (0, 1, 0)


def test_samples_covered_are_counted_once(moving):
    g = moving(291)
    assert is_covered(find_windows(g), len(g)).sum() == 50 + 201
    assert is_covered(find_windows(moving(10)), 10).sum() == 0


def test_a_folder_called_csv_names_no_recording(excerpt):
    recordings, _ = read_any([excerpt / "83_24_april_2025_slippery_floor_no_tape"])
    (case,) = prepare(recordings).cases
    assert case.file.startswith("83_24_april_2025_slippery_floor_no_tape/2025-04-24")
    assert short(case.file, 12).startswith("83_24_april_/2025-04-24")


def test_runs_of_our_own_are_sent_to_identify(excerpt):
    recordings, _ = read_any([excerpt / "circles_27_sept_2024"])
    runs = [replace(r, schema=RUN, mocap=None) for r in recordings]
    with pytest.raises(RecordingError, match="runs without poses") as refused:
        prepare(runs)
    assert "dart-hal identify all" in refused.value.remedy
