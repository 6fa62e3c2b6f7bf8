"""The doctor's verdicts: each fault is found by the check that is meant for it."""

from __future__ import annotations

import dataclasses
import shlex

import pytest
from msgspec import structs

from dart_hal.cli import doctor
from dart_hal.cli.common import checks as checks_module
from dart_hal.cli.common.checks import CHECK_TITLES, DoctorCheck, check_missing_bus
from dart_hal.core.config import Calibration, SteeringTable, save_calibration
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of
from tests.common import MOCK_URL


def verdicts(done) -> dict[str, str]:
    result = done.json
    assert set(result) == {"url", "checks", "verdict"}
    for check in result["checks"]:
        assert set(check) == {"id", "title", "verdict", "found", "expected", "cause", "try"}
        assert check["verdict"] in ("ok", "warn", "fail", "skip")
        if check["verdict"] == "fail":
            assert check["try"], check
    arms = any(c["id"] == "arming" and c["verdict"] == "ok" for c in result["checks"])
    assert done.code == (0 if result["verdict"] != "fail" and arms else 1)
    return {c["id"]: c["verdict"] for c in result["checks"]}


@pytest.fixture
def change_backend(monkeypatch):
    """``spoilt(change)``: every backend that doctor opens is changed first."""
    def install(change):
        def open_changed(url):
            backend = open_backend(url)
            return change(backend) or backend

        monkeypatch.setattr(checks_module, "open_backend", open_changed)

    return install


def test_a_mock_is_no_firmware(verb):
    found = verdicts(verb("doctor", "--url", MOCK_URL, "--json", "--seconds", 1))
    assert set(found) == set(CHECK_TITLES)
    assert found.pop("hello") == "warn"
    assert found.pop("cutoff") == "warn"
    assert found.pop("calibration") == "warn"
    assert set(found.values()) == {"ok"}


@pytest.mark.slow
@pytest.mark.emulator
def test_the_firmware_is_well(verb):
    found = verdicts(verb("doctor", "--url", "sim://?nano=avr&cutoff=oe", "--json", "--seconds", 2))
    assert found.pop("calibration") == "warn"   # the gyro calibrates itself within 1 s
    assert set(found.values()) == {"ok"}


def test_a_car_that_would_not_drive_is_no_success(verb, change_backend):
    """Without its bus there is no fault, and nothing to drive."""
    change_backend(lambda backend: dataclasses.replace(backend, bus=None))
    shown = verb("doctor", "--url", MOCK_URL, "--seconds", 1)
    assert "fail " not in shown.out
    assert "not ready to drive" in shown.out
    assert shown.code == 1


def test_what_was_found_is_shown_as_it_is(verb, monkeypatch):
    """No emoji for :x:, no colour for [red]."""
    found = DoctorCheck("port", "port", "fail", "/tmp/:x:/[red]")
    monkeypatch.setattr(doctor, "run_checks", lambda *_: [found])
    assert "/tmp/:x:/[red]" in verb("doctor", "--url", MOCK_URL).out


@pytest.mark.slow
def test_in_words(verb):
    shown = verb("doctor", "--url", MOCK_URL)
    assert shown.code == 0
    assert "hardware cut-off" in shown.out
    assert "the car will drive" in shown.out


def test_no_port_skips_the_rest(verb):
    found = verdicts(verb("doctor", "--url", "serial:///dev/ttyNONE", "--json", "--seconds", 1))
    assert found.pop("port") == "fail"
    assert set(found.values()) == {"skip"}


def test_no_imu(verb, change_backend):
    change_backend(lambda backend: world_of(backend).nano.set_imu_fault("off"))
    done = verb("doctor", "--url", MOCK_URL, "--json", "--seconds", 1)
    assert verdicts(done)["imu"] == "fail"
    assert done.json["verdict"] == "fail"


@pytest.mark.slow
def test_no_pca9685_still_looks_at_the_rest(verb, change_backend):
    def remove_bus(backend):
        backend.bus.nack = 10**9

    change_backend(remove_bus)
    found = verdicts(verb("doctor", "--url", MOCK_URL, "--json", "--seconds", 1))
    assert found["bus"] == "fail"
    assert found["imu"] == "ok"
    assert found["rate"] == "ok"


@pytest.mark.slow
def test_a_bad_line_is_detected_in_the_losses(verb):
    found = verdicts(verb("doctor", "--url", MOCK_URL + "&ber=3e-4", "--json", "--seconds", 1))
    assert found["losses"] in ("warn", "fail")
    assert found["port"] == "ok"


@pytest.mark.slow
def test_without_a_bus_the_car_is_not_reported_as_able_to_drive(verb, change_backend):
    change_backend(lambda backend: dataclasses.replace(backend, bus=None))
    done = verb("doctor", "--url", MOCK_URL, "--json", "--seconds", 1)
    assert verdicts(done)["bus"] == verdicts(done)["arming"] == "warn"
    plain = verb("doctor", "--url", MOCK_URL, "--seconds", 1)
    assert "not ready to drive" in plain.out


def test_a_serial_url_without_a_bus_states_how_to_name_it():
    assert check_missing_bus("serial:///dev/ttyUSB0").remedy.endswith("ttyUSB0?i2c=1'")
    assert check_missing_bus("serial:///dev/ttyUSB0?baud=115200").remedy.endswith("115200&i2c=1'")


def test_what_arm_would_refuse_is_reported(verb, change_backend):
    """A car without a measured clock: the doctor reports what arm() would report."""
    def remove_oscillator(backend):
        lines = backend.car_toml.splitlines()
        kept = [line for line in lines if not line.startswith("oscillator_hz")]
        return dataclasses.replace(backend, car_toml="\n".join(kept))

    change_backend(remove_oscillator)
    done = verb("doctor", "--url", MOCK_URL, "--json", "--seconds", 1)
    assert verdicts(done)["pwm"] == verdicts(done)["arming"] == "warn"
    arming = next(c for c in done.json["checks"] if c["id"] == "arming")
    assert "PWM_CLOCK_UNCALIBRATED" in arming["found"]
    assert "--waive PWM_CLOCK_UNCALIBRATED" in arming["try"]


def test_turning_wheels_are_no_fault(verb, change_backend):
    def turn_wheel(backend):
        nano = world_of(backend).nano
        nano.set_wheel(5.0)
        nano.set_wheel = lambda rate: None

    change_backend(turn_wheel)
    done = verb("doctor", "--url", MOCK_URL, "--json", "--seconds", 1)
    encoder = next(c for c in done.json["checks"] if c["id"] == "encoder")
    assert encoder["verdict"] == "ok"
    assert not encoder["found"].startswith("0 edges")


def test_an_unknown_car_is_a_file_that_is_missing(verb, change_backend):
    change_backend(lambda backend: dataclasses.replace(backend, car_toml=None, car=None))
    done = verb("doctor", "--url", MOCK_URL, "--car", "nobody", "--json", "--seconds", 1)
    assert verdicts(done)["files"] == "fail"


def commands_of(done) -> dict[str, str]:
    """By check: the remedy of a warning, where it is a command."""
    return {c["id"]: c["try"] for c in done.json["checks"]
            if c["verdict"] == "warn" and c["try"].startswith("dart-hal ")}


@pytest.mark.slow
@pytest.mark.parametrize("url", [MOCK_URL, "sim://?seed=7&nano=mock"])
@pytest.mark.parametrize("where", [(), ("--cars", "my cars")])
@pytest.mark.long_except("where0-sim://?nano*", "where1-sim://?seed*")
def test_printed_remedy_clears_its_warning(verb, url, where):
    doctor = ("doctor", "--url", url, "--json", "--seconds", 1, *where)
    remedies = commands_of(verb(*doctor))
    assert "calibration" in remedies
    for command in remedies.values():
        assert verb(*shlex.split(command)[1:]).code == 0
    assert commands_of(verb(*doctor)) == {}
    assert verdicts(verb(*doctor))["calibration"] == "ok"


@pytest.mark.parametrize("cars", ["cars", "share/dart-hal/cars", "my cars"])
@pytest.mark.slow
def test_steering_map_is_found_where_calibrate_writes_it(verb, monkeypatch, tmp_path, cars):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "share"))
    steering = SteeringTable(pulse_us=(1200.0, 1800.0), angle_rad=(-0.3, 0.3), std_rad=(0.1, 0.1))
    calibration = Calibration(car="sim-7")
    calibration = structs.replace(
        calibration, steering=structs.replace(calibration.steering, map=steering))
    save_calibration(calibration, tmp_path / cars / "sim-7")
    doctor = ("doctor", "--url", "sim://?seed=7&nano=mock", "--json", "--seconds", 1)
    named = ("--cars", cars) if cars == "my cars" else ()
    assert verdicts(verb(*doctor, *named))["calibration"] == "ok"
    assert verdicts(verb(*doctor, "--cars", "others"))["calibration"] == "warn"  # the control


def test_remedy_names_url_and_folder_of_the_doctor(verb):
    url = "sim://?seed=7&nano=mock"
    done = verb("doctor", "--url", url, "--json", "--seconds", 1, "--cars", "my cars")
    command = commands_of(done)["calibration"]
    assert shlex.split(command)[3:] == ["--url", url, "--cars", "my cars"]


@pytest.mark.slow_except("0-None-")
@pytest.mark.parametrize(("battery", "verdict", "words"), [
    ("1", "ok", "V per cell"), ("charge=0.05", "warn", "V per cell"), ("0", None, ""),
    ("nano", "ok", "V per cell")])
def test_a_battery_is_checked_where_it_is_measured(verb, battery, verdict, words):
    done = verb("doctor", "--url", f"{MOCK_URL}&battery={battery}", "--json", "--seconds", 2)
    assert verdicts(done).get("battery") == verdict
    assert verdict is None or words in next(
        c["found"] for c in done.json["checks"] if c["id"] == "battery")


def test_a_battery_sensor_that_does_not_answer_is_a_warning(verb, change_backend):
    change_backend(lambda backend: setattr(
        backend, "car_toml", backend.car_toml + "\n[battery]\naddress = 0x45\n"))
    found = verdicts(verb("doctor", "--url", MOCK_URL, "--json", "--seconds", 1))
    assert found["battery"] == "warn"


def test_a_divider_that_is_off_is_a_warning_with_its_place(verb, change_backend):
    change_backend(lambda backend: setattr(
        backend, "car_toml", backend.car_toml + '\n[battery]\nsource = "nano"\nratio = 3.0\n'))
    done = verb("doctor", "--url", MOCK_URL, "--json", "--seconds", 1)
    assert verdicts(done)["battery"] == "warn"
    assert "06_wiring.md" in next(c["try"] for c in done.json["checks"] if c["id"] == "battery")


@pytest.mark.slow_except("-[[]rc]-warn")
@pytest.mark.parametrize(("options", "table", "verdict"), [
    ("&rc=1", "", "ok"), ("&rc=1", "mode_us = 1500.0", "warn"), ("", "[rc]", "warn"),
    ("&rc=1", "enabled = false", None), ("", "", None)])
def test_an_rc_receiver_is_checked_where_the_car_has_one(verb, change_backend, options, table,
                                                         verdict):
    """The simulated receiver sends nothing on the third channel."""
    change_backend(lambda backend: setattr(backend, "car_toml", f"{backend.car_toml}{table}\n"))
    done = verb("doctor", "--url", f"{MOCK_URL}{options}", "--json", "--seconds", 1)
    assert verdicts(done).get("rc") == verdict
