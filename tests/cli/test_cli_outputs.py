"""Every output is checked before a verb opens a car or reads a recording."""

from __future__ import annotations

import re
import sys

import click
import pytest

from dart_hal.cli.common import outputs
from dart_hal.cli.main import list_verbs, load_command
from dart_hal.core import figures

OUTPUT_OPTION = re.compile(r"--(out|out-model|plot|html|record|csv)$")
CHECKED = (outputs.OutputFile, outputs.PlotFolder, outputs.PlotFileOrFolder)
ELSEWHERE = {("export", "out"), ("demo", "out"), ("fetch", "out"), ("study", "out")}
"""Outputs whose kind another argument decides; checked first in the verb."""


def options_of(command):
    """(verb, option) of a command and its sub-commands."""
    for option in command.params:
        if isinstance(option,
                      click.Option) and any(OUTPUT_OPTION.match(name) for name in option.opts):
            yield command.name, option
    for inner in getattr(command, "commands", {}).values():
        yield from options_of(inner)


OUTPUT_PAIRS = [pair for verb in list_verbs()
                for pair in options_of(load_command(verb))]


def test_every_output_option_is_checked_by_its_type():
    assert len(OUTPUT_PAIRS) > 25
    loose = [f"{verb} {option.opts[0]}" for verb, option in OUTPUT_PAIRS
             if not isinstance(option.type, CHECKED) and not option.is_flag
             and (verb, option.name) not in ELSEWHERE]
    assert loose == []


@pytest.fixture
def still(monkeypatch):
    """No car is opened: a verb that would drive fails."""
    def refuse_to_open(*args, **options):
        raise AssertionError("a car was opened before the outputs were checked")

    monkeypatch.setattr("dart_hal.devices.links.base.open_backend", refuse_to_open)
    for name in ("dart_hal.cli.common.session", "dart_hal.cli.common.procedures"):
        monkeypatch.setattr(f"{name}.open_backend", refuse_to_open, raising=False)
    monkeypatch.setattr("dart_hal.car.Car.open", refuse_to_open)


DRIVING_VERBS = [("calibrate", "steering", "--yes"), ("calibrate", "throttle", "--yes"),
                 ("follow", "oval", "--speed", 1), ("experiment", "laps", "--yes"),
                 ("lane", "--speed", 1)]


@pytest.mark.parametrize("verb_line", DRIVING_VERBS)
@pytest.mark.parametrize(("plot", "code"), [
    ("out/", "D-USE-01"), ("x.gif", "D-USE-01"), ("x", "D-USE-01"),
    ("file.txt/x.png", "D-FILE-04")])
def test_picture_that_cannot_be_written_is_refused_before_the_drive(verb, still, tmp_path,
                                                                    verb_line, plot, code):
    (tmp_path / "file.txt").write_text("")
    error = verb(*verb_line, "--plot", plot, "--json").error
    assert error["code"] == code


def test_picture_without_matplotlib_is_refused_before_the_drive(verb, still, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    error = verb("calibrate", "steering", "--yes", "--plot", "x.png", "--json").error
    assert "matplotlib>=" in error["try"]


@pytest.mark.parametrize("line", [
    ("record", "--out", "DIR"), ("record", "--out", "file.txt/run.mcap"),
    ("drive", "--keyboard", "--record", "DIR"),
    ("follow", "oval", "--speed", 1, "--record", "file.txt/r.mcap"),
    ("experiment", "laps", "--out", "DIR"), ("experiment", "laps", "--out-model", "m.txt")])
def test_recording_that_cannot_be_written_is_refused_before_the_drive(verb, still, tmp_path, line):
    (tmp_path / "DIR").mkdir()
    (tmp_path / "file.txt").write_text("")
    assert verb(*line, "--json").code == 2


@pytest.mark.parametrize("line", [
    ("identify", "none.csv", "--plot", "file.txt"), ("identify", "none.csv", "--html", "a.pdf"),
    ("evaluate", "none.csv", "--plot", "x.gif"), ("data", "check", "none.csv", "--plot", "x.gif"),
    ("replay", "none.mcap", "--csv", "file.txt/a.csv"), ("diagnose", "--html", "file.txt/a.html")])
def test_output_of_long_work_is_refused_before_it(verb, tmp_path, line):
    (tmp_path / "file.txt").write_text("")
    error = verb(*line, "--json")
    assert error.code == 2
    assert "none." not in error.out.replace("none.csv --", "")


def test_what_is_replaced_is_named(verb, tmp_path):
    (tmp_path / "a.csv").write_text("old")
    assert "a.csv is replaced" in verb("replay", "none.mcap", "--csv", "a.csv").err
    assert "is replaced" not in verb("replay", "none.mcap", "--csv", "b.csv").err
    assert (tmp_path / "a.csv").read_text() == "old"  # nothing was written


def test_folder_for_pictures_may_be_new_or_there(tmp_path):
    (tmp_path / "there.v2").mkdir()
    for name in ("new", "there.v2"):
        kind = outputs.PlotFileOrFolder()
        assert kind.convert(str(tmp_path / name), None, None) == tmp_path / name
    assert not (tmp_path / "new").exists()
    for suffix in figures.FIGURE_FORMATS:
        assert outputs.PlotFileOrFolder().convert(str(tmp_path / f"x{suffix}"), None, None)
