"""``dart-hal identify`` from the outside: JSON, exit status, what is written and what is not."""

from __future__ import annotations

import csv
import gzip
import json
import re
import shlex
import shutil
from pathlib import Path

import pytest

from dart_hal.car.runs import read_any
from dart_hal.cli.main import main
from dart_hal.core.config import load_model
from dart_hal.core.errors import UsageError
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.load import vehicle_of
from dart_lab.identification.evaluation import evaluate
from dart_lab.identification.write import SECTIONS
from tests.pages import foreign

EXCERPT = Path(__file__).resolve().parents[1] / "recorded" / "data"
FIT_KEYS = {"parameters", "n", "rmse", "loss", "unit", "converged", "identifiable", "cpu_s"}
NAMES = {"friction": {"a", "b", "c"}, "motor": {"d", "e", "g"},
         "steering": {"k_left", "a_left_rad", "s0", "a_right_rad", "k_right"},
         "delay": {"steering_s"},
         "tyres": {"front_D", "front_C", "front_B", "front_E", "rear_cornering_stiffness"}}


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    """``run(*words)`` -> (exit status, standard output (JSON read), standard error)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def call(*words):
        with pytest.raises(SystemExit) as end:
            main(["identify", *map(str, words)])
        out, err = capsys.readouterr()
        return end.value.code, json.loads(out) if "--json" in words else out, err
    return call


@pytest.mark.slow
def test_as_paper_prints_the_contract(run, tmp_path):
    status, document, _ = run("all", "--as-paper", EXCERPT, "--json")
    assert status == 0
    assert set(NAMES) <= set(document["fits"])
    for name, keys in NAMES.items():
        fit = document["fits"][name]
        assert set(fit) >= FIT_KEYS
        assert set(fit["parameters"]) == keys == set(fit["identifiable"])
        assert all(set(p) == {"value", "std", "unit"} for p in fit["parameters"].values())
        assert fit["loss"] == pytest.approx(fit["rmse"]**2)
    assert document["fits"]["friction"]["loss"] == pytest.approx(.0360688, rel=1e-4)
    assert document["fits"]["friction"]["paper"]["rmse"] == pytest.approx(.1899, abs=6e-5)
    assert document["fits"]["tyres"]["at_bound"] == ["front_C"]
    assert document["fits"]["tyres"]["derived"]["front_stiffness_BCD"]["unit"] == "N/rad"
    assert len(document["files"]) == 43
    assert all(set(f) == {"used", "dropped", "why"} for f in document["files"].values())
    assert not document["fits"]["delay"]["identifiable"]["steering_s"]  # an error of a row
    assert document["model"] is None
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_as_paper_with_out_writes_what_is_sound(run, tmp_path):
    status, document, err = run("all", "--as-paper", EXCERPT, "--out", "m/model.toml", "--json")
    assert (status, document["model"]) == (0, "m/model.toml")
    model = load_model(tmp_path / "m/model.toml")
    car = vehicle_of(model)
    assert car.motor.d == pytest.approx(21.070, abs=0.01)
    assert car.tyres == PAPER.tyres  # C at its bound: the base's values stay
    assert "not written: tyres: front_C stopped at the edge" in err
    assert set(model.covariance) == {"friction", "motor", "steering", "delay"}
    assert len(model.provenance["files"]) == 43
    assert all(len(digest) == 64 for digest in model.provenance["files"].values())
    typed = model.provenance["sections"]["motor"]["command"]
    where = shlex.quote(str(EXCERPT))
    assert typed == f"dart-hal identify all --as-paper {where} --out m/model.toml"


@pytest.mark.slow
def test_an_unsound_fit_does_not_touch_a_good_file(run, tmp_path):
    path = tmp_path / "model.toml"
    run("friction", "--as-paper", EXCERPT, "--out", path)
    before = path.read_bytes()
    status, document, err = run("tyres", "--as-paper", EXCERPT, "--out", path, "--json")
    assert status == 1
    assert document["model"] is None
    assert document["fits"]["tyres"]["sound"] is False
    assert "is unchanged" in err
    assert path.read_bytes() == before


@pytest.mark.slow
def test_one_sub_model_after_the_other_into_one_file(run, tmp_path):
    path = tmp_path / "model.toml"
    run("friction", "--as-paper", EXCERPT, "--out", path)
    run("motor", "--as-paper", EXCERPT, "--out", path)
    car = vehicle_of(load_model(path))
    assert car.friction.a == pytest.approx(1.7258, abs=1e-3)
    assert car.motor.d == pytest.approx(21.070, abs=0.01)


def test_a_base_gives_what_is_not_identified(run, tmp_path):
    run("friction", "--as-paper", EXCERPT, "--out", "m.toml", "--base", "upstream-2024")
    car = vehicle_of(load_model(tmp_path / "m.toml"))
    assert car.body.mass == 1.58
    assert car.friction.a == pytest.approx(1.7258, abs=1e-3)


@pytest.mark.slow
def test_every_file_of_the_paper_is_in_the_list(run):
    _, out, _ = run("all", "--as-paper", EXCERPT, "--dry-run", "--full")
    rest = out.split("parameters,")[0]
    head = rest.splitlines()[3]
    listed = [int(n) for n in re.findall(r": (\d+) file\(s\)", rest)]
    assert head.startswith("43 of 43 file(s) used")
    assert sum(listed) == 43


@pytest.mark.slow_except("80-False")
@pytest.mark.parametrize(("columns", "shown"), [("80", False), ("89", False), ("90", True)])
def test_a_narrow_terminal_costs_a_column_and_no_digits(run, monkeypatch, columns, shown):
    monkeypatch.setenv("COLUMNS", columns)
    monkeypatch.setattr("dart_hal.cli.common.output.results._width", int(columns))
    _, out, _ = run("friction", "--as-paper", EXCERPT)
    table = out.rpartition("residuals")[2]
    assert (" loss " in table) == shown
    assert ("0.0360688" in table) == shown
    assert "0.18992 N" in table
    assert "0.18994" in table  # the paper's


def test_a_dry_run_writes_nothing(run, tmp_path):
    status, document, err = run("friction", "--as-paper", EXCERPT, "--out", "m.toml", "--dry-run",
                                "--json")
    assert (status, document["model"]) == (0, None)
    assert "dry run" in err
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_table_states_value_error_paper_and_what_is_not_reported(run):
    _, out, err = run("tyres", "--as-paper", EXCERPT)
    assert "0.38508 +- 0.00088 N/deg" in out
    assert "22.301" in out  # the paper's, in the same row
    assert "at bound" in out
    assert "caution: tyres: front_C stopped at the edge of the allowed interval" in out
    assert "0.38508" not in err
    assert "nothing written" in err


@pytest.mark.parametrize(("words", "what"), [
    (["all"], "no recording named"),
    (["all", "x.csv", "--as-paper", "."], "takes its own folders"),
    (["all", "--as-paper", "nowhere"], "no recording"),
    (["all", "nowhere.csv"], "no such file"),
    (["friction", "x.csv", "--reference", "0.1,0.2"], "LX,THETA,LY"),
    (["friction", "x.csv", "--reference", "93,0,0"], "metres"),
    (["friction", "x.csv", "--base", "nobody"], "no model is called"),
    (["nothing", "x.csv"], "dart-hal identify all FILES"),
    (["fricton", "x.csv"], "dart-hal identify friction FILES"),
    (["x.csv"], "no such sub-model")])
def test_usage_and_input_errors(run, words, what):
    status, document, _ = run(*words, "--json")
    assert status == 2
    assert set(document) == {"error"}
    assert set(document["error"]) == {"code", "what", "found", "expected", "likely", "try", "read"}
    assert what in json.dumps(document)


def test_a_broken_model_file_is_not_overwritten(run, tmp_path):
    path = tmp_path / "model.toml"
    path.write_text("this is [no toml")
    status, document, _ = run("friction", "--as-paper", EXCERPT, "--out", path, "--json")
    assert status == 2
    assert "model.toml" in document["error"]["what"]
    assert path.read_text() == "this is [no toml"


@pytest.mark.slow
def test_pictures(run, tmp_path):
    pytest.importorskip("matplotlib")
    _, document, _ = run("all", "--as-paper", EXCERPT, "--plots", "pics", "--json")
    names = {Path(p).name for p in document["plots"]}
    assert names == {f"{n}.png" for n in (*NAMES, "step_response")}
    assert all((tmp_path / p).read_bytes()[:4] == b"\x89PNG" for p in document["plots"])


@pytest.mark.slow
def test_a_page_has_the_tables_and_the_pictures(run, tmp_path):
    pytest.importorskip("matplotlib")
    _, document, err = run("all", "--as-paper", EXCERPT, "--html", "new/report.html", "--json")
    assert document["report"] == "new/report.html"
    assert "report: new/report.html" in err
    text = (tmp_path / "new" / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")
    assert "1.726 \u00b1 0.021 N" in text  # friction a, as in the terminal's table
    assert all(name in text for name in (*NAMES, "tyres_front"))
    assert text.count("<img") == len(NAMES) + 1  # and the step response
    assert not foreign(text)
    status, _, err = run("all", "--as-paper", EXCERPT, "--html", "report.pdf")
    assert status == 2
    assert "does not end in .html" in err


def test_files_of_any_kind_are_fitted_and_listed(run, tmp_path):
    """The default path: per recording, unusable files of a folder listed with the reason."""
    folder = tmp_path / "mixed"
    folder.mkdir()
    for name in ("19_step_input_data", "circles_27_sept_2024"):
        for file in sorted((EXCERPT / name).glob("*.csv.gz"))[:3]:
            shutil.copy(file, folder / f"{name[:2]}_{file.name}")
    (folder / "broken.csv").write_text("a,b\n1,2\n")
    status, document, _ = run("friction", folder, "--json")
    assert status in (0, 1)
    assert set(document["fits"]) == {"friction"}
    assert len(document["files"]) == 5
    broken = next(r for f, r in document["files"].items() if f.endswith("broken.csv"))
    assert broken["used"] == 0
    assert "not a DART recording" in broken["why"][0]
    dead = next(r for f, r in document["files"].items() if "ci_" in f)
    assert any("encoder dead" in why for why in dead["why"])
    fit = document["fits"]["friction"]
    assert set(fit) >= FIT_KEYS
    if fit["sound"]:
        model = load_model(tmp_path / document["model"])
        assert model.friction["a"].value == fit["parameters"]["a"]["value"]
        assert all(len(v) == 64 for v in model.provenance["files"].values())
    else:
        assert document["model"] is None


@pytest.mark.slow
def test_a_joint_fit_predicts_a_day_that_it_has_not_observed(run, tmp_path):
    """Fitted to two days of September, judged on one of July compared with its base."""
    train = [EXCERPT / name for name in ("81_throttle_ramps", "91_free_driving_16_sept_2024")]
    status, document, _ = run("all", "--joint", *train, EXCERPT / "19_step_input_data", "--json")
    assert status == 0
    assert {name: fit["sound"] for name, fit in document["fits"].items()} == dict.fromkeys(
        NAMES, True)
    model = load_model(tmp_path / document["model"])
    assert set(model.covariance) == {"joint"}
    assert len(model.provenance["files"]) == len(model.provenance["reference"]) == 2
    unused = [why for f, r in document["files"].items() if "19_step" in f for why in r["why"]]
    assert any("no motion capture" in why for why in unused)
    recordings, _ = read_any([EXCERPT / "60_racetrack_lap_v_060"])
    rms = [evaluate(car, recordings, limit=False).model.rmse(1.0)
           for car in (PAPER, vehicle_of(model))]
    for channel in ("vx", "yaw_rate", "position"):
        assert rms[1][channel] < 0.5 * rms[0][channel], channel


@pytest.mark.slow
def test_a_joint_fit_that_identifies_nothing_writes_nothing(run, tmp_path):
    """Of a car that steers, but whose log repeats one steering command."""
    (file,) = (EXCERPT / "91_free_driving_16_sept_2024").glob("*.csv.gz")
    with gzip.open(file, "rt", newline="") as stream:
        rows = list(csv.DictReader(stream))
    with (tmp_path / "constant.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows({**row, "steering": "-0.23"} for row in rows)
    status, document, _ = run("all", "--joint", "--reference=0.115,0.01,-0.01",
                              tmp_path / "constant.csv", "--json")
    assert status == 1
    assert document["model"] is None
    assert not any(one for fit in document["fits"].values() for one in fit["identifiable"].values())
    assert "identify none" in document["left_out"]["tyres"]


@pytest.mark.slow
def test_a_joint_fit_is_not_its_own_prior(run, tmp_path):
    """The same recordings again give the same: values, errors, and those of mass and inertia."""
    files = [EXCERPT / "91_free_driving_16_sept_2024"]
    written = []
    for _ in range(2):
        run("all", "--joint", *files, "--json")
        model = load_model(tmp_path / "model.toml")
        written.append({section: getattr(model, section) for section in (*SECTIONS, "body")})
    assert written[1] == written[0]
    assert written[0]["body"]["yaw_inertia"].std > 0.0


@pytest.mark.slow
def test_a_joint_fit_needs_motion_capture_and_all_sub_models(run, tmp_path):
    status, document, _ = run("all", "--joint", EXCERPT / "19_step_input_data", "--json")
    assert status == 2
    assert "no motion capture" in document["error"]["found"]
    status, document, _ = run("motor", "--joint", EXCERPT / "91_free_driving_16_sept_2024",
                              "--json")
    assert status == 2
    assert not (tmp_path / "model.toml").exists()


@pytest.mark.slow
def test_a_joint_fit_has_one_row_pictures_and_a_next_step(run, tmp_path):
    pytest.importorskip("matplotlib")
    status, out, err = run("all", "--joint", EXCERPT / "91_free_driving_16_sept_2024", "--plots",
                           "pics")
    assert status == 0
    table = out.split("residuals")[1].split("\n\n")[0]
    assert len(re.findall(r"typical error", table)) == 1
    assert "paper's" not in table
    assert err.index("written: model.toml") < err.index("picture: pics/")
    assert (tmp_path / "pics" / "tyres.png").exists()
    assert "next: dart-hal evaluate --model model.toml" in err


@pytest.mark.slow
def test_a_failed_picture_costs_only_the_picture(run, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")

    def fail(*_):
        raise UsageError("no room for pictures")
    monkeypatch.setattr("dart_lab.identification.plots.draw", fail)
    status, out, err = run("friction", "--as-paper", EXCERPT, "--plots", "pics", "--out", "m.toml")
    assert status == 2
    assert "1.726 +- 0.021" in out
    assert err.index("written: m.toml") < err.index("no room")
    assert (tmp_path / "m.toml").exists()


@pytest.mark.slow
def test_pictures_of_recordings(run, tmp_path):
    pytest.importorskip("matplotlib")
    files = sorted((EXCERPT / "10_step_input_data_rubbery_floor").glob("*14_59_59*"))
    _, document, _ = run("friction", *files, "--plots", "pics", "--dry-run", "--json")
    identified = document["fits"]["friction"]["n"] > 0  # one short file may not identify it
    expected = {"step_response.png"} | ({"friction.png"} if identified else set())
    assert {Path(p).name for p in document["plots"]} == expected
    assert document["model"] is None


def test_the_base_model_round_trips():
    assert vehicle_of(model_of(PAPER)) == PAPER
