"""``dart-hal report``: one page for a car, from its files and runs alone."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from dart_hal.car import Car
from dart_hal.cli.calibrate import command as calibrate
from dart_hal.core.config import save_calibration
from dart_hal.core.config.calibration import Calibration
from dart_hal.core.config.history import calibration_changes, list_versions
from dart_hal.core.config.quantity import Quantity
from dart_lab.pages import report_page
from tests.common import MOCK_3_URL


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """A folder with two runs, the second one newer and driven."""
    folder = tmp_path_factory.mktemp("driven")
    for name, throttle, age in (("stands", 0.0, 100), ("drives", 0.25, 50)):
        path = folder / f"{name}.mcap"
        with Car.open(MOCK_3_URL, record=path) as car:
            car.arm()
            for _ in car.states(duration=2.0):
                car.drive(throttle=throttle)
        os.utime(path, (1e9 - age, 1e9 - age))
    return folder


@pytest.fixture
def home(driven, tmp_path, monkeypatch):
    """A working folder of one's own with those runs."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(driven, tmp_path / "runs")
    return tmp_path


def write_calibration(home, value, std=10.0):
    """calibration.toml with another clock."""
    save_calibration(Calibration(car="sim-3").with_quantities(
        {"pwm.oscillator_hz": Quantity(value, std)}), home / "cars" / "sim-3")


@pytest.mark.slow
def test_runs_are_listed_newest_first_and_what_was_never_measured_is_named(home, verb):
    result = verb("report", "--car", "sim-3", "--json").json
    assert [r["path"] for r in result["runs"]] == ["drives.mcap", "stands.mcap"]
    new, old = result["runs"]
    assert new["distance"] > 0.5 > old["distance"] == 0.0
    assert new["duration"] > 1.9
    assert new["period"] == pytest.approx([0.01, 0.01, 0.01], abs=0.002)
    assert new["frames"] > 190
    assert new["lost"] == 0
    assert "steering.map" in result["missing"]
    assert not [name for name in result["missing"] if name.startswith("mocap.")]  # few have one
    assert any("calibrate steering" in line for line in result["to_do"])
    page = (home / "report.html").read_text(encoding="utf-8")
    assert "drives.mcap" in page


def test_each_verb_that_the_page_names_is_there():
    result = calibrate.commands
    assert result.keys() >= set(report_page.CALIBRATION_VERBS.values())


@pytest.mark.slow
def test_latencies_are_shown_with_the_verb_that_measures_them(home, verb):
    save_calibration(Calibration(car="sim-3").with_quantities(
        {"latency.pulse_to_wheel": Quantity(0.0213, 1e-3)}), home / "cars" / "sim-3")
    result = verb("report", "--car", "sim-3", "--json").json
    assert {"steering.slew_us_s", "latency.pulse_to_yaw"} <= set(result["missing"])
    assert not {"latency.pulse_to_wheel", "latency.pulse_to_yaw_lag"} & set(result["missing"])
    (line,) = [line for line in result["to_do"] if "calibrate latency" in line]
    assert "steering.slew_us_s" in line
    assert "latency.pulse_to_wheel" in (home / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_half_a_motion_capture_is_named(home, verb):
    save_calibration(Calibration(car="sim-3").with_quantities(
        {"mocap.marker_x": Quantity(0.1, 1e-4)}), home / "cars" / "sim-3")
    result = verb("report", "--car", "sim-3", "--json").json
    assert "mocap.latency" in result["missing"]
    assert any("dart-hal calibrate mocap" in line for line in result["to_do"])


@pytest.mark.slow
def test_a_number_that_moved_by_more_than_chance_is_highlighted(home, verb):
    write_calibration(home, 25.0e6)
    write_calibration(home, 25.1e6)
    result = verb("report", "--car", "sim-3", "--json").json
    (change,) = result["changed"]
    assert change["name"] == "pwm.oscillator_hz"
    assert (change["before"], change["now"]) == (25.0e6, 25.1e6)
    assert change["z"] > 1000.0
    assert any("pwm.oscillator_hz moved" in line for line in result["to_do"])


@pytest.mark.slow
def test_what_moved_within_its_error_does_not(home, verb):
    write_calibration(home, 25.0e6, std=1e5)
    write_calibration(home, 25.1e6, std=1e5)
    result = verb("report", "--car", "sim-3", "--json").json
    assert result["changed"][0]["z"] < 1.0
    assert not any("moved" in line for line in result["to_do"])


@pytest.mark.slow
def test_a_run_that_lost_frames_is_highlighted(tmp_path, verb, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with Car.open(MOCK_3_URL, record=tmp_path / "noisy.mcap") as car:
        car.on_bytes(lambda way, data, t: b"" if way == "rx" and 1.0 < t % 2.0 < 1.1 else data)
        for _ in car.states(duration=3.0):
            pass
    result = verb("report", "--car", "sim-3", "noisy.mcap", "--json").json
    (run,) = result["runs"]
    assert run["lost"] > 0
    assert any(line.startswith("noisy.mcap") for line in result["to_do"])


@pytest.mark.slow
def test_a_file_that_is_no_run_is_refused_by_name_and_left_out_of_a_folder(home, verb):
    bad = home / "runs" / "bad.mcap"
    bad.write_bytes(b"no run")
    assert verb("report", "--car", "sim-3", "--json").json["runs"]
    assert "bad.mcap" in verb("report", "--car", "sim-3").err
    assert "bad.mcap" in str(verb("report", "--car", "sim-3", str(bad), "--json").error)


@pytest.mark.slow
def test_a_car_that_is_nowhere_is_refused(home, verb):
    assert "no-such-car" in verb("report", "--car", "no-such-car", "--json").error["what"]


def test_versions_are_counted_from_the_newest(tmp_path):
    for value in (25.0e6, 25.1e6, 25.2e6):
        write_calibration(tmp_path, value)
    folder = tmp_path / "cars" / "sim-3"
    assert [p.name for p in list_versions(folder / "calibration.toml")] == [
        "calibration-0002.toml", "calibration-0001.toml"]
    now = Calibration(car="sim-3").with_quantities({"pwm.oscillator_hz": Quantity(25.2e6, 10.0)})
    (change,) = calibration_changes(now, folder)
    assert change.before == 25.1e6


def test_the_example_car_has_a_page(tmp_path, verb, monkeypatch):
    cars = Path(__file__).parents[2] / "cars"
    monkeypatch.chdir(tmp_path)
    result = verb("report", "--cars", cars, "--html", tmp_path / "x.html", "--json").json
    assert result["car"] == "dart-01"
    assert (tmp_path / "x.html").is_file()
