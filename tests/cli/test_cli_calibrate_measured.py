"""What the measuring `calibrate` verbs ask, print and write."""

from __future__ import annotations

import json
import math

import pytest

from dart_hal.cli.common.bench import TerminalOperator, confirm
from dart_hal.core.config import parse_calibration
from dart_hal.core.errors import CalibrationFailed

ENCODER = ("calibrate", "encoder", "--url", "sim://?seed=4&nano=mock", "--distance", "1",
           "--runs", "1", "--json")


def test_typed_answers_become_si_units():
    answers = iter([3.012, 1080.0, 1.67])
    calls = []
    shop = TerminalOperator(lambda: calls.append("pause"), lambda: calls.append("resume"),
                         lambda question: next(answers))
    assert shop.distance() == 3.012
    assert shop.turns() == pytest.approx(6.0 * math.pi)
    assert shop.mass()[0] == 1.67
    assert calls == ["pause", "resume"] * 3


def test_without_a_terminal_nothing_starts(monkeypatch, tmp_path):
    with (tmp_path / "empty").open("w+") as no_terminal:
        monkeypatch.setattr("sys.stdin", no_terminal)
        with pytest.raises(CalibrationFailed, match="no terminal"):
            confirm("This drives.", yes=False)
        with pytest.raises(CalibrationFailed, match="no terminal"):
            TerminalOperator().mark()
        with pytest.raises(CalibrationFailed, match="no terminal"):
            TerminalOperator().distance()
        with pytest.raises(CalibrationFailed, match="no terminal"):
            TerminalOperator().lift()
        with pytest.raises(CalibrationFailed, match="no terminal"):
            TerminalOperator().push()
        assert confirm("This drives.", yes=True)


@pytest.mark.slow
@pytest.mark.parametrize("dry", [True, False])
def test_encoder_writes_unless_it_is_a_dry_run(verb, tmp_path, dry):
    result = verb(*ENCODER, "--cars", str(tmp_path), *(["--dry-run"] if dry else []))
    found = json.loads(result.out)
    assert set(found["quantities"]) == {"encoder.metres_per_edge", "encoder.ring"}
    assert found["quantities"]["encoder.metres_per_edge"]["unit"] == "m"
    assert len(found["quantities"]["encoder.ring"]["value"]) == 20
    files = list(tmp_path.rglob("calibration.toml"))
    assert [str(f) for f in files] == ([] if dry else [found["written"]])


@pytest.mark.parametrize(("act", "typed", "meant"), [
    ("push", "yes", True), ("push", "no", False), ("wheels_turned", "backward", -1),
    ("wheels_turned", "what\nforward", 1), ("lift", "", None)])
def test_what_eyes_and_hands_find_is_chosen(monkeypatch, capsys, act, typed, meant):
    answers = iter([*typed.split("\n")])
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("click.termui.visible_prompt_func", lambda prompt: next(answers))
    assert getattr(TerminalOperator(), act)() == meant
    assert ("not one of" in capsys.readouterr().err) == ("what" in typed)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "inside"), [("esc", "neutral_us"), ("throttle", "drive")])
@pytest.mark.long_except("esc-*")
def test_esc_and_throttle_write_unless_it_is_a_dry_run(verb, tmp_path, name, inside):
    where = ("calibrate", name, "--url", "sim://?seed=5&nano=mock", "--cars", str(tmp_path))
    dry = verb(*where, "--dry-run", "--json").json
    assert dry["written"] is None
    assert not list(tmp_path.rglob("calibration.toml"))
    picture = tmp_path / "throttle.png"
    result = verb(*where, *(["--plot", str(picture)] if name == "throttle" else []))
    assert picture.is_file() == (name == "throttle")
    text = (tmp_path / "sim-5" / "calibration.toml").read_text()
    assert f"{inside} = " in text
    source = parse_calibration(text, "calibration.toml", "sim-5").provenance[name]
    assert source["source"] == where[3]
    assert source["duration_s"] > 10
    assert f"throttle.{inside}" in result.out
    assert {**dry["quantities"], **dry["others"]}[f"throttle.{inside}"]


def test_a_failure_is_one_error_object_and_writes_nothing(verb, tmp_path):
    ran = verb("calibrate", "esc", "--url", "sim://?seed=5&nano=mock&fail=wheel:stuck@0", "--json",
               "--cars", str(tmp_path))
    assert ran.error["what"] == "a wheel is blocked"
    assert not list(tmp_path.rglob("calibration.toml"))


CLOCK_COMMAND = ("calibrate", "clock", "--frequency", 50.0, "--std", 0.01, "--yes", "--url",
                 "sim://?seed=3&nano=mock")


def test_measurement_is_written_where_cars_names(verb, tmp_path, monkeypatch):
    """Though the car has a folder elsewhere: it was written there, and not found."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "share"))
    home = tmp_path / "share" / "dart-hal" / "cars" / "sim-3" / "calibration.toml"
    assert verb(*CLOCK_COMMAND).code == 0
    assert home.is_file()
    before = home.read_bytes()
    assert verb(*CLOCK_COMMAND, "--cars", "wr").code == 0
    assert (tmp_path / "wr" / "sim-3" / "calibration.toml").is_file()
    monkeypatch.setenv("DART_CARS", "named")
    assert verb(*CLOCK_COMMAND).code == 0
    assert (tmp_path / "named" / "sim-3" / "calibration.toml").is_file()
    assert home.read_bytes() == before


@pytest.mark.parametrize("what", ["clock", "steering", "all"])
@pytest.mark.slow_except("clock", "steering")
def test_folder_that_cannot_be_written_is_refused_before_the_car_moves(verb, tmp_path, monkeypatch,
                                                                       what):
    def drives(*args, **options):
        raise AssertionError("the car was driven")

    monkeypatch.setattr("dart_hal.calibration.steering.drive", drives)
    monkeypatch.setattr("dart_hal.calibration.clock.typed_clock", drives)
    (tmp_path / "wr").mkdir()
    (tmp_path / "wr" / "sim-3").write_text("a file in the place of the folder")
    rest = CLOCK_COMMAND[2:] if what == "clock" else CLOCK_COMMAND[6:]
    error = verb("calibrate", what, *rest, "--cars", "wr", "--json").error
    assert error["code"] == "D-FILE-04"
    assert "wr/sim-3" in error["what"]
