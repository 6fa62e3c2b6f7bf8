"""The questions and output of `calibrate steering` for a person."""

from __future__ import annotations

import contextlib
import io
from types import SimpleNamespace

import numpy as np
import pytest

from dart_hal.calibration.result import SteeringResult, select_rows
from dart_hal.cli.common import procedures
from dart_hal.core.errors import CalibrationFailed

PLAN_QUESTION = "This drives 26 m. Is the floor free?"


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def result():
    command = np.linspace(-1.0, 1.0, 41)
    return SteeringResult("dart-01", ("a.csv",), 100, 10.0, command, 0.3 * command,
                          np.full(41, 0.01), None, {"k_left": 1.0}, 0.02, None,
                          notes=("a.csv: long", "b.csv: long", "general"), brief=("grouped",),
                          dropped="excluded samples: 5", unwritten="nothing written: because")


@pytest.fixture
def on_a_car(verb, monkeypatch, result, tmp_path):
    """``on_a_car(*options, stdin=...)``: the verb with a real car's URL, which prompts PLAN."""
    @contextlib.contextmanager
    def over(backend, **kwargs):
        yield SimpleNamespace(notices=(), files=SimpleNamespace(folder=tmp_path))

    def procedure(car, workshop, *, ask, **kwargs):
        if not ask(PLAN_QUESTION):
            raise CalibrationFailed("not started: it was not agreed to", remedy="--yes")
        return result

    backend = SimpleNamespace(url=SimpleNamespace(text="serial:///dev/ttyUSB0"), workshop=None)
    monkeypatch.setattr(procedures, "open_backend", lambda url: backend)
    monkeypatch.setattr(procedures.Car, "over", over)
    monkeypatch.setattr(procedures, "partial", lambda *args, **kwargs: procedure)

    def run(*options, stdin):
        monkeypatch.setattr("sys.stdin", stdin)
        return verb("calibrate", "steering", *options)
    return run


@pytest.mark.parametrize(("options", "stdin", "code"), [
    ((), io.StringIO(), 2), ((), Terminal("n\n"), 2), ((), Terminal("what\ny\n"), 0),
    (("--yes",), io.StringIO(), 0)])
def test_the_plan_is_printed_once_and_agreement_decides(on_a_car, options, stdin, code):
    done = on_a_car(*options, stdin=stdin)
    assert done.code == code
    assert (done.out + done.err).count("drives 26 m") == 1
    assert "the floor is not free" not in done.err
    assert ("not started" in done.err) == (code == 2)


def test_without_a_terminal_the_remedy_is_the_option(on_a_car):
    error = on_a_car("--json", stdin=io.StringIO()).error
    assert error["found"] == "no terminal"
    assert "--yes" in error["try"]


def test_the_verdict_comes_first_and_fits_a_screen(on_a_car):
    done = on_a_car("--yes", stdin=io.StringIO())
    lines = done.out.splitlines()
    assert len(lines) <= 24
    assert lines[0].startswith("measured: steering map of dart-01")
    assert "excluded samples: 5" in lines[:6]
    assert done.err.splitlines()[-1] == "nothing written: because"
    assert "1 notice (--full)" in done.err
    assert "grouped" not in done.out + done.err
    full = on_a_car("--yes", "--full", stdin=io.StringIO()).err
    assert "notice: grouped" in full
    assert "a.csv: long" not in full


def test_json_keeps_every_row_and_note(on_a_car):
    shown = on_a_car("--yes", "--json", stdin=io.StringIO()).json
    assert len(shown["map"]["command"]) == 41
    assert len(shown["notes"]) == 3


@pytest.mark.parametrize("points", [*range(2, 60), 101, 1000])
def test_rows_shown_are_few_and_hold_both_ends(points):
    rows = select_rows(points)
    assert len(rows) <= 13
    assert len(rows) >= min(points, 6)
    assert (rows[0], rows[-1]) == (0, points - 1)
    assert rows == sorted(set(rows))


def test_help_states_that_recordings_write_nothing(verb):
    assert "nothing is written" in " ".join(verb("calibrate", "steering", "--help").out.split())
