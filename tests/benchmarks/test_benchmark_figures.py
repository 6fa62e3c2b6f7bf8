"""The judgement of a figure, and the printed documents."""

from __future__ import annotations

import json

import pytest
import run
from figures import Figure, best_cpu, machine


@pytest.mark.parametrize(("value", "low", "high", "ok"), [
    (8.0, 8, None, True), (7.9, 8, None, False), (0.5, None, 0.5, True), (0.6, None, 0.5, False),
    (0, 0, 0, True), (1, 0, 0, False), (-1, 0, 0, False), (3.0, None, None, None),
    (float("nan"), None, 1, False), (float("nan"), 1, None, False)])
def test_a_target_is_met_or_not(value, low, high, ok):
    assert Figure("x", value, "", low, high).ok is ok


@pytest.mark.parametrize(("low", "high", "text"), [
    (8, None, ">= 8"), (150e3, None, ">= 150,000"), (None, 0.5, "<= 0.5"), (0, 0, "0"),
    (99.5, 100.5, "99.5 to 100.5"), (None, None, "-")])
def test_a_target_reads_as_it_judges(low, high, text):
    assert Figure("x", 0.0, "", low, high).target == text


def test_the_best_round_counts():
    work = iter([2_000_000, 20, 2_000_000])
    longest = best_cpu(lambda: sum(range(2_000_000)), 1)
    assert best_cpu(lambda: sum(range(next(work))), 3) < longest


def test_the_header_names_machine_and_versions():
    facts = machine()
    assert {"machine", "python", "numpy", "dart-hal", "simavr"} <= facts.keys()
    assert facts["machine"].startswith("one core of ")


@pytest.fixture
def one_bench(monkeypatch):
    rows = [Figure("fast enough", 10.0, "x", low=8), Figure("too slow", 1.0, "x", low=8)]
    monkeypatch.setattr(run, "BENCHES", {"some": lambda scale: rows, "good": lambda s: rows[:1]})


def test_json_holds_every_figure(one_bench, capsys):
    assert run.main(["--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [(f["bench"], f["name"], f["ok"]) for f in document["figures"]] == [
        ("some", "fast enough", True), ("some", "too slow", False), ("good", "fast enough", True)]


def test_json_has_no_number_that_json_does_not_know(monkeypatch, capsys):
    nothing = [Figure("unknown", float("nan"), "", high=0)]
    monkeypatch.setattr(run, "BENCHES", {"some": lambda scale: nothing})
    run.main(["--json"])
    document = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert (document["figures"][0]["value"], document["figures"][0]["ok"]) == (None, False)


def test_what_falls_short_is_named_and_strict_fails(one_bench, capsys):
    assert run.main(["--strict"]) == 1
    assert "1 of 3 figures fall short: too slow" in capsys.readouterr().out


def test_only_the_named_bench_runs(one_bench, capsys):
    assert run.main(["--only", "good", "--strict"]) == 0
    assert "too slow" not in capsys.readouterr().out


def test_an_unknown_bench_is_refused(one_bench):
    with pytest.raises(SystemExit):
        run.main(["--only", "nothing"])


def test_a_missing_emulator_is_reported_and_not_a_success(monkeypatch, capsys):
    def missing(scale):
        raise run.EmulatorMissing("not built")

    monkeypatch.setattr(run, "BENCHES", {"some": missing})
    assert run.main([]) == 0
    assert "not built" in capsys.readouterr().out
    assert run.main(["--strict"]) == 1
