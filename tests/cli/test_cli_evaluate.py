"""``dart-hal evaluate``: its JSON, its table, and what it refuses."""

from __future__ import annotations

import gzip
import hashlib
import html
import math
import re
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from dart_lab.pages import evaluate_table
from dart_lab.report.numbers import significant
from tests.common import EXCERPT
from tests.pages import foreign

FREE_DRIVE = EXCERPT / "91_free_driving_16_sept_2024"
CIRCLES = EXCERPT / "circles_27_sept_2024"
STEP_INPUTS = EXCERPT / "19_step_input_data"
CHANNELS = ["vx", "vy", "yaw_rate", "position", "yaw_deg"]
NO_MOCAP = next(iter(sorted(STEP_INPUTS.glob("*.gz"))))


def one(folder: Path) -> Path:
    return next(iter(sorted(folder.glob("*.gz"))))


@pytest.fixture
def moved_to(tmp_path):
    """A copy of the free drive whose mocap clock is of another day."""
    def make(seconds: float, rows: int | None = None) -> Path:
        lines = gzip.decompress(one(FREE_DRIVE).read_bytes()).decode().splitlines()
        head = lines[0].split(",")
        at = [h.strip() for h in head].index("vicon time")
        out = [lines[0]]
        for line in lines[1:rows]:
            cells = line.split(",")
            cells[at] = repr(float(cells[at]) + seconds)
            out.append(",".join(cells))
        path = tmp_path / "later.csv"
        path.write_text("\r\n".join(out) + "\r\n")
        return path
    return make


@pytest.mark.slow
def test_json_has_the_shape_of_the_contract(verb):
    got = verb("evaluate", "--model", "paper", "--json", FREE_DRIVE, CIRCLES, STEP_INPUTS).json
    assert got["model"] == "paper"
    assert got["kind"] == "dynamic"
    used = [f for f, use in got["files"].items() if use["used"]]
    for part in (got["horizons"], got["ctrv"]):
        assert list(part) == ["0.5", "1.0", "2.0"]
        for horizon in part.values():
            assert list(horizon["pooled"]) == [*CHANNELS, "n"]
            assert list(horizon["median"]) == CHANNELS
            assert sorted(horizon["by_file"]) == sorted(used)
            assert horizon["pooled"]["n"] == sum(v["n"] for v in horizon["by_file"].values()) == 228
    assert got["horizons"]["1.0"]["by_file"][used[0]]["yaw_rate"] == pytest.approx(0.415, abs=5e-4)
    assert set(got["gain_over_ctrv"]["1.0"]) == set(CHANNELS)
    skipped = [use for f, use in got["files"].items() if f.startswith("19_")]
    assert len(skipped) == 13
    assert all(use["windows"] == 0 and "no motion capture" in use["why"][0] for use in skipped)
    for use in got["files"].values():
        assert set(use) == {"used", "windows", "dropped", "why"}


@pytest.mark.slow
def test_pooled_is_made_of_its_files(verb):
    got = verb("evaluate", "--json", FREE_DRIVE, CIRCLES).json["horizons"]["1.0"]
    for channel in CHANNELS:
        total = sum(f["n"] * f[channel]**2 for f in got["by_file"].values())
        assert got["pooled"][channel] == pytest.approx(math.sqrt(total / got["pooled"]["n"]))


@pytest.mark.slow
def test_kinematic_is_another_model_with_the_same_baseline(verb):
    dynamic = verb("evaluate", "--json", FREE_DRIVE).json
    rolling = verb("evaluate", "--json", "--kinematic", FREE_DRIVE).json
    assert rolling["kind"] == "kinematic"
    assert rolling["ctrv"] == dynamic["ctrv"]
    assert rolling["horizons"]["1.0"]["pooled"]["yaw_rate"] == pytest.approx(0.865, abs=9e-4)
    assert rolling["kinematic_limit"] == dynamic["kinematic_limit"]


@pytest.mark.slow
def test_same_input_same_bytes(verb):
    assert verb("evaluate", "--json", CIRCLES).out == verb("evaluate", "--json", CIRCLES).out


def test_the_limit_names_what_is_not_supported(verb):
    limit = verb("evaluate", "--json", CIRCLES).json["kinematic_limit"]
    assert limit["holds_to"]["lateral_acceleration"] == {
        "value": None, "ci95": [None, None], "unit": "m/s2", "supported": False}
    assert any("no limit" in s for s in limit["statement"])


@pytest.mark.slow
def test_table_shows_both_on_standard_output(verb):
    ran = verb("evaluate", FREE_DRIVE)
    assert ran.code == 0
    assert re.fullmatch(r"\d+ notices? \(--full\)", ran.err.strip())
    assert "constant velocity (CTRV)" in ran.out
    assert ".42|.78" in ran.out, "yaw rate at 1 s, model and held"
    assert "how far the kinematic model reaches" in ran.out


@pytest.mark.slow
def test_a_recording_without_mocap_is_refused_by_name(verb):
    error = verb("evaluate", "--json", NO_MOCAP).error
    assert "no motion capture" in error["what"]
    assert "no motion capture" in verb("evaluate", "--json", FREE_DRIVE, NO_MOCAP).error["what"]


def test_a_folder_without_any_mocap_is_refused(verb):
    error = verb("evaluate", "--json", STEP_INPUTS).error
    assert "no recording can be used" in error["what"]
    assert "13 file(s)" in error["found"]


@pytest.mark.slow_except("arguments0")
@pytest.mark.parametrize("arguments", [
    [], [EXCERPT / "nowhere"], [CIRCLES, "--model", "papre"], [CIRCLES, "--reference", "0.1,0.2"],
    [CIRCLES, "--reference", "a,b,c"], [CIRCLES, "--plot", "picture.bmp"]])
def test_bad_arguments_are_refused(verb, arguments):
    assert verb("evaluate", "--json", *arguments).error["what"]


@pytest.mark.slow
def test_a_file_that_is_not_published_gets_a_fitted_mounting_and_reports_it(verb, moved_to):
    path = moved_to(2.0 * 365.25 * 86400.0)
    got = verb("evaluate", "--json", path).json
    (use,) = got["files"].values()
    assert "marker frame fitted" in use["why"][0]
    (reference,) = got["references"].values()
    assert reference["lx"] == pytest.approx(0.115, abs=3.0 * reference["std"]["lx"]), "September's"
    given = verb("evaluate", "--json", "--reference", "0.115,0.01,-0.01", path).json
    known = verb("evaluate", "--json", one(FREE_DRIVE)).json
    for channel in CHANNELS:
        assert given["horizons"]["1.0"]["pooled"][channel] == pytest.approx(
            known["horizons"]["1.0"]["pooled"][channel], rel=1e-3)


def test_an_unpublished_day_without_turns_requests_the_mounting(verb, moved_to):
    path = moved_to(2.0 * 365.25 * 86400.0, rows=900)
    error = verb("evaluate", "--json", path).error
    assert "the marker frame on this car is not known" in error["what"]
    assert "--reference" in error["try"]


def test_a_recording_without_a_window_is_refused_by_name(verb, moved_to):
    error = verb("evaluate", "--json", "--reference", "0.115,0.01,-0.01",
                 moved_to(0.0, rows=160)).error
    assert "no window" in error["what"]


@pytest.mark.slow
def test_a_model_file_is_taken_however_odd_its_car(verb, tmp_path):
    model = tmp_path / "model.toml"
    model.write_text('schema = "dart-hal/model/1"\nname = "odd"\nkind = "dynamic"\n'
                     "[body]\nwheelbase = 0.6\nl_f = 0.3\nl_r = 0.3\nmass = 12.0\n"
                     "yaw_inertia = 0.5\n")
    got = verb("evaluate", "--json", "--model", model, CIRCLES).json
    assert got["model"] == "odd"
    assert all(np.isfinite(v) for v in got["horizons"]["2.0"]["pooled"].values())
    assert got["ctrv"]["1.0"]["pooled"]["vy"] != pytest.approx(
        verb("evaluate", "--json", CIRCLES).json["ctrv"]["1.0"]["pooled"]["vy"], rel=0.05), "l_r"


BODY = """schema = "dart-hal/model/1"
name = "mine"
kind = "dynamic"
[body]
wheelbase = 0.175
l_f = 0.0805
l_r = 0.0945
mass = 1.67
yaw_inertia = 0.0065
"""


@pytest.mark.slow
def test_what_a_model_file_omits_is_reported(verb, tmp_path):
    """Half a friction curve of one car and half of another's is no model of either."""
    model = tmp_path / "model.toml"
    model.write_text(BODY + "[friction]\na = 0.3\n")
    text = " ".join(verb("evaluate", "--json", "--model", model, CIRCLES).err.split())
    assert "lacks friction.b, friction.c, motor, steering, tyres: the paper's" in text
    assert "lacks" not in verb("evaluate", "--json", "--model", "paper", CIRCLES).err


@pytest.mark.parametrize("more", ["[load_transfer]\nk = -0.07\n", "[forms]\ntyres = 'axle'\n",
                                  "[tyres]\nrear_E = -1.0\n"])
def test_what_no_equation_knows_is_not_passed_over(verb, tmp_path, more):
    model = tmp_path / "model.toml"
    model.write_text(BODY + more)
    ran = verb("evaluate", "--json", "--model", model, CIRCLES)
    assert ran.code == 2
    assert ran.error["code"] == "D-FILE-01"


@pytest.mark.slow
def test_pictures_one_file_or_a_folder(verb, tmp_path):
    pytest.importorskip("matplotlib")
    got = verb("evaluate", "--json", FREE_DRIVE, "--plot", tmp_path / "a.png").json
    assert got["plots"] == [str(tmp_path / "a.png")]
    got = verb("evaluate", "--json", FREE_DRIVE, "--plots", tmp_path / "all").json
    names = sorted(Path(p).name for p in got["plots"])
    assert names == ["errors.png", "kinematic_limit.png", "windows.png"]
    for path in [*got["plots"], tmp_path / "a.png"]:
        assert Path(path).read_bytes()[:4] == b"\x89PNG"
        assert Path(path).stat().st_size > 20_000


@pytest.mark.slow
def test_a_page_has_every_error_and_the_pictures(verb, tmp_path):
    pytest.importorskip("matplotlib")
    got = verb("evaluate", "--json", FREE_DRIVE, "--html", tmp_path / "new" / "a.html").json
    text = Path(got["report"]).read_text(encoding="utf-8").replace("\u00a0", " ")
    for score in (got["horizons"], got["ctrv"]):
        for of in score.values():
            assert all(f"{significant(of['pooled'][c])} ({significant(of['median'][c])})" in text
                       for c in CHANNELS)
    for sentence in got["kinematic_limit"]["statement"]:
        assert html.escape(sentence, quote=True) in text
    assert text.count("<img") == 3
    assert not foreign(text)
    assert "does not end in .html" in verb(
        "evaluate", "--json", FREE_DRIVE, "--html", tmp_path / "a.png").error["what"]


@pytest.mark.slow
def test_what_a_model_was_fitted_to_is_no_test_of_it(verb, tmp_path):
    model = tmp_path / "model.toml"
    digest = hashlib.sha256(one(FREE_DRIVE).read_bytes()).hexdigest()
    model.write_text(f'{BODY}[provenance.files]\n"elsewhere/renamed.csv" = "{digest}"\n')
    fitted = verb("evaluate", "--json", "--model", model, FREE_DRIVE, CIRCLES).json["fitted_to"]
    assert [name.split("/")[0] for name in fitted] == [FREE_DRIVE.name], "by content, not by name"
    text = " ".join(verb("evaluate", "--model", model, FREE_DRIVE, CIRCLES).out.split())
    assert "caution: 1 of 2 recordings are those that this model was fitted to: 91_" in text
    other = verb("evaluate", "--model", model, CIRCLES)
    assert "caution" not in other.out


def test_a_model_among_the_recordings_is_refused_with_its_option(verb):
    error = verb("evaluate", "--json", "model.toml", CIRCLES).error
    assert "model.toml is a model" in error["what"]
    assert error["try"] == f"dart-hal evaluate --model model.toml {CIRCLES}"


@pytest.mark.slow
def test_slow_recordings_are_not_judged_by_missing_speeds(verb, moved_to):
    """It has vicon columns: asking for schema B or C would send the user in a circle."""
    folder = moved_to(0.0, rows=160).parent
    error = verb("evaluate", "--json", folder).error
    assert "marker frame" in error["what"]
    assert "--reference" in error["try"]
    error = verb("evaluate", "--json", "--reference", "0.115,0.01,-0.01", folder).error
    assert "no recording can be used" in error["what"]
    assert "schema B or C" not in error["try"]
    assert "2 s" in error["try"]
    assert "schema B or C" in verb("evaluate", "--json", STEP_INPUTS).error["try"]


@pytest.mark.slow
def test_the_few_files_that_gave_nothing_are_named(verb, moved_to):
    text = verb("evaluate", "--full", one(FREE_DRIVE), moved_to(0.0, rows=160).parent).err
    assert "/later): " in text
    assert "skipped 13 file(s): " in verb("evaluate", "--full", FREE_DRIVE, STEP_INPUTS).err


@pytest.mark.slow
def test_names_take_the_room_there_is(verb, monkeypatch):
    """And the folder names what was driven, not "csv"."""
    monkeypatch.setattr(evaluate_table, "results", Console(soft_wrap=True, width=120))
    text = verb("evaluate", FREE_DRIVE).out
    assert FREE_DRIVE.name in text
    monkeypatch.setattr(evaluate_table, "results", Console(soft_wrap=True, width=80))
    text = verb("evaluate", FREE_DRIVE).out
    assert FREE_DRIVE.name not in text.split("how far")[0]
    assert max(map(len, text.split("recording (1 s)")[1].split("change of")[0].splitlines())) <= 80
