"""Every output is checked before a verb opens a car or reads a recording."""

from __future__ import annotations

import re
import sys

import click
import pytest

from dart_hal.cli.common import outputs
from dart_hal.cli.main import list_verbs, load_command
from dart_hal.core import figures
from tests.common import ROOT

OUTPUT_OPTION = re.compile(r"--(out|out-model|plot|plots|html|record|csv)$")
CHECKED = (outputs.OutputFile, outputs.OutputFolder, outputs.PlotFileOrFolder)
ELSEWHERE = {("export", "out"), ("class", "out")}
"""Checked first in the verb: another argument decides the kind, or an older folder is refused."""
MEANINGS = {"--html": "write the report: ", "--plot": "write a picture: ",
            "--plots": "write pictures into a folder: ",
            "--out": "write the result: "}
"""Each of these options has one meaning in all verbs; its help begins with it."""


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


@pytest.mark.parametrize(("verb", "option"), OUTPUT_PAIRS,
                         ids=lambda part: getattr(part, "name", part))
def test_option_has_one_meaning_in_all_verbs(verb, option):
    name = option.opts[0]
    if option.hidden or name not in MEANINGS or (verb, option.name) in ELSEWHERE:
        return
    assert option.help.startswith(MEANINGS[name])
    assert option.metavar == ("FOLDER" if isinstance(option.type, outputs.OutputFolder) else "FILE")
    assert not option.is_flag
    pages = getattr(option.type, "suffixes", ())
    assert (".html" in pages) == (name == "--html")


KEPT = {("experiment", "out"), ("experiment", "out_model"), ("record", "out"), ("import", "out"),
        ("identify", "out"), ("diagnose", "out"), ("diagnose", "out_predictor")}
"""Recordings and models: the older file is kept under a number or in history/."""


@pytest.mark.parametrize(("verb", "option"), OUTPUT_PAIRS,
                         ids=lambda part: getattr(part, "name", part))
def test_no_output_is_replaced_without_a_message(verb, option, tmp_path, capsys):
    if option.name == "record" or (verb, option.name) in KEPT | ELSEWHERE:
        return
    kind = option.type
    if isinstance(kind, outputs.OutputFolder):
        (tmp_path / "there").mkdir()
        (tmp_path / "there" / "a.png").write_text("old")
        path = tmp_path / "there"
    else:
        path = tmp_path / f"a{getattr(kind, 'suffixes', ('.png',))[0]}"
        path.write_text("old")
    kind.convert(str(path), None, None)
    assert "replaced" in " ".join(capsys.readouterr().err.split())


@pytest.mark.slow
def test_spellings_of_version_0_1_give_a_notice(verb, tmp_path):
    old = verb("replay", "none.mcap", "--csv", "a.csv").err
    assert "--csv is --out since version 0.2" in old
    assert "--html FOLDER/index.html" in verb("study", "--html", "none.csv").err
    assert "write --plots p for a folder" in verb("evaluate", "none.csv", "--plot", "p").err
    cars = ROOT / "cars"
    ran = verb("report", "--cars", cars, "--out", "x.html")
    assert "--out is --html since version 0.2" in ran.err
    assert (tmp_path / "x.html").is_file()
    assert not (tmp_path / "report.html").exists()


def test_page_of_a_study_takes_a_file_or_none(verb):
    option = next(p for p in load_command("study").params if p.name == "html")
    parse = load_command("study").make_context
    for words, page in ((["a.csv", "--html", "p.html"], "p.html"), (["--html", "a.csv"], "."),
                        (["a.csv", "--html"], "."), (["a.csv", "--html=p.html"], "p.html"),
                        (["--html", "--seed", "1", "a.csv"], ".")):
        values = parse("study", list(words)).params
        assert str(values[option.name]) == page
        assert [str(path) for path in values["files"]] == ["a.csv"]


def test_folder_of_pictures_reaches_the_verb():
    for words in (["a.csv", "--plots", "p"], ["--plots", "p", "a.csv"]):
        for verb in ("evaluate", "identify"):
            start = ["friction"] if verb == "identify" else []
            values = load_command(verb).make_context(verb, [*start, *words]).params
            assert str(values["plot"]) == "p"
            assert "plots" not in values


def test_pictures_of_all_sub_models_need_a_folder(verb):
    error = verb("identify", "all", "none.csv", "--plot", "a.png", "--json").error
    assert error["try"] == "--plots a"


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
    ("replay", "none.mcap", "--out", "file.txt/a.csv"), ("diagnose", "--html", "file.txt/a.html")])
def test_output_of_long_work_is_refused_before_it(verb, tmp_path, line):
    (tmp_path / "file.txt").write_text("")
    error = verb(*line, "--json")
    assert error.code == 2
    assert "none." not in error.out.replace("none.csv --", "")


def test_what_is_replaced_is_named(verb, tmp_path):
    (tmp_path / "a.csv").write_text("old")
    error = verb("replay", "none.mcap", "--out", "a.csv").err
    assert "a.csv exists: it is replaced if the command succeeds" in error
    assert "is replaced" not in verb("replay", "none.mcap", "--out", "b.csv").err
    assert (tmp_path / "a.csv").read_text() == "old"  # nothing was written


def test_folder_for_pictures_may_be_new_or_there(tmp_path):
    (tmp_path / "there.v2").mkdir()
    for name in ("new", "there.v2"):
        kind = outputs.PlotFileOrFolder()
        assert kind.convert(str(tmp_path / name), None, None) == tmp_path / name
    assert not (tmp_path / "new").exists()
    for suffix in figures.FIGURE_FORMATS:
        assert outputs.PlotFileOrFolder().convert(str(tmp_path / f"x{suffix}"), None, None)
