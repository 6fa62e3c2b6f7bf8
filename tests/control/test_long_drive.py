"""A long drive needs no more memory than a short one, and stays as close to the path."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import pytest

from dart_hal.core.types import State
from studies.control.long_drive import Part, compare_eighths, drive, measure_growth

MAX_GROWTH = 5_000_000
"""Bytes of resident memory after the first tenth: page noise of malloc, and the rows of five
minutes (1.7 MB)."""


def drive_and_list(seconds: float, keep_states: bool) -> list[Part]:
    """Return the parts of a drive, with each of its states kept or none."""
    kept: list[State] = []
    return list(drive(seconds, 21, 1.0, on_state=kept.append if keep_states else id))


def drive_in_new_process(seconds: float, keep_states: bool = False) -> list[Part]:
    """Return the parts of a drive in a process of its own.

    Earlier tests of this process may have left free memory in which a growth does not show.
    """
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(drive_and_list, seconds, keep_states).result()


@pytest.mark.slow
def test_ten_minutes_need_no_memory_and_stay_as_close_to_the_path():
    parts = drive_in_new_process(600.0)
    assert measure_growth(parts) < MAX_GROWTH
    assert compare_eighths(parts) == pytest.approx(1.0, abs=0.1)
    assert max(part.largest for part in parts) < 0.03


@pytest.mark.slow
def test_control_a_program_that_keeps_its_states_is_noticed():
    assert measure_growth(drive_in_new_process(60.0, keep_states=True)) > MAX_GROWTH
