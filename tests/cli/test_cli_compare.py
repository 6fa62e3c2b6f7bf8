"""``dart-hal compare``: two runs side by side, and when they part."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal import Car
from dart_hal.car.compare import MIN_DIFFERENT_ROWS, _first_lasting
from tests.common import MOCK_3_URL
from tests.pages import foreign

pytestmark = pytest.mark.usefixtures("armed_esc")


RUN_PLANS = {"base": (MOCK_3_URL, 0.0), "again": (MOCK_3_URL, 0.0), "turns": (MOCK_3_URL, 0.2),
        "other": ("sim://?seed=8&nano=mock", 0.0)}
"""The car, and what is steered from 0.6 s on [rad]."""


def drive(path, url, steering):
    with Car.open(url, record=path) as car:
        car.arm()
        start = None
        for s in car.states(duration=1.2):
            start = s.t if start is None else start
            late = s.t - start > 0.6
            car.drive(throttle=0.25, steering=steering if late else 0.0)
            car.log("loop/late", late)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """``runs["base"]``: driven at its first use."""
    folder = tmp_path_factory.mktemp("runs")

    class Runs(dict):
        def __missing__(self, name):
            drive(folder / f"{name}.mcap", *RUN_PLANS[name])
            return self.setdefault(name, folder / f"{name}.mcap")

    return Runs()


@pytest.mark.slow
def test_a_run_that_was_driven_again_does_not_part(verb, runs):
    result = verb("compare", runs["base"], runs["again"], "--json").json
    assert set(result) == {"runs", "statistics", "differs", "same_commands_s", "parted", "page"}
    assert result["differs"] == []
    assert result["parted"] is None
    assert result["same_commands_s"] > 1.1
    one, other = result["statistics"]["speed"]
    assert one == other
    assert one["max"] > 0.3
    assert result["statistics"]["log/loop/late"][0]["max"] == 1.0
    assert {"path", "duration_s", "frames", "lost", "lost_share", "distance_m", "firmware"} <= set(
        result["runs"][0])


@pytest.mark.slow
def test_another_command_ends_the_time_in_which_they_can_be_compared(verb, runs):
    result = verb("compare", runs["base"], runs["turns"], "--json").json
    assert result["same_commands_s"] == pytest.approx(0.6, abs=0.05)
    assert result["parted"] is None, "what comes of another command is no surprise"
    assert result["statistics"]["command_steering"][1]["max"] == 0.2


@pytest.mark.slow
def test_another_car_parts_under_the_same_commands(verb, runs):
    """The negative control: same commands, another hidden truth."""
    result = verb("compare", runs["base"], runs["other"], "--json").json
    assert result["same_commands_s"] > 1.1
    assert result["parted"]["channel"] in ("speed", "yaw_rate")
    assert 0.0 < result["parted"]["t"] < 1.1
    assert abs(result["parted"]["a"] - result["parted"]["b"]) >= 0.05
    assert {"car", "url"} <= {d["name"] for d in result["differs"]}
    output = verb("compare", runs["base"], runs["other"]).out
    assert "driven by the same commands" in output
    assert "car: sim-3 -> sim-8" in output


@pytest.mark.slow
def test_the_page_has_both_and_needs_nothing_else(verb, runs, tmp_path):
    page = tmp_path / "page.html"
    result = verb("compare", runs["base"], runs["other"], "--html", page, "--json").json
    assert result["page"] == str(page)
    text = page.read_text(encoding="utf-8")
    assert "base.mcap" in text
    assert "other.mcap" in text
    assert text.count("<svg") >= 4
    assert not foreign(text)


@pytest.mark.slow
def test_a_run_that_was_not_driven_is_compared_as_far_as_it_goes(verb, runs, tmp_path):
    verb("record", "--url", MOCK_3_URL, "--duration", 0.3, "--out", tmp_path / "stands.mcap")
    ran = verb("compare", tmp_path / "stands.mcap", runs["base"], "--html", tmp_path / "p.html",
               "--json").json
    assert ran["same_commands_s"] is None
    assert ran["statistics"]["command_throttle"][0] == {"n": 0}
    assert "not driven" in verb("compare", tmp_path / "stands.mcap", runs["base"]).out


@pytest.mark.slow
def test_a_file_of_the_car_that_changed_is_reported_key_by_key(verb, runs, tmp_path, monkeypatch):
    from dart_hal.recording.run import RunReader

    read = RunReader.__init__

    def read_with_mass(self, path):
        read(self, path)
        if self.path.name == "again.mcap":
            self.files = {**self.files, "model.toml": "[body]\nmass = 2.5\n"}

    monkeypatch.setattr(RunReader, "__init__", read_with_mass)
    result = verb("compare", runs["base"], runs["again"], "--json").json
    assert {"name": "model.body.mass", "a": None, "b": 2.5} in result["differs"]


def test_what_is_no_run_is_refused_by_name(verb, runs, tmp_path):
    assert "none.mcap" in verb("compare", runs["base"], tmp_path / "none.mcap",
                               "--json").error["what"]


def test_a_difference_must_last():
    differs = np.zeros(50, dtype=bool)
    differs[10:10 + MIN_DIFFERENT_ROWS - 1] = True
    assert _first_lasting(differs) is None
    differs[20:20 + MIN_DIFFERENT_ROWS] = True
    assert _first_lasting(differs) == 20
    assert _first_lasting(differs[:2]) is None
