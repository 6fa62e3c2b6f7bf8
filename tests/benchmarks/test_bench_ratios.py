"""The guard against slow code: a ratio far above the committed one is a regression."""

from __future__ import annotations

import json
from contextlib import ExitStack

import bench_ratios
import pytest
import run
from bench_ratios import MAX_WORSE, TRIES, Pair


def make_pair(*costs):
    """A pair whose work takes the next of these costs [s], the last for ever; its reference 1 s."""
    left = list(costs)
    time = [0.0]

    def work():
        time[0] += left.pop(0) if len(left) > 1 else left[0]

    def reference():
        time[0] += 1.0

    return Pair("some", work, reference, lambda: time[0])


@pytest.mark.parametrize(("cost", "ok"), [(2.0, True), (2.29, True), (2.31, False), (1.0, True)])
def test_a_ratio_15_percent_above_the_committed_one_is_a_regression(cost, ok):
    assert MAX_WORSE == 1.15
    assert bench_ratios.judge(make_pair(cost), committed=2.0).ok is ok


def test_a_disturbance_is_measured_again_and_a_regression_stays():
    disturbed = [9.0] * bench_ratios.ROUNDS
    assert bench_ratios.judge(make_pair(*disturbed, 2.0), committed=2.0).ok
    row = bench_ratios.judge(make_pair(*disturbed * TRIES, 2.0), committed=2.0)
    assert row.ok is False
    assert row.value == 9.0


def test_the_limit_of_another_machine_is_an_option(monkeypatch, tmp_path):
    committed = tmp_path / "ratios.json"
    committed.write_text('{"some": 2.0}', encoding="utf-8")
    monkeypatch.setattr(bench_ratios, "make_pairs", lambda opened: [make_pair(2.5)])
    monkeypatch.setattr(bench_ratios, "COMMITTED", committed)
    assert run.main(["--only", "ratios", "--strict"]) == 1
    assert run.main(["--only", "ratios", "--strict", "--max-worse", "1.5"]) == 0


@pytest.mark.slow
@pytest.mark.emulator
def test_every_pair_has_a_committed_ratio(monkeypatch):
    monkeypatch.setattr(bench_ratios, "ROUNDS", 2)
    monkeypatch.setattr(bench_ratios, "TRIES", 1)
    committed = json.loads(bench_ratios.COMMITTED.read_text(encoding="utf-8"))
    with ExitStack() as opened:
        pairs = bench_ratios.make_pairs(opened)
        assert [p.name for p in pairs] == list(committed)
        slower = pairs[-1]._replace(work=lambda: [pairs[-1].work() for _ in range(3)])
        assert bench_ratios.judge(slower, committed[slower.name]).ok is False
