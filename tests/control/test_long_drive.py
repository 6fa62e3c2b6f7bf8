"""A long drive needs no more memory than a short one, and stays as close to the path."""

from __future__ import annotations

import pytest

from studies.control.long_drive import compare_eighths, drive, measure_growth

MAX_GROWTH = 5_000_000
"""Bytes of resident memory after the first tenth: page noise of malloc, and the rows of five
minutes (1.7 MB)."""


@pytest.mark.slow
def test_ten_minutes_need_no_memory_and_stay_as_close_to_the_path():
    parts = list(drive(600.0, seed=21, speed=1.0))
    assert measure_growth(parts) < MAX_GROWTH
    assert compare_eighths(parts) == pytest.approx(1.0, abs=0.1)
    assert max(part.largest for part in parts) < 0.03


@pytest.mark.slow
def test_control_a_program_that_keeps_its_states_is_noticed():
    kept = []
    parts = list(drive(60.0, seed=21, speed=1.0, on_state=kept.append))
    assert measure_growth(parts) > MAX_GROWTH
