"""Input that cannot work: exit code 2, one error object, never a stack trace."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from dart_hal.cli import flash
from dart_hal.cli.main import main
from dart_hal.core.config import load_car
from dart_hal.core.errors import ConfigError
from tests.common import MOCK_URL

CALIBRATION = 'schema = "dart-hal/calibration/1"\ncar = "{car}"\n[steering.map]\n' \
              "pulse_us = {pulse}\nangle_rad = {angle}\nstd_rad = [0.01, 0.01, 0.01]\n{more}\n"


@pytest.mark.parametrize(("args", "code"), [
    (("bogus",), "D-USE-01"), (("record", "--bogus"), "D-USE-01"),
    (("record", "--duration", "0"), "D-USE-01"), (("record", "--duration", "x"), "D-USE-01"),
    (("drive",), "D-USE-01"), (("drive", "--keyboard"), "D-USE-01"),
    (("drive", "--keyboard", "--gamepad"), "D-USE-01"), (("drive", "none.py"), "D-USE-01"),
    (("sim",), "D-USE-01"), (("sim", "--reveal", "--pty"), "D-USE-01"),
    (("sim", "--bus", "x"), "D-USE-01"), (("sim", "--reveal", "--url", "avr://x"), "D-USE-01"),
    (("sim", "--reveal", "--url", "sim://?seed=one"), "D-USE-01"),
    (("sim", "--reveal", "--url", "sim://?seen=1"), "D-USE-01"),
    (("demo", "--url", "avr://default"), "D-USE-01"),
    (("replay",), "D-USE-01"), (("replay", "none.mcap"), "D-REC-01"),
    (("top", "--url", "hwgrep://("), "D-USE-01"),
    (("calibrate", "steering", "--url", MOCK_URL, "--yes", "--speeds", "nan", "0.3"), "D-USE-01"),
    (("top", "--url", "nope://x"), "D-LINK-01"), (("doctor", "--url", "nope://x"), "D-LINK-01"),
    (("doctor", "--url", "sim://?nano=9"), "D-USE-01"),
    (("record", "--url", "serial:///dev/ttyNONE"), "D-LINK-02"),
    (("calibrate", "steering", "--url", "serial:///dev/ttyNONE"), "D-LINK-02"),
    (("record", "--url", "replay://none.mcap"), "D-REC-01"),
    (("record", "--url", MOCK_URL, "--out", "/proc/none/run.mcap"), "D-FILE-04"),
    (("replay", "/proc/self/mem"), "D-REC-01"),
])
def test_a_request_that_cannot_work(verb, args, code):
    done = verb(*args, "--json")
    assert done.error["code"] == code
    plain = verb(*args)
    assert plain.code == 2
    assert plain.out == ""
    assert plain.err.strip()


@pytest.mark.parametrize(("text", "code"), [
    (CALIBRATION.format(car="sim-1", pulse="[1, 2, 3]", angle="[-1, 0, 1]", more=""), "D-FILE-02"),
    (CALIBRATION.format(car="sim-0", pulse="[1, 2, 3]", angle="[-1, 1, 0]", more=""), "D-FILE-03"),
    (CALIBRATION.format(car="sim-0", pulse="[1, 2, 2]", angle="[-1, 0, 1]", more=""), "D-FILE-03"),
    (CALIBRATION.format(car="sim-0", pulse="[1, 2]", angle="[-1, 0, 1]", more=""), "D-FILE-01"),
    (CALIBRATION.format(car="sim-0", pulse="[1, 2, 3]", angle="[-1, nan, 1]", more=""),
     "D-FILE-01"),
    (CALIBRATION.format(car="sim-0", pulse="[1, 2, 3]", angle="[-1, 0, 1]", more="[wheels]"),
     "D-FILE-01"),
    ("car = ", "D-FILE-01"), ("", "D-FILE-01"), ("\0", "D-FILE-01"),
])
@pytest.mark.slow_except("text[0-2]-*")
def test_a_broken_calibration_names_the_file(verb, tmp_path, text, code):
    folder = tmp_path / "cars" / "sim-0"
    folder.mkdir(parents=True)
    (folder / "calibration.toml").write_text(text)
    for command in ("record", "top"):
        error = verb(command, "--url", MOCK_URL, "--cars", tmp_path / "cars", "--duration", 0.1,
                     "--json").error
        assert error["code"] == code
        assert "calibration.toml" in error["what"]
    checks = verb("doctor", "--url", MOCK_URL, "--cars", tmp_path / "cars", "--json")
    assert checks.code == 1
    assert {c["id"]: c["verdict"] for c in checks.json["checks"]}["files"] == "fail"


def test_a_calibration_that_is_no_text(verb, tmp_path):
    folder = tmp_path / "cars" / "sim-0"
    folder.mkdir(parents=True)
    (folder / "calibration.toml").write_bytes(b"\xff\xfe\x00")
    assert verb("record", "--url", MOCK_URL, "--cars", tmp_path / "cars",
                "--json").error["code"] == "D-FILE-01"


@pytest.mark.parametrize("text", ["", "name = 5", 'name = "other"', "name = 'x'\n[geometry]\n",
                                  "x = [", 'schema = "dart-hal/car/9"'])
def test_a_broken_car_file_names_the_file(tmp_path, text):
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "car.toml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_car("mine", [tmp_path])
    assert "car.toml" in caught.value.what
    assert caught.value.remedy


@pytest.mark.slow_except("*return 1 / 0*", "*import no_such*")
@pytest.mark.parametrize(("text", "line"), [
    ("def control(state):\n    return 1 / 0, 0\n", "line 2"),
    ("def control(state)\n", "line 1"),
    ("import no_such_module\ndef control(state): ...\n", "line 1"),
    ("def control(state):\n    return 'left'\n", "returned"),
    ("def control(state):\n    return 0.1\n", "returned"),
])
def test_a_mistake_in_a_script_is_named_by_its_line(verb, tmp_path, text, line):
    script = tmp_path / "mine.py"
    script.write_text(text)
    error = verb("drive", script, "--url", MOCK_URL, "--json").error
    assert error["code"] == "D-USE-02"
    assert line in error["found"]


def test_a_program_of_its_own_is_not_run_by_drive(verb, tmp_path):
    script = tmp_path / "mine.py"
    script.write_text("import pathlib\npathlib.Path('moved').touch()\n")
    error = verb("drive", script, "--url", MOCK_URL, "--json").error
    assert error["try"].endswith(f"python {script}")
    assert not (tmp_path / "moved").exists()
    assert not Path("moved").exists()


def test_a_recording_or_a_desk_is_not_driven(verb, tmp_path):
    script = tmp_path / "mine.py"
    script.write_text("def control(state):\n    return 0.0, 0.0\n")
    run = tmp_path / "run.mcap"
    verb("record", "--url", MOCK_URL, "--duration", 1, "--out", run)
    error = verb("drive", script, "--url", f"replay://{run}", "--json").error
    assert "has no actuators" in error["what"]


@pytest.mark.slow
def test_a_new_recording_keeps_the_old_one(verb, tmp_path):
    run = tmp_path / "run.mcap"
    for _ in range(3):
        verb("record", "--url", MOCK_URL, "--duration", 1, "--out", run)
    names = sorted(p.name for p in tmp_path.glob("*.mcap"))
    assert names == ["run.1.mcap", "run.2.mcap", "run.mcap"]


def test_a_misspelt_verb_names_the_nearest(verb):
    assert verb("calibrat", "--json").error["try"] == "dart-hal calibrate"


@pytest.mark.parametrize(("arguments", "suggestion"), [
    (("evaluate", "--model", "papr", "run.csv"), "paper"),
    (("sim", "--reveal", "--url", MOCK_URL + "&effect=steering_comp:1"), "steering_compliance"),
    (("follow", "savoyardo", "--speed", 1, "--url", MOCK_URL), "savoiardo"),
    (("evaluate", "--car", "drat-01", "run.csv"), "--car dart-01"),
])
def test_a_misspelt_model_effect_track_or_car_names_the_nearest(verb, monkeypatch, arguments,
                                                                suggestion):
    monkeypatch.setenv("DART_CARS", str(Path(__file__).resolve().parents[2] / "cars"))
    assert suggestion in verb(*arguments, "--json").error["try"]


def test_a_script_without_control_lists_what_it_has(verb, tmp_path):
    script = tmp_path / "mine.py"
    script.write_text("def steer(state):\n    pass\n")
    error = verb("drive", script, "--url", MOCK_URL, "--json").error
    assert "steer" in error["found"]


@pytest.mark.slow
def test_a_command_that_is_no_number_ends_the_drive(verb, tmp_path):
    script = tmp_path / "mine.py"
    script.write_text("def control(state):\n    return float('nan'), 0.2\n")
    assert verb("drive", script, "--url", MOCK_URL, "--json").error["code"] == "D-CMD-01"


def test_a_mistake_of_ours_is_one_sentence(verb, monkeypatch):
    def broken(seed, ring=None):
        raise KeyError("a mistake of ours")

    monkeypatch.setattr("dart_lab.cli.sim.reveal_url", broken)
    error = verb("sim", "--reveal", "--url", MOCK_URL, "--json").error
    assert error["code"] == "D-BUG-01"
    assert "line" in error["found"]


def test_a_full_disk_is_one_sentence(verb, tmp_path):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, limits[1]))
    try:
        error = verb("record", "--url", MOCK_URL, "--duration", 1, "--out", tmp_path / "run.mcap",
                     "--json").error
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert error["code"] == "D-FILE-04"
    assert "File too large" in error["what"]  # the kernel's words for this limit


@pytest.mark.slow  # test_cli_contracts.py has it for two verbs
def test_a_reader_that_has_enough_is_no_error(tmp_path):
    done = subprocess.run(f"{sys.executable} -m dart_hal.cli.main wire --format c | head -1",
                          shell=True, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert "Traceback" not in done.stderr
    assert "Error" not in done.stderr


# -- flash ------------------------------------------------------------------------


@pytest.fixture
def image(tmp_path):
    path = tmp_path / "image.hex"
    path.write_text(":00000001FF\n")
    return path


def test_flash_without_avrdude(verb, image):
    error = verb("flash", image, "--port", "/dev/ttyX", "--avrdude", "no-such-avrdude",
                 "--json").error
    assert error["code"] == "D-FLASH-01"
    assert "apt-get" in error["try"]


@pytest.mark.parametrize("option", [("--port", "/dev/ttyX"), ("--baud", "57600")])
def test_flash_by_a_browser_that_chooses_them_itself(verb, image, option):
    error = verb("flash", image, "--browser", *option, "--json").error
    assert error["code"] == "D-USE-01"
    assert "on the page" in error["what"]


@pytest.mark.parametrize("content", [None, "", "no hex file"])
def test_flash_of_what_is_no_image(verb, tmp_path, content):
    path = tmp_path / "bad.hex"
    if content is not None:
        path.write_text(content)
    assert verb("flash", path, "--port", "/dev/ttyX", "--json").error["code"] == "D-USE-01"


def test_flash_of_a_file_that_differs_from_its_checksum(verb, image):
    image.with_name(image.name + ".sha256").write_text("0" * 64 + "  image.hex\n")
    error = verb("flash", image, "--port", "/dev/ttyX", "--json").error
    assert error["code"] == "D-FLASH-01"
    assert "does not match" in error["what"]


def test_flash_without_a_port(verb, image, monkeypatch):
    monkeypatch.setattr(flash.list_ports, "grep", lambda pattern: [])
    error = verb("flash", image, "--avrdude", sys.executable, "--json").error
    assert error["code"] == "D-LINK-02"


def test_flash_of_a_busy_port_names_who_has_it(verb, image):
    master, slave = os.openpty()
    error = verb("flash", image, "--port", os.ttyname(slave), "--avrdude", sys.executable,
                 "--json").error
    assert f"pid {os.getpid()}" in error["found"]
    os.close(master)
    os.close(slave)


@pytest.fixture
def flash_with(verb, image, tmp_path):
    """``flash_with(script)``: the error of `dart-hal flash` by a shell script in avrdude's place;
    the script has the speed in $baud."""
    def run(script):
        fake = tmp_path / "avrdude"
        fake.write_text('#!/bin/sh\nwhile [ "$1" != -b ]; do shift; done; baud=$2\n'
                        f"echo $baud >> {tmp_path}/speeds\n{script}\nexit 1\n")
        fake.chmod(0o755)
        nano, port = os.openpty()
        device = os.ttyname(port)
        os.close(port)  # an open one is in use
        try:
            error = verb("flash", image, "--port", device, "--avrdude", fake, "--json").error
        finally:
            os.close(nano)
        assert error["code"] == "D-FLASH-01"
        return error, (tmp_path / "speeds").read_text().split()

    return run


def test_flash_that_fails_reports_the_cause_of_avrdude(flash_with):
    error, speeds = flash_with("echo 'stk500_getsync(): not in sync' >&2\n"
                               "echo 'avrdude done.  Thank you.' >&2")
    assert "not in sync" in error["found"]
    assert speeds == ["115200", "57600"]


def test_flash_reports_the_first_cause_and_not_its_consequences(flash_with):
    error, _ = flash_with("""
if [ $baud = 115200 ]; then
  echo "avrdude: ser_open(): can't open device: Permission denied" >&2
  echo "avrdude: error: programmer is not responding" >&2
else
  echo "avrdude: stk500_getsync() attempt 1 of 10: not in sync: resp=0x00" >&2
fi""")
    assert error["found"].startswith("at 115200 baud: avrdude: ser_open(): can't open device")


@pytest.mark.parametrize(("lines", "chip"), [
    (["Device signature = 0x1e9516 (probably m328pb)",
      "Expected signature for ATmega328P is 1E 95 0F", "Double check chip"], "ATmega328PB"),
    (["Device signature = 1E 95 16 (ATmega328PB)",
      "Error: expected signature for ATmega328P is 1E 95 0F"], "ATmega328PB"),
    (["Device signature = 0x1e9406", "Expected signature for ATmega328P is 1E 95 0F"],
     "ATmega168"),
    (["Device signature = 0x1e9999", "Expected signature for ATmega328P is 1E 95 0F"],
     "a chip with the signature 1E9999"),
    (["expected signature for ATmega328P is 1E 95 0F"], "another chip")])
def test_flash_names_another_chip_and_tries_no_other_speed(flash_with, lines, chip):
    report = "".join(f'echo "avrdude: {line}" >&2\n' for line in lines)
    error, speeds = flash_with(f"""
if [ $baud = 115200 ]; then
{report}else
  echo "avrdude: stk500_getsync(): not in sync" >&2
fi""")
    assert error["found"].startswith(chip)
    assert "not an ATmega328P; nothing was written" in error["what"]
    assert "not in sync" not in error["found"]
    assert speeds == ["115200"]


@pytest.mark.parametrize("signature", ["0x000000", "FF FF FF"])
def test_flash_goes_on_after_a_signature_of_an_idle_line(flash_with, signature):
    _, speeds = flash_with(f'echo "avrdude: Device signature = {signature}" >&2')
    assert speeds == ["115200", "57600"]


def test_flash_stops_after_a_bootloader_that_answered_at_the_second_speed(flash_with):
    error, speeds = flash_with("""
if [ $baud = 57600 ]; then
  echo "avrdude: Device signature = 0x1e950f (probably m328p)" >&2
  echo "avrdude: verification error, first mismatch at byte 0x0000" >&2
else
  echo "avrdude: stk500_getsync(): not in sync" >&2
fi""")
    assert error["found"].startswith("at 57600 baud: avrdude: verification error")
    assert speeds == ["115200", "57600"]


# -- Ctrl-C -----------------------------------------------------------------------


def test_ctrl_c_is_130_and_one_word(capsys, monkeypatch):
    def interrupt(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr("dart_lab.cli.sim.reveal_url", interrupt)
    with pytest.raises(SystemExit) as left:
        main(["sim", "--reveal", "--url", MOCK_URL])
    assert left.value.code == 130
    captured = capsys.readouterr()
    assert "stopped" in captured.err
    assert captured.out == ""


@pytest.mark.parametrize(("text", "code"), [
    ("print('hello')\ndef control(state):\n    print('there')\n    return 0.0, 0.0\n", None),
    ("import sys\ndef control(state):\n    sys.exit(3)\n", "D-USE-02"),
])
@pytest.mark.slow
def test_a_script_cannot_spoil_the_one_json_object(verb, tmp_path, text, code):
    script = tmp_path / "mine.py"
    script.write_text(text)
    done = verb("drive", script, "--url", MOCK_URL, "--duration", 1, "--json")
    if code:
        assert done.error["code"] == code
    else:
        assert done.json["frames"] > 50
        assert "there" in done.err


@pytest.mark.parametrize("args", [
    ("top", "--duration", "nan"), ("record", "--duration", "inf"),
    ("top", "--url", "sim://?seed=1&seed=2"), ("top", "--url", "sim://?ber=nan"),
    ("top", "--url", "sim://?ber=-1"),
])
def test_numbers_that_are_none_and_options_given_twice(verb, args):
    assert verb(*args, "--json").error["code"] == "D-USE-01"


def test_the_bus_socket_takes_no_file_of_the_user(verb, tmp_path):
    precious = tmp_path / "precious.txt"
    precious.write_text("mine")
    error = verb("sim", "--url", MOCK_URL, "--pty", "--bus", precious, "--json").error
    assert "not a socket" in error["what"]
    assert precious.read_text() == "mine"


@pytest.mark.parametrize(("args", "what", "remedy"), [
    (("doctor", "--url", ""), "URL of the car is empty", "leave it out"),
    (("record", "--url", MOCK_URL, "--out", "x.csv"), "x.csv: a recording is an MCAP file",
     "export"),
    (("flash", "IMAGE", "--avrdude", "true", "--port", "/dev/null"), "is no serial port", "ttyUSB"),
    (("record", "--url", "sim://?sed=1"), "has no option sed", "seed= for sed="),
    (("record", "--url", "sim://?seed=-1"), "seed=-1 is no seed", "docs/reference/urls.md"),
    (("record", "--url", "sim://?physics=none"), "physics='none'", "docs/reference/urls.md"),
    (("record", "--url", "sim://?physics=dynamic&model=kinematic"), "given twice", ""),
])
def test_what_is_wrong_and_what_to_type(verb, tmp_path, args, what, remedy):
    image = tmp_path / "dart_nano.hex"
    image.write_text(":00000001FF\n")
    done = verb(*(image if word == "IMAGE" else word for word in args), "--json")
    assert what in done.error["what"]
    assert remedy in done.error["try"]
    assert not Path("x.csv").exists()


def test_a_file_that_is_no_image_is_not_called_a_missing_emulator(verb):
    failed = verb("doctor", "--url", "avr:///etc/passwd", "--json").json["checks"][0]
    assert failed["found"].startswith("/etc/passwd: line 1 is no Intel hex record")
    assert failed["try"] == "avr://default runs the firmware of this version"
