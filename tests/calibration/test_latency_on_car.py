"""`calibrate latency` through the whole Car, against the hidden truth of simulated cars."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.calibration.latency import calibrate_latency
from dart_hal.calibration.latency_pulse import Grid, unseen_grid
from dart_hal.calibration.measured import write
from dart_hal.car import Car
from dart_hal.control.tuning import answer_of
from dart_hal.errors import CalibrationFailed
from dart_hal.links.base import open_backend
from dart_hal.sim.truth import world_of

from .hidden_errors import true_sensors

URL = "sim://?nano=mock&seed="
LATE = "&effect=throttle_delay:0.02,throttle_lag:0.06"


def measured(url, tmp_path, begin=lambda backend: None):
    backend = open_backend(url)
    begin(backend)
    with Car.over(backend, cars=tmp_path) as car:
        try:
            return car.files, calibrate_latency(car)
        finally:
            assert car.mode != "RAW"
            assert not list(tmp_path.rglob("calibration.toml"))


@pytest.mark.more
def test_what_is_measured_is_near_the_truth_and_tunes_the_speed_loop(tmp_path):
    url = f"{URL}5{LATE}"
    files, result = measured(url, tmp_path)
    true = true_sensors(url)
    for name, found in result.quantities.items():
        assert abs(found.value - true[name]) < 3.5 * found.std, name
    assert not answer_of(files).known
    write(files, result)
    with Car.open(url, cars=tmp_path) as car:
        answer = answer_of(car.files)
    assert answer.known
    assert answer.lag == pytest.approx(0.06, abs=0.004)
    assert answer.delay == pytest.approx(0.02, abs=0.004)


@pytest.mark.more
def test_without_the_wire_the_wait_is_derived_and_said(tmp_path):
    def cut(backend):
        world_of(backend)._capture_edges = lambda now: []

    _, result = measured(f"{URL}3", tmp_path, cut)
    wait = result.quantities["latency.command_to_pulse"]
    assert wait.method.startswith("derived")
    assert any("no pulse was seen at D8" in note for note in result.notes)
    assert result.quantities["latency.pulse_to_wheel"].std > 0.005


@pytest.mark.more
@pytest.mark.parametrize(("more", "why"), [
    ("&fail=enc:off@0s", "does not count|does not move"),
    ("&fail=enc:off@20s", "does not count|does not follow")])
def test_a_missing_encoder_is_named(tmp_path, more, why):
    with pytest.raises(CalibrationFailed, match=why):
        measured(f"{URL}2{more}", tmp_path)


@pytest.mark.more
def test_a_blocked_wheel_is_named(tmp_path):
    def hold(backend):
        world = world_of(backend)
        plain = world.motion.step

        def stuck(*given):
            felt = plain(*given)
            world.motion.v_x = 0.0
            return felt._replace(v_x=0.0, a_x=0.0)
        world.motion.step = stuck

    with pytest.raises(CalibrationFailed, match=r"does not move|does not count"):
        measured(f"{URL}2", tmp_path, hold)


@pytest.mark.more
def test_steering_that_answers_the_other_way_is_noticed(tmp_path):
    def turn_round(backend):
        backend.car_toml = backend.car_toml.replace("[steering]", "[steering]\ndirection = -1")

    with pytest.raises(CalibrationFailed, match=r"the right|the other way"):
        measured(f"{URL}2", tmp_path, turn_round)


def test_of_two_writes_within_a_frame_the_second_counts():
    grid = Grid(0.0, 0.02, 0.0, 0.0, 0.0, seen=True)
    ends, widths = grid.pulses(np.array([0.001, 0.019, 0.021]), np.array([1500.0, 1600.0, 1700.0]))
    assert widths.tolist() == [1600.0, 1700.0]
    assert ends == pytest.approx([0.0216, 0.0417])
    assert grid.doubtful(np.array([0.0001, 0.01, 0.0199])).tolist() == [True, False, True]


def test_what_nobody_sees_is_known_to_a_frame(files):
    grid = unseen_grid(files)
    assert grid.phase_std == pytest.approx(grid.period / np.sqrt(12.0))
    assert not grid.seen
