"""Pages of `calibrate --html` and `data check --html`: a picture first, then one line per value."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from dart_hal.calibration import order
from dart_hal.calibration.measured import FitGraph, Measured
from dart_hal.calibration.result import SteeringResult
from dart_hal.cli.main import load_command
from dart_hal.core import plugins
from dart_hal.core.config import Calibration, Quantity
from dart_hal.core.types import Estimate
from dart_lab.pages import calibrate_page
from tests.common import EXCERPT, MOCK_URL


def make_result(**quantities):
    return Measured("car", "test", "imu", {f"imu.{name}": Quantity(*q, "test")
                                           for name, q in quantities.items()}, "residual", 1.0)


def test_each_value_has_one_line_with_interval_unit_and_verdict(tmp_path):
    before = Calibration(car="car").with_quantities(
        {"imu.gyro_scale": Quantity(1.0, 0.001, "then"), "imu.mount_yaw": Quantity(0.1, 0.01, "")})
    found = make_result(gyro_scale=(1.001, 0.001), mount_yaw=(0.2, 0.01), gyro_bias=(0.01, 0.001))
    path = calibrate_page.write_page([found], path=tmp_path / "a.html", files=None, previous=before,
                                     command="dart-hal calibrate imu")
    text = path.read_text(encoding="utf-8")
    rows = [re.sub(r"<[^>]+>", "|", row) for row in text.split("<tr>") if "<wbr>" in row]
    cells = [[c for c in row.split("|") if c] for row in rows]
    assert [row[:3] for row in cells[:3]] == [["imu.", "gyro_", "scale"], ["imu.", "mount_", "yaw"],
                                              ["imu.", "gyro_", "bias"]]
    assert [row[4] for row in cells[:3]] == ["as before", "changed by 0.1 rad", "new"]
    assert cells[1][3] == "0.200\u00a0\u00b1\u00a00.016 rad"
    assert text.index("<svg") < text.index("<table")


def test_map_is_drawn_over_its_samples(tmp_path):
    command = np.linspace(-1.0, 1.0, 5)
    samples = (command, 0.3 * command, np.array([1.0, -1.0, 1.0, -1.0, 0.0]))
    found = SteeringResult("car", "test", 5, 1.0, command, 0.3 * command, np.full(5, 0.01),
                           1500.0 + 300.0 * command, {"k_left": 1.0}, 0.01,
                           Estimate(0.01, 0.001), samples=samples)
    path = calibrate_page.write_page([make_result(gyro_scale=(1.0, 0.1)), found],
                                     path=tmp_path / "a.html", files=None, previous=None,
                                     command="dart-hal calibrate all")
    first = path.read_text(encoding="utf-8").split("<nav")[0]
    assert "Steering map over the measurements" in first
    assert "reached from the left" in first
    assert "angle at full left" in path.read_text(encoding="utf-8")


def test_data_and_fit_come_before_the_intervals(tmp_path):
    many = np.linspace(0.0, 1.0, 3000)
    graph = FitGraph("Line", "x", "y", many, many, many[:2], many[:2], many[:2])
    found = replace(make_result(gyro_scale=(1.0, 0.1)), graph=graph)
    path = calibrate_page.write_page([found], path=tmp_path / "a.html", files=None, previous=None,
                                     command="dart-hal calibrate imu")
    first, rest = path.read_text(encoding="utf-8").split("<nav")
    assert "<figcaption>Line" in first
    assert 300 < first.count("before mark") <= 401
    assert "All values and their intervals" in rest


@pytest.mark.parametrize("name", [*order.PROCEDURE_NAMES, "all"])
def test_every_procedure_has_a_page(name):
    assert "html" in [p.name for p in load_command("calibrate").commands[name].params]


def test_page_of_a_calibration_is_written_even_if_the_values_are_not(verb, tmp_path):
    done = verb("calibrate", "clock", "--frequency", 50.02, "--std", 0.01, "--dry-run", "--url",
                MOCK_URL, "--cars", tmp_path, "--html", "clock.html")
    assert done.code == 0, done.err
    assert "report: clock.html" in done.err
    first, rest = (tmp_path / "clock.html").read_text(encoding="utf-8").split("<nav")
    assert "So far a pulse of 1500 us was" in first
    assert "pwm." in rest


def test_missing_laboratory_is_reported_before_the_car_moves(verb, monkeypatch):
    every = plugins.list_plugins
    monkeypatch.setattr(plugins, "list_plugins", lambda group: {
        name: entry for name, entry in every(group).items() if name != "calibration"})
    monkeypatch.setattr("dart_hal.cli.common.procedures.open_backend",
                        lambda url: pytest.fail("opened"))
    error = verb("calibrate", "clock", "--html", "a.html", "--url", MOCK_URL, "--json").error
    assert "calibration" in error["what"]
    assert error["try"] == "make setup, or install dart-hal again"


def test_page_of_recordings_begins_with_a_picture(verb, tmp_path):
    circles = next((EXCERPT / "circles_27_sept_2024").glob("*.csv*"))
    steps = next((EXCERPT / "10_step_input_data_rubbery_floor").glob("*.csv*"))
    assert verb("data", "check", circles, steps, "--html", "many.html").code == 0
    assert verb("data", "check", circles, "--html", "one.html").code == 0
    for name, picture in (("many.html", "good for each purpose"), ("one.html", "speed [m/s]")):
        text = (tmp_path / name).read_text(encoding="utf-8")
        assert picture in text.split("<nav")[0]
        assert circles.name in text
