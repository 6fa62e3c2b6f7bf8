"""``dart-hal diagnose``: from files to JSON, page and model; and what it refuses."""

from __future__ import annotations

import json
import shlex
import shutil
from dataclasses import replace

import pytest

from dart_hal.cli.common.output import count_notices
from dart_hal.cli.main import main
from dart_hal.core.config import load_model
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis.result import Possible
from dart_lab.pages.diagnose_table import show, show_full
from studies.diagnosis import hidden_drive
from tests.diagnosis import made_by_hand as made

KEYS = {"verdict", "base", "causes", "considered", "unexplained", "extended", "ctrv", "runtime_s",
        "files", "seed"}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drives")
    return [hidden_drive.write(folder / f"car_1_{seed}.csv", made.HIDDEN, seed=seed,
                               plan=hidden_drive.Plan(seconds=45.0)) for seed in (11, 12)]


@pytest.fixture
def run(capsys):
    def call(*words):
        with pytest.raises(SystemExit) as ended:
            main(["diagnose", *map(str, words)])
        out, err = capsys.readouterr()
        return ended.value.code, (json.loads(out) if "--json" in words else out), err
    return call


POSSIBLE_CAUSES = tuple(Possible("mass", "is heavier", 0.9, 40.0) for _ in range(10))


@pytest.fixture(scope="module")
def whole(files, tmp_path_factory):
    """One real diagnosis: its answer, page and model."""
    import contextlib
    import io

    folder = tmp_path_factory.mktemp("out")
    out = io.StringIO()
    words = ["diagnose", "--no-refit", "--train", files[0], "--test", files[1], "--only",
             "steering_lag", "--only", "gyro_scale", "--only", "grip", "--html",
             folder / "report.html", "--out", folder / "model.toml", "--json"]
    with contextlib.redirect_stdout(out), pytest.raises(SystemExit) as ended:
        main([str(w) for w in words])
    return ended.value.code, json.loads(out.getvalue()), folder


def test_the_hidden_effects_are_named_and_the_answer_has_its_shape(whole):
    code, answer, _ = whole
    assert code == 0
    assert set(answer) >= KEYS
    assert {c["effect"] for c in answer["causes"]} == {"steering_lag", "gyro_scale"}
    lag = next(c for c in answer["causes"] if c["effect"] == "steering_lag")
    assert abs(lag["parameters"]["k"]["value"] - 0.12) < 0.02
    assert lag["gain"]["test"] > 0.3
    named = {c["effect"] for c in answer["considered"]}
    assert named <= {"grip", "steering_lag", "gyro_scale"}
    assert [f["role"] for f in answer["files"].values()] == ["train", "test"]


def test_the_page_is_written_with_the_command_in_it(whole):
    _, answer, folder = whole
    text = (folder / "report.html").read_text(encoding="utf-8")
    assert answer["report"] == str(folder / "report.html")
    assert "--only steering_lag" in text
    assert "steering_lag" in text


def test_the_extended_model_is_a_model_with_its_effects_and_their_errors(whole, files):
    _, answer, folder = whole
    model, p = find_model(folder / "model.toml")
    assert answer["extended"]["model"] == str(folder / "model.toml")
    assert {a.name for a in p.effects} == {"steering_lag", "gyro_scale"}
    for cause in answer["causes"]:
        entry = next(e for e in load_model(folder / "model.toml").effects
                     if e.name == cause["effect"]).parameters["k"]
        assert (entry.value, entry.std) == pytest.approx(
            (cause["parameters"]["k"]["value"], cause["parameters"]["k"]["std"]), rel=1e-3)
    assert p.friction == PAPER.friction
    assert list(model.provenance["files"]) == [f"{files[0].parent.name}/{files[0].name}"]
    assert "dart-hal diagnose" in model.provenance["command"]


@pytest.mark.slow
def test_diagnosing_a_model_on_what_it_was_fitted_to_is_reported(whole, files, run):
    _, _, folder = whole
    code, answer, err = run("--model", folder / "model.toml", "--no-refit", "--train", files[1],
                            "--test", files[0], "--only", "grip", "--max-causes", 0, "--json")
    assert code == 0
    assert answer["causes"] == []
    assert "fitted to 1 of the test recordings" in " ".join(answer["notes"])
    assert "fitted to 1 of the test recordings" in err


def test_the_terminal_shows_verdict_causes_errors_and_doubts(capsys):
    show_full(made.diagnosis())
    text = " ".join(capsys.readouterr().out.split())
    for words in ("one cause in the motion and one in the sensors explain part of it",
                  "additional time constant of the steering 118.7 +- 4.3 ms",
                  "do not distinguish it from a car that takes longer or less long to begin",
                  "(yaw_inertia) or turns its wheels no faster than a limit (steering_rate_limit)",
                  "not explained: Speed: 17 % of the variance of its error follows speed and time",
                  "yaw rate [rad/s] 1.45 0.378 0.378 0 % 0.0564 -85 %",
                  "hard to believe: weaker than"):
        assert words in text


def test_the_terminal_takes_a_dozen_lines(capsys):
    show_full(replace(made.diagnosis("explained", 1, False), considered=(), refitted={}))
    assert len(capsys.readouterr().out.splitlines()) <= 12


def test_without_full_the_verdict_takes_three_lines_and_all_with_its_causes_ten(capsys):
    show(made.diagnosis())
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("The model is wrong: one cause in the motion")
    assert lines[1].startswith("errors 1 s ahead on the test recordings: speed 0.0276 -> 0.023 m/s")
    assert lines[2].startswith("First: ")
    assert lines[3] == "  gyro_scale improves no prediction of the motion."
    assert lines[4].startswith("  accepted: turns its wheels more slowly (steering_lag); 118.7")
    assert len(lines) == 6
    many = replace(made.diagnosis(), possible=POSSIBLE_CAUSES)
    show(many)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 11
    assert lines[-1].endswith("and 6 more (--full)")


def test_notices_are_counted_and_listed_by_full(capsys):
    count_notices(("one", "two"), full=False)
    assert capsys.readouterr().err == "2 notices (--full)\n"
    count_notices(("one", "two"), full=True)
    assert capsys.readouterr().err == "notice: one\nnotice: two\n"
    count_notices((), full=False)
    assert capsys.readouterr().err == ""


def test_the_terminal_states_no_step_where_nothing_was_changed(capsys):
    d = made.diagnosis("nothing_wrong", 0, False)
    show(replace(d, refitted={}, stages=d.stages[:1]))
    text = capsys.readouterr().out
    assert "->" not in text
    assert "refitted" not in text


@pytest.mark.long
def test_without_json_the_sentences_are_on_standard_output_and_notices_are_not(files, run):
    code, out, err = run("--no-refit", "--train", *files, "--only", "steering_lag",
                         "--only", "gyro_scale", "--full")
    assert code == 0
    for words in ("steering_lag: The car turns", "constant velocity", "on the test recordings"):
        assert words in out
    assert "40 % of each training recording" in err


@pytest.mark.parametrize(("words", "message"), [
    ([], "no recording to train on"),
    (["--train", "{0}", "--only", "steering_lug"], "steering_lag"),
    (["--train", "{0}", "--only", "grip", "--exclude", "grip"], "no effect is left"),
    (["--train", "{0}", "--test", "{0}"], "the test recordings are the training recordings"),
    (["--train", "{0}", "{1}", "--test", "{1}"], "1 recording(s)"),
    (["--train", "{0}", "--model", "nobody"], "no model is called"),
    (["--train", "model.toml"], "is a model, no recording"),
    (["--train", "{0}", "--html", "report.pdf"], "does not end in .html"),
    (["--train", "{0}", "--out", "model.json"], "does not end in .toml"),
    (["--train", "{0}", "--false-alarm", "nan"], "finite"),
    (["--train", "nowhere"], "nowhere"),
    (["--train", "{0}", "--only", "grip", "mass"], "mass follows no option"),
    (["{0}"], "follows no option"),
])
@pytest.mark.slow_except("words[0-2]*", "words[5-9]*")
def test_bad_input_ends_with_2_and_a_reason(words, message, files, run):
    code, answer, err = run(*(w.format(*files) for w in words), "--json")
    assert code == 2
    assert set(answer) == {"error"}
    assert set(answer["error"]) == {"code", "what", "found", "expected", "likely", "try", "read"}
    assert message in err


@pytest.mark.slow
def test_a_copy_under_another_name_is_still_the_same_recording(files, run, tmp_path):
    copy = tmp_path / "another_day.csv"
    shutil.copy(files[0], copy)
    code, answer, _ = run("--train", files[0], "--test", copy, "--json")
    assert code == 2
    assert "the test recordings are the training recordings" in answer["error"]["what"]


@pytest.mark.slow
def test_the_next_command_has_the_marker_frame_and_runs(run, files, tmp_path):
    _, _, err = run("--no-refit", "--max-causes", "0", "--reference=-0.09,0.01,0", "--train",
                    files[0], "--test", files[1], "--out", tmp_path / "m.toml")
    (line,) = [line for line in err.splitlines() if line.startswith("next: ")]
    words = shlex.split(line.removeprefix("next: dart-hal "))
    assert "--reference=-0.09,0.01,0.0" in words
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 0
