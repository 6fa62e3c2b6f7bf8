"""How many processes a diagnosis takes, and that none of its items is lost between them."""

from __future__ import annotations

import operator
from functools import partial

import pytest

from dart_hal.core.process.jobs import DEFAULT_PARTS, MIN_PARALLEL_SECONDS, choose_processes, each


@pytest.mark.parametrize("n", [0, 1, DEFAULT_PARTS - 1, DEFAULT_PARTS, 3 * DEFAULT_PARTS + 1])
@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.slow_except("1-*", "2-7")
def test_every_item_is_worked_on_once(n, jobs):
    assert sorted(each(partial(operator.pow, 2), range(n), jobs)) == [2**k for k in range(n)]


def test_a_short_drive_takes_one_process_and_a_long_one_every_core(monkeypatch):
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1, 2}, raising=False)
    assert choose_processes(0.9 * MIN_PARALLEL_SECONDS) == 1
    assert choose_processes(MIN_PARALLEL_SECONDS) == 3
