"""What verbs print on stdout: for machines the fields of the contracts, else the answer alone."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from dart_hal.cli import main
from dart_hal.cli.main import list_verbs, load_command
from tests.common import EXCERPT, MOCK_7_URL
from tests.pages import foreign

RUN_FIELDS = {"url", "files", "duration_s", "frames", "lost", "summary"}


@pytest.mark.parametrize("name", list_verbs())
def test_every_verb_explains_itself(verb, name):
    shown = verb(name, "--help")
    assert shown.code == 0
    assert "Usage: dart-hal" in shown.out
    whole = load_command(name)
    assert whole.help
    leaves = getattr(whole, "commands", {name: whole}).values()
    for command in leaves:
        options = {o for p in command.params for o in p.opts}
        assert "--json" in options
        assert all(p.help for p in command.params if p.param_type_name == "option")


@pytest.mark.parametrize(("given", "kept"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "3"}, "3")])
def test_linear_algebra_has_one_thread_unless_requested(given, kept):
    """Before numpy is there to read it: the order of sums, and with it an answer, hangs on it."""
    code = ("import sys, os, dart_hal.cli; assert 'numpy' not in sys.modules; "
            "print(os.environ['OPENBLAS_NUM_THREADS'])")
    left = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    output = subprocess.run([sys.executable, "-c", code], env={**left, **given}, check=True,
                            capture_output=True, text=True)
    assert output.stdout.strip() == kept


def test_the_list_of_verbs(verb):
    shown = verb("--help")
    assert all(name in shown.out for name in list_verbs())
    assert "dart-hal" in verb("--version").out


def test_help_lists_each_verb_once_and_in_a_group(verb):
    groups = main.group_verbs()
    assert list(groups) == ["start", "measure", "model", "drive", "look", "data", "service"]
    assert sorted(name for verbs in groups.values() for name in verbs) == sorted(list_verbs())
    printed = verb("--help").out
    assert printed.index("Start:") < printed.index("  doctor") < printed.index("Service:")


def test_verbs_of_other_packages_are_listed_in_a_group_of_ours_or_the_last(monkeypatch):
    added = {"weigh": "weigh the car", "tow": "tow the car", "stop": "replaced"}
    groups = {"measure": ("weigh",), "towing": ("tow",), "look": ("stop",)}
    table = SimpleNamespace(VERB_GROUPS=groups)
    monkeypatch.setattr(main, "list_plugins", lambda group: {
        "theirs": SimpleNamespace(module="their.cli")})
    monkeypatch.setattr(main, "load_entry", lambda entry: added)
    monkeypatch.setattr(main, "import_module", lambda name: table)
    groups = main.group_verbs()
    assert groups["measure"]["weigh"] == "weigh the car"
    assert groups["other"] == {"tow": "tow the car"}
    assert groups["drive"]["stop"] == main.VERBS["stop"]
    assert "stop" not in groups["look"]


@pytest.mark.parametrize(("line", "completions"), [
    ("dart-hal cal", ["calibrate"]), ("dart-hal no_such_verb --", []),
    ("dart-hal follow --track", ["--tracker"]),
    ("dart-hal follow --tracker pur", ["pursuit"])])
def test_the_shell_completes_verbs_options_and_choices(verb, monkeypatch, line, completions):
    monkeypatch.setenv("_DART_HAL_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(len(line.split()) - 1))
    words = [row.partition(",")[2] for row in verb().out.splitlines()]
    assert [word for word in words if word not in ("--version", "--help")] == completions


def test_a_verb_of_another_package_takes_no_name_of_ours(monkeypatch):
    added = {"stop": "does something else", "weigh": "weigh the car"}
    entry = SimpleNamespace(module="their.cli")
    monkeypatch.setattr(main, "list_plugins", lambda group: {"theirs": entry})
    monkeypatch.setattr(main, "load_entry", lambda entry: added)
    assert main.list_verbs()["stop"] == (main.VERBS["stop"], "dart_hal.cli")
    assert main.list_verbs()["weigh"] == ("weigh the car", "their.cli")


@pytest.mark.parametrize(("arguments", "answer"), [
    (("sim", "--reveal", "--url", MOCK_7_URL), "steering.backlash"),
    (("doctor", "--url", MOCK_7_URL, "--seconds", 1), "the car will drive"),
    (("record", "--url", MOCK_7_URL, "--duration", 0.3), "frames, 0 lost"),
    (("data", "check", EXCERPT / "circles_27_sept_2024"), "good for evaluation"),
    (("identify", "friction", "--as-paper", EXCERPT, "--dry-run"), "+- 0.021 N"),
])
def test_the_answer_is_on_standard_output_alone(verb, arguments, answer):
    ran = verb(*arguments)
    assert ran.code == 0
    assert answer in ran.out
    assert answer not in ran.err


@pytest.mark.long
def test_demo(verb, tmp_path, monkeypatch):
    monkeypatch.setattr("dart_lab.demo.real.find_excerpt", lambda: None)
    done = verb("demo", "--url", MOCK_7_URL, "--out", tmp_path / "demo", "--json")
    assert done.code == 0, done.err
    result = done.json
    assert set(result) >= RUN_FIELDS
    summary = result["summary"]
    assert set(summary) >= {"steering_rms_deg", "odometry_error_m", "distance_m"}
    assert 0 < summary["steering_rms_deg"] < 0.5
    assert summary["distance_m"] > 15
    assert result["frames"] > 3000
    for path in result["files"].values():
        assert (tmp_path / path).stat().st_size > 0
    diagnosis = summary["diagnosis"]
    sizes = {h["effect"]: h["parameters"]["k"]["value"] for h in diagnosis["hidden"]}
    found = {c["effect"]: c for c in diagnosis["causes"]}
    page = (tmp_path / "demo" / "index.html").read_text()
    assert all(name in page for name in sizes)
    assert "diagnosis.html" in page
    assert summary["real_car"] == {"skipped": summary["real_car"]["skipped"]}
    assert "diagnosis_real" not in result["files"]
    assert "Skipped:" in page
    for name in ("index.html", "diagnosis.html"):
        assert not foreign((tmp_path / "demo" / name).read_text())
    assert diagnosis["named"] is True
    assert set(found) == set(sizes)
    for name, size in sizes.items():
        assert found[name]["parameters"]["k"]["value"] == pytest.approx(size, rel=0.3)
        assert found[name]["gain"]["test"] > 0.05


@pytest.mark.slow
def test_calibrate_steering(verb, tmp_path):
    cars = tmp_path / "cars"
    done = verb("calibrate", "steering", "--url", MOCK_7_URL, "--cars", cars, "--json")
    result = done.json
    assert set(result) >= {"car", "source", "n", "duration_s", "map", "paper_form",
                           "residual_rms_rad", "backlash_rad", "written", "notes"}
    table = result["map"]
    assert set(table) >= {"command", "pulse_us", "angle_rad", "angle_std_rad"}
    assert len(table["command"]) >= 9
    assert table["command"] == sorted(table["command"])
    assert (table["command"][0], table["command"][-1]) == (-1.0, 1.0)
    assert len({len(column) for column in table.values()}) == 1
    assert set(result["paper_form"]) == {"k_left", "a_left_rad", "s0", "a_right_rad", "k_right"}
    assert set(result["backlash_rad"]) == {"value", "std"}
    assert result["written"] == str(cars / "sim-7" / "calibration.toml")
    assert result["car"] == "sim-7"


@pytest.mark.slow
def test_calibrate_from_takes_every_path_up_to_the_next_option(verb, tmp_path):
    runs = [tmp_path / "one.mcap", tmp_path / "two.mcap"]
    script = tmp_path / "weave.py"
    script.write_text("from math import sin\n"
                      "def control(state):\n"
                      "    return 0.35 * sin(0.4 * state.t), 0.32\n")
    # Not the same drive twice: a copy of a recording is left out.
    for run, seconds in zip(runs, (25, 26), strict=True):
        done = verb("drive", script, "--url", MOCK_7_URL, "--record", run, "--duration", seconds,
                    "--json")
        assert done.json["frames"] > 2000
    result = verb("calibrate", "steering", "--from", *runs, "--dry-run", "--json").json
    assert result["written"] is None
    assert not list(tmp_path.rglob("calibration.toml"))
    assert [str(s) for s in result["source"]] == [str(r) for r in runs]
    one = verb("calibrate", "steering", "--from", runs[0], "--dry-run", "--json").json
    assert result["n"] > 1.5 * one["n"]
    assert verb("calibrate", "steering", "--from", tmp_path / "none.mcap",
                "--json").error["code"] == "D-REC-01"


@pytest.mark.slow
def test_record_and_replay(verb, tmp_path):
    run = tmp_path / "runs" / "run.mcap"
    table = tmp_path / "run.csv"
    recorded = verb("record", "--url", MOCK_7_URL, "--duration", 1, "--out", run, "--json").json
    assert set(recorded) == RUN_FIELDS
    assert recorded["files"]["recording"] == str(run)
    assert recorded["url"] == MOCK_7_URL
    replayed = verb("replay", run, "--out", table, "--json").json
    assert set(replayed) == RUN_FIELDS
    assert replayed["frames"] == recorded["frames"]
    assert replayed["summary"]["states_sha256"] == recorded["summary"]["states_sha256"]
    assert len(table.read_text().splitlines()) == replayed["frames"] + 1
    assert f"{replayed['frames']} frames in" in verb("replay", run).out


@pytest.mark.slow
def test_drive_by_script(verb, tmp_path):
    script = tmp_path / "ahead.py"
    script.write_text("def control(state):\n    return None if state.t > 4 else (0.1, 0.3)\n")
    done = verb("drive", script, "--url", MOCK_7_URL, "--duration", 9, "--json").json
    assert set(done) == RUN_FIELDS
    assert done["duration_s"] < 5
    assert done["summary"]["distance_m"] > 0.2


def test_sim_reveal(verb):
    truth = verb("sim", "--reveal", "--url", MOCK_7_URL, "--json").json
    assert set(truth) >= {"seed", "vehicle", "steering", "sensors", "effects"}
    assert truth["seed"] == 7
    assert truth["mocap"] is None
    assert len(truth["steering"]["command"]) == len(truth["steering"]["angle_rad"]) >= 201
    assert {"encoder.ring", "imu.gyro_bias", "pwm.oscillator_hz", "steering.backlash",
            "latency.pulse_to_wheel"} <= set(truth["sensors"])
    other = verb("sim", "--reveal", "--url", "sim://?seed=8", "--json").json
    assert other["steering"]["angle_rad"] != truth["steering"]["angle_rad"]
    even = verb("sim", "--reveal", "--url", MOCK_7_URL + "&ring=even", "--json").json
    assert even["sensors"]["encoder.ring"] == pytest.approx([1.0] * 20)
    assert truth["sensors"]["encoder.ring"] != pytest.approx([1.0] * 20, abs=1e-3)


@pytest.mark.slow
def test_top(verb):
    assert set(verb("top", "--url", MOCK_7_URL, "--duration", 0.3, "--json").json) == RUN_FIELDS
    shown = verb("top", "--url", MOCK_7_URL, "--duration", 0.3)
    assert shown.code == 0
    assert "yaw rate" in shown.err
    assert shown.out == ""


@pytest.mark.slow
def test_wire(verb):
    table = verb("wire", "--json").json
    assert {m["name"] for m in table["messages"]} >= {"STATE", "HELLO", "HEARTBEAT"}
    assert "| STATE" in verb("wire").out or "STATE" in verb("wire").out
    assert "namespace dart" in verb("wire", "--format", "c").out
    checked = verb("wire", "--check", "--json")
    assert checked.json == {"drift": []}
    assert checked.code == 0


@pytest.mark.slow
def test_as_a_program(tmp_path):
    """The entry point in a process of its own: stdout is JSON, notices are elsewhere."""
    done = subprocess.run(
        [sys.executable, "-m", "dart_hal.cli.main", "record", "--url", MOCK_7_URL, "--duration",
         "0.2",
         "--json"], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["frames"] > 10
    assert (tmp_path / "runs" / "run.mcap").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("verb", [("wire",), ("wire", "--json"), ("sim", "--reveal")])
def test_a_reader_that_has_enough_is_no_failure(verb, tmp_path):
    """As `| head` closes its end: what is left to do is done, and nothing is complained of."""
    with subprocess.Popen([sys.executable, "-m", "dart_hal.cli.main", *verb], cwd=tmp_path,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        output = process.stderr.read()
    assert (process.returncode, output) == (0, "")
