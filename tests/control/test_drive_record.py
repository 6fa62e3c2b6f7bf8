"""The record of a drive: bounded, evenly spaced, with the figures of every call."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.control.drive_record import MAX_RECORDED_ROWS, ROW_LENGTH, DriveRecord


def record_calls(count, start=0):
    """A record of ``count`` calls, whose figures begin with call ``start``; its offsets."""
    driven = DriveRecord()
    offsets = np.random.default_rng(1).normal(0.0, 0.01, count)
    for n, offset in enumerate(offsets):
        driven.add(0.01 * n, 1.0, 2.0, float(offset), 1.0, 1.0, 0.01 * n)
        if n + 1 == start:
            driven.start_figures()
    return driven, offsets


@pytest.mark.slow_except("1")
@pytest.mark.parametrize("count", [1, 100, MAX_RECORDED_ROWS - 1, 5 * MAX_RECORDED_ROWS])
def test_figures_are_of_every_call_and_rows_are_bounded(count):
    driven, offsets = record_calls(count)
    assert driven.offset_rms == pytest.approx(np.sqrt(np.mean(offsets**2)))
    assert driven.offset_max == np.abs(offsets).max()
    assert len(driven) == len(driven.table) < MAX_RECORDED_ROWS
    assert driven.table.shape == (len(driven), ROW_LENGTH)
    steps = np.diff(driven.table[:, 0])
    assert np.ptp(steps) < 1e-9 if len(steps) else count == 1
    assert 0.01 * (count - 1) - driven.table[-1, 0] < (steps[0] if len(steps) else 1e-9) + 1e-9


def test_all_rows_of_a_short_drive_are_kept():
    driven, offsets = record_calls(500)
    assert (driven.table[:, 3] == offsets).all()


def test_figures_begin_in_the_lane():
    driven, offsets = record_calls(2 * MAX_RECORDED_ROWS, start=1000)
    assert driven.offset_rms == pytest.approx(np.sqrt(np.mean(offsets[1000:]**2)))
    assert driven.table[driven.joined, 0] == pytest.approx(10.0, abs=0.05)


def test_an_empty_record_has_no_figures():
    driven = DriveRecord()
    assert np.isnan(driven.offset_rms)
    assert np.isnan(driven.offset_max)
    assert driven.table.shape == (0, ROW_LENGTH)
