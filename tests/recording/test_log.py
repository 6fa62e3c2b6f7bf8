"""``Car.log``: what goes in comes out, and a bad name or value is reported, recording or not."""

from __future__ import annotations

import gc
import math

import numpy as np
import pytest

from dart_hal import Car
from dart_hal.core.errors import LogError
from dart_hal.devices.links.base import open_backend
from dart_hal.recording.log import LogNames
from dart_hal.recording.repair import repair
from dart_hal.recording.run import RunReader, RunWriter
from tests.common import MOCK_3_URL
from tests.ros2msg import decode_messages

GRID = np.arange(6.0).reshape(2, 3)
VALUES = {
    "number": (1.5, {"number": 1.5}),
    "whole": (3, {"whole": 3.0}),
    "truth": (np.bool_(True), {"truth": 1.0}),
    "narrow": (np.float32(0.5), {"narrow": 0.5}),
    "wrapped": (np.array(2.0), {"wrapped": 2.0}),
    "infinite": (math.inf, {"infinite": math.inf}),
    "list": ([1, 2.5], {"list": np.array([1.0, 2.5])}),
    "grid": (GRID, {"grid": GRID}),
    "columns": (GRID.T, {"columns": GRID.T}),
    "empty": ([], {"empty": np.zeros(0)}),
    "solver": ({"cost": 1.5, "plan": GRID, "inner": {"steps": 4}},
               {"solver/cost": 1.5, "solver/plan": GRID, "solver/inner/steps": 4.0}),
    "nothing": ({}, {}),
}


@pytest.mark.parametrize("name", VALUES)
def test_a_value_reads_back(tmp_path, name):
    value, expected = VALUES[name]
    with RunWriter(tmp_path / "run.mcap") as writer:
        writer.log(1.25, LogNames().take(name, value))
    found = list(RunReader(tmp_path / "run.mcap").logged())
    assert [(item.t, item.name) for item in found] == [(1.25, n) for n in expected]
    for item in found:
        np.testing.assert_array_equal(item.value, expected[item.name], strict=True)


def test_other_programs_can_plot_it(tmp_path):
    with RunWriter(tmp_path / "run.mcap") as writer:
        writer.log(1.0, LogNames().take("mpc", {"cost": 1.5, "plan": GRID, "none": []}))
    (cost,) = decode_messages(tmp_path / "run.mcap", "/log/mpc/cost")
    (plan,) = decode_messages(tmp_path / "run.mcap", "/log/mpc/plan")
    (none,) = decode_messages(tmp_path / "run.mcap", "/log/mpc/none")
    assert cost == {"data": 1.5}
    assert plan["data"] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert none["data"] == []


BAD_NAMES = ["", "/cost", "mpc/", "mpc//cost", "1st", "mpc cost", "mpc/1", "k\u00f6st", "cost\n", 5,
             None]
BAD_VALUES = [None, "1.5", [1.0, "2"], [[1.0], [1.0, 2.0]], 1j, object(), np.datetime64("now"),
              10**400, {3: 1.0}, {"a b": 1.0}, {"a": {"b": None}},
              np.ma.masked_array([1.0, 2.0], mask=[0, 1])]


@pytest.mark.parametrize("name", BAD_NAMES, ids=repr)
def test_a_bad_name_is_refused(name):
    with pytest.raises(LogError, match="no name of a channel"):
        LogNames().take(name, 1.0)


@pytest.mark.parametrize("value", BAD_VALUES, ids=range(len(BAD_VALUES)))
def test_a_bad_value_is_refused_and_nothing_of_it_is_kept(value):
    names = LogNames()
    with pytest.raises(LogError) as error:
        names.take("x", {"good": 1.0, "bad": value})
    assert error.value.remedy
    assert names.take("x/good", [1.0]), "else x/good would be a number by now"


def test_a_name_stays_of_one_kind():
    names = LogNames()
    names.take("x", 1.0)
    names.take("x", 2)
    with pytest.raises(LogError, match="logged as a number before"):
        names.take("x", [1.0])
    names.take("plan", [1.0])
    names.take("plan", GRID)
    with pytest.raises(LogError, match="logged as an array before"):
        names.take("plan", 1.0)


def test_a_car_logs_in_its_own_clock_and_only_while_it_records(tmp_path):
    path = tmp_path / "run.mcap"
    logged = []
    backend = open_backend(MOCK_3_URL)
    with Car.over(backend, record=path) as car:
        for state in car.states(duration=0.5):
            car.log("speed", state.speed)
            logged.append((backend.clock.now(), "speed", state.speed))
            car.drive(throttle=0.1)
    car.log("speed", 1.0)  # closed: nothing to record into
    assert [tuple(item) for item in RunReader(path).logged()] == logged
    assert len(logged) == 50


@pytest.mark.parametrize("recording", [True, False])
def test_a_mistake_is_reported_recording_or_not(tmp_path, recording):
    with Car.open(MOCK_3_URL, record=tmp_path / "run.mcap" if recording else None) as car:
        car.log("mpc/cost", 1.0)
        for name, value in (("mpc cost", 1.0), ("mpc/cost", "low"), ("mpc/cost", [1.0])):
            with pytest.raises(LogError):
                car.log(name, value)


def test_what_was_logged_survives_a_kill_and_its_repair(tmp_path):
    path = tmp_path / "run.mcap"
    writer = RunWriter(path)
    names = LogNames()
    for k in range(100):
        writer.rx(bytes(8), 1.0 + 0.01 * k)
        writer.log(1.0 + 0.01 * k, names.take("mpc", {"cost": k, "plan": GRID}))
    path.write_bytes(path.read_bytes())  # as it is on the disk now
    repair(path)
    found = list(RunReader(path).logged())
    assert len(found) >= 2 * 94
    assert found[-1].name == "mpc/plan"
    del writer
    gc.collect()


def test_a_run_without_logs_is_as_before(run_file):
    assert list(RunReader(run_file).logged()) == []
    assert b"/log/" not in run_file.read_bytes()
