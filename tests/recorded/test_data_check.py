"""``data check``: what is in a recording, what is wrong with it, what it is good for."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dart_hal.car.runs import read_any
from dart_hal.cli.main import main
from dart_hal.recording.check import DONE, check, summary
from dart_hal.recording.check.facts import marks, named_time
from dart_hal.recording.check.findings import DROPPED_KINDS
from dart_hal.recording.check.uses import _friction, _motor
from dart_hal.recording.dart import read, read_all
from dart_hal.recording.dart.reference import SEP_24
from dart_lab.pages.data_show import wrap_name


@pytest.fixture
def cli(capsys, monkeypatch, tmp_path):
    """``cli(FILES...)`` -> (exit code, the JSON object, what people read)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DART_DATA", raising=False)

    def run(*args):
        outputs = []
        for more in (("--json",), ()):
            with pytest.raises(SystemExit) as left:
                main(["data", "check", *(str(a) for a in args), *more])
            captured = capsys.readouterr()
            assert "Traceback" not in captured.out + captured.err
            outputs.append((int(left.value.code or 0), captured))
        (code, first), (again, second) = outputs
        assert code == again
        assert (second.out == "") == (code == 2), "an answer or a refusal"
        return code, json.loads(first.out), second.out or second.err
    return run


def kinds(c) -> dict[str, int]:
    return {f.kind: f.rows for f in c.findings}


def check_part(excerpt, part: str):
    return check(read(next(excerpt.rglob(f"*{part}*.csv.gz"))))


# ---- real files: what is known of them

@pytest.mark.parametrize(("part", "good", "found"), [
    ("15_28_11", {"friction", "motor"}, {"rounded", "accelerometer_tilt"}),
    ("17_28_09", {"friction", "tyres", "evaluation"}, {"held_copies", "not_started"}),
    ("racetrack", {"motor", "steering", "evaluation"}, {"false_lock", "gate", "outliers"}),
    ("12_06_55", {"evaluation"}, {"encoder_dead"}),
    ("2025-04-24", {"steering", "delay", "tyres", "evaluation"}, {"derived", "yaw_wraps"}),
    ("11_40_46", {"steering", "delay"}, {"not_measured"}),
    ("drifting", {"tyres", "evaluation"}, {"slip"}),
    ("14_54_30", set(), {"encoder_zero", "never_moves"}),
])
@pytest.mark.slow_except("1[24]*", "2025*", "drifting-*", "15*")
def test_a_real_file_of_each_kind(excerpt, part, good, found):
    c = check_part(excerpt, part)
    assert good <= set(c.good_for)
    assert found <= set(kinds(c))
    if not good:
        assert c.verdict.startswith("good for nothing: the car never moves")


@pytest.mark.parametrize(("seconds", "short"), [(2.9, True), (3.0, False)])
def test_a_recording_that_no_fit_can_use_alone_states_what_is_missing(seconds, short):
    step = 0.02
    rows = np.ones(round(seconds / step), dtype=np.bool_)
    throttle = np.ones(len(rows))
    for use in (_friction(rows, "encoder", step), _motor(rows, throttle, "encoder", step)):
        assert use.good
        assert (f"straight for {seconds} s (a fit needs 3 s" in use.why) == short


def test_rows_of_the_tyre_recording_add_up(excerpt):
    c = check_part(excerpt, "17_28_09")
    dropped = [f for f in c.findings if f.effect == "dropped"]
    assert {f.kind for f in dropped} == {"not_started", "held_copies"}
    assert c.facts.rows - sum(f.rows for f in dropped) == c.facts.messages
    assert c.facts.mocap.windows == 270


@pytest.mark.slow
def test_false_lock_of_the_race_track_is_29_per_cent(excerpt):
    c = check_part(excerpt, "racetrack")
    assert c.facts.mocap.false_lock == pytest.approx(0.29, abs=0.005)
    assert c.facts.mocap.windows == 171
    assert c.motion.fitted.lx == pytest.approx(0.0862, abs=0.006)
    assert next(f for f in c.findings if f.kind == "false_lock").serious


@pytest.mark.parametrize(("quantum", "n"), [
    (0.0516, 8), (0.02294, 18), (0.0412708, 10), (0.020646, 20), (0.045, None), (None, None)])
def test_marks_of_the_ring(quantum, n):
    assert marks(quantum) == n


@pytest.mark.slow
def test_name_against_the_sensor_clock(excerpt):
    recordings, _ = read_all([excerpt / "19_step_input_data", excerpt / "29_step_input_data"])
    notes = summary([check(r) for r in recordings]).notes
    late = [n for n in notes if "in spite of its name" in n]
    assert len(late) == 1
    assert "15_28_11" in late[0]
    assert any("encoder constants" in n for n in notes)
    one_folder = [check(r) for r in recordings if r.path.parent.name.startswith("29")]
    assert summary(one_folder).notes == ()


@pytest.mark.recordings
@pytest.mark.slow
def test_all_windows_and_nothing_unread(recordings):
    found, skipped = read_all([recordings])
    whole = summary([check(r) for r in found])
    assert (whole.files, whole.windows, skipped) == (83, 4724, [])


# ---- made files: each judgement against its counterpart

def test_tilt_only_at_rest(write, table_a):
    table = table_a()
    table["vel encoder"][:20], table["throttle"][:20] = 0.0, 0.0
    table["acc x (IMU)"][:20], table["acc x (IMU)"][20:] = -0.4, 0.8
    assert "(-0.40, +0.00)" in str([f.text for f in check(read(write(table))).findings])
    table["acc x (IMU)"][:20] = 0.0
    assert "accelerometer_tilt" not in kinds(check(read(write(table, "flat.csv"))))


def test_slip_is_distinguished_from_grip(write, table_b):
    def check_scaled(factor, name):
        table = table_b(speed=0.6)
        table["vel encoder"][:] = factor * 0.6
        return check(read(write(table, name)))
    assert "slip" not in kinds(check_scaled(1.0, "grip.csv"))
    spun = check_scaled(3.0, "spin.csv")
    assert next(f for f in spun.findings if f.kind == "slip").serious
    assert not {"friction", "motor", "steering"} & set(spun.good_for)


def test_one_circle_has_no_reference_point(write, table_b):
    c = check(read(write(table_b(epoch=1.9e9, speed=0.6))))
    assert c.motion.reference is None
    assert "reference_unknown" in kinds(c)
    assert c.to_json()["reference"] is None
    assert c.motion.fitted is None, "one circle fixes no reference point"


def test_one_turning_direction_is_reported_of_the_tyres(write, table_b):
    circle = read(write(table_b(n=900, speed=1.2)))
    assert not check(circle).uses["tyres"].good, "side slip hangs on a frame that is not known"
    use = check(replace(circle, marker=SEP_24)).uses["tyres"]
    assert use.good
    assert "left only" in use.why


# ---- the verb: bad input

def test_mixed_schemas_and_what_was_skipped(cli, write, table_a, table_b, tmp_path):
    straight = table_a()
    straight["steering"][:] = 0.0
    write(straight, "a.csv")
    write(table_b(), "b.csv")
    (tmp_path / "odd.csv").write_text("hello\n1\n")
    code, out, errors = cli(tmp_path)
    assert code == 0
    assert out["summary"]["schemas"] == {"A": 1, "B": 1}
    assert [s["path"] for s in out["skipped"]] == [str(tmp_path / "odd.csv")]
    assert "1 file skipped" in errors
    assert "not a DART recording" in out["skipped"][0]["reason"]


@pytest.mark.slow
def test_json_has_one_shape_for_every_schema(cli, excerpt):
    parts = ("15_28_11", "racetrack", "2025-04-24", "12_06_55")
    code, out, _ = cli(*(next(excerpt.rglob(f"*{p}*")) for p in parts))
    assert code == 0
    assert set(out) == {"files", "skipped", "summary", "plots"}
    assert len({tuple(f) for f in out["files"]}) == 1
    assert all(set(f["uses"]) == {"friction", "motor", "steering", "delay", "tyres", "evaluation"}
               for f in out["files"])
    a, b, c, dead = out["files"]
    assert (a["mocap"], c["speed_mps"], dead["speed_mps"]) == (None, None, None)
    assert (a["encoder"]["marks"], b["encoder"]["marks"]) == (8, 10)


def test_time_backwards_is_cut_and_reported(cli, write, table_a):
    table = table_a()
    table["elapsed time sensors"][30:] -= 50.0
    _, out, errors = cli(write(table))
    assert "time_back" in [f["kind"] for f in out["files"][0]["findings"]]
    assert "! sensor time steps back 1 time(s): cut there, not sorted" in errors


def test_dead_encoder_is_reported_and_not_a_speed_of_zero(cli, write, table_b):
    table = table_b(speed=0.6)
    table["vel encoder"][:] = 0.0
    _, out, errors = cli(write(table))
    assert out["files"][0]["encoder"]["state"] == "dead"
    assert out["files"][0]["speed_mps"] is None
    assert "encoder dead" in errors


def test_nothing_good_is_exit_1_with_the_reason(cli, write, table_a):
    never_moving = table_a()
    never_moving["vel encoder"][:] = 0.0
    code, out, errors = cli(write(never_moving))
    assert code == 1
    assert out["files"][0]["good_for"] == []
    assert "the car never moves" in errors
    code, out, errors = cli(write({k: v[:10] for k, v in table_a().items()}, "ten.csv"))
    assert code == 1
    assert "too short" in errors


@pytest.mark.slow_except("odd.csv")
@pytest.mark.parametrize("name", ["odd.csv", "empty", "absent.csv"])
def test_unusable_by_itself_is_exit_2(cli, write, table_a, tmp_path, name):
    (tmp_path / "odd.csv").write_text("<html>not found</html>\n")
    (tmp_path / "empty").mkdir()
    good = write(table_a(), "good.csv")
    code, out, errors = cli(good, tmp_path / name)
    assert code == 2
    assert name in out["error"]["what"]
    assert out["error"]["try"]
    assert name in errors


def test_no_files_and_no_data_folder_names_fetch(cli):
    code, out, _ = cli()
    assert code == 2
    assert "dart-hal data fetch" in out["error"]["try"]


@pytest.mark.slow
def test_without_files_the_data_folder_is_checked(cli, excerpt, monkeypatch):
    monkeypatch.setenv("DART_DATA", str(excerpt / "29_step_input_data"))
    assert cli()[1]["summary"]["files"] == 12
    monkeypatch.setenv("DART_DATA", str(excerpt))
    assert cli("40_sinusoidal_steering_data")[1]["summary"]["files"] == 9


# ---- pictures

@pytest.mark.parametrize("part", ["15_28_11", "racetrack", "2025-04-24"])
@pytest.mark.slow
def test_a_picture_of_each_schema(cli, excerpt, tmp_path, part):
    pytest.importorskip("matplotlib")
    _, out, _ = cli(next(excerpt.rglob(f"*{part}*")), "--plot", tmp_path / "one.png")
    assert out["plots"] == [str(tmp_path / "one.png")]
    assert (tmp_path / "one.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_a_folder_of_pictures_and_one_for_all(cli, excerpt, tmp_path):
    pytest.importorskip("matplotlib")
    files = sorted((excerpt / "40_sinusoidal_steering_data").glob("*"))[:2]
    out = cli(*files, "--plots", tmp_path / "new")[1]
    assert len(out["plots"]) == 3
    assert {p.name for p in (tmp_path / "new").iterdir()} == {
        "40_sinusoidal_steering_data_01_22_2024_11_39_01.png",
        "40_sinusoidal_steering_data_01_22_2024_11_40_46.png", "overview.png"}
    assert cli(*files, "--plot", tmp_path / "a.txt")[0] == 2


@pytest.mark.slow
def test_bad_samples_are_drawn_in_another_colour(excerpt, tmp_path):
    pytest.importorskip("matplotlib")
    from dart_lab.report.recordings import BAD_COLOUR, plot_check

    bad = plot_check(check_part(excerpt, "racetrack"), tmp_path / "b.svg")
    assert BAD_COLOUR in bad.read_text()
    good = plot_check(check_part(excerpt, "drifting"), tmp_path / "d.svg")
    assert BAD_COLOUR not in good.read_text()


@pytest.mark.slow
def test_finite_numbers_only_in_what_is_printed(excerpt):
    def walk(value):
        if isinstance(value, dict):
            return all(map(walk, value.values()))
        if isinstance(value, list):
            return all(map(walk, value))
        return not isinstance(value, float) or np.isfinite(value)
    assert all(walk(check_part(excerpt, p).to_json()) for p in ("racetrack", "2025-04-24",
                                                                "12_06_55"))


# ---- for people

@pytest.mark.parametrize(("name", "width", "lines"), [
    ("83_24_april_2025_slippery_floor_no_tape", 21,
     ["83_24_april_2025_", "slippery_floor_no_", "tape"]),
    ("09_09_2024_18_13_59drifting_clockwise", 19, ["09_09_2024_18_13_59", "drifting_clockwise"]),
    ("60_racetrack_lap_v_060", 44, ["60_racetrack_lap_v_060"]),
    ("2025-04-24-18-18-35", 19, ["2025-04-24-18-18-35"]),
    ("nowheretobreakthisname", 10, ["nowheretob", "reakthisna", "me"])])
def test_names_break_between_words(name, width, lines):
    assert wrap_name(name, width).split("\n") == lines


@pytest.mark.slow
def test_what_was_done_is_reported_in_sentences(cli, excerpt):
    errors = cli(*(next(excerpt.rglob(f"*{p}*")) for p in (
        "15_28_11", "racetrack", "2025-04-24", "17_28_09")))[2]
    assert "throttle logged behind a closed safety gate is 0 (" in errors
    assert "10 marks" in errors
    for word in ("negative_zero", "held_copies", "changed:", "dropped:", "N = "):
        assert word not in errors


@pytest.mark.slow
def test_every_kind_with_which_something_is_done_has_its_sentence(excerpt):
    found, _ = read_all([excerpt])
    done = {x.kind for r in found for x in check(r).findings if x.effect != "said"}
    assert len(done) > 8
    assert done | set(DROPPED_KINDS) <= set(DONE)


def test_a_run_is_dated_by_its_name():
    assert str(named_time(Path("runs/friction-20261121-130211.mcap"))) == "2026-11-21 13:02:11"
    assert named_time(Path("runs/friction-20261199-130211.mcap")) is None


def test_a_copy_of_a_file_is_left_out_and_named(tmp_path, excerpt):
    """It would count as a second recording: errors of a fit were seven times too small."""
    original = next(excerpt.rglob("*15_28_11*.csv.gz"))
    copies = [tmp_path / "a" / original.name, tmp_path / "b" / original.name]
    for copy in copies:
        copy.parent.mkdir()
        shutil.copy(original, copy)
    recordings, skipped = read_any([tmp_path, original])
    assert [r.path for r in recordings] == copies[:1]
    assert skipped == [(str(path), f"a copy of {copies[0]}") for path in (copies[1], original)]
