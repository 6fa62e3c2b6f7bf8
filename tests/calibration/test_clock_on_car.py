"""`calibrate clock` through the whole Car, against the hidden truth of simulated cars."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from fit_graphs import distance_from_fit

from dart_hal.calibration import clock
from dart_hal.calibration.clock import calibrate_clock, typed_clock
from dart_hal.calibration.measured import write
from dart_hal.car import Car
from dart_hal.core.config import Calibration, load_car
from dart_hal.core.errors import CalibrationFailed
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.pca9685 import Pca9685Model
from dart_lab.sim.truth import reveal, world_of

pytestmark = pytest.mark.usefixtures("armed_esc")
URL = "sim://?nano=mock&seed="
NAME = "pwm.oscillator_hz"


def measured(url, tmp_path, begin=lambda world: None):
    backend = open_backend(url)
    with Car.over(backend, cars=tmp_path) as car:
        begin(world_of(backend))
        found = calibrate_clock(car)
        assert distance_from_fit(found.graph) < 0.01
        return car.files, found.quantities[NAME]


@pytest.mark.slow
@pytest.mark.parametrize("url", [
    "1",
    *(pytest.param(url, marks=pytest.mark.slow) for url in (
        "2", "3&cutoff=oe", "4&cutoff=mux", "5&jitter=usb", "6&jitter=busy"))])
def test_hidden_clocks(tmp_path, url):
    """The error of the Nano's own clock, up to 0.3 %, has no effect."""
    _, found = measured(URL + url, tmp_path)
    true = reveal(int(url[0]))["sensors"][NAME]
    assert abs(found.value - true) < 3.0 * found.std
    assert found.std < 1e-4 * true


@pytest.mark.slow
@pytest.mark.emulator
def test_the_firmware_times_as_many_periods_as_requested(tmp_path):
    _, found = measured("sim://?nano=avr&seed=3", tmp_path)
    assert abs(found.value - reveal(3)["sensors"][NAME]) < 3.0 * found.std


@pytest.mark.slow
def test_control_by_the_nanos_clock_it_would_be_off(tmp_path, monkeypatch):
    monkeypatch.setattr(clock.SensorLog, "device_rate", lambda self: 1.0)
    _, found = measured(f"{URL}1", tmp_path)
    assert abs(found.value - reveal(1)["sensors"][NAME]) > 20.0 * found.std


@pytest.mark.slow
def test_without_the_wire_the_error_names_the_alternative(tmp_path):
    def cut(world):
        world._capture_edges = list

    with pytest.raises(CalibrationFailed, match="does not receive the PCA9685's pulses") as caught:
        measured(f"{URL}1", tmp_path, cut)
    assert "--frequency" in caught.value.remedy
    assert caught.match("4 %|4%")
    assert not list(tmp_path.rglob("calibration.toml"))


@pytest.mark.slow
def test_the_throttle_stays_neutral_and_the_pulse_goes_off(tmp_path):
    backend = open_backend(f"{URL}2")
    with Car.over(backend, cars=tmp_path) as car:
        world, widths = world_of(backend), []
        world.watchers.append(lambda channel, pulse: widths.append(pulse[1] - pulse[0])
                              if channel == 1 else None)
        calibrate_clock(car)
        chip: Pca9685Model = world.pca
        for _ in car.states(duration=0.1):
            pass
        assert chip.output.high_since(15) is None
        assert not chip.output.upcoming(15, world.t + 0.05)
    assert len(widths) > 400
    assert max(abs(w - 1500e-6) for w in widths) < 10e-6


def test_typed_frequency_becomes_the_oscillator(tmp_path):
    with Car.open(f"{URL}0", cars=tmp_path) as car:
        result = typed_clock(car.files, 50.0288, 0.005)
        assert result.quantities[NAME].value == pytest.approx(25e6, rel=1e-5)
        assert result.quantities[NAME].std == pytest.approx(0.005 * 122 * 4096)
        write(car.files, result)
        with pytest.raises(CalibrationFailed, match="no PCA9685 has such an oscillator"):
            typed_clock(car.files, 60.0, 0.01)
    with Car.open(f"{URL}0", cars=tmp_path) as car:
        assert car.files.oscillator_hz.std == pytest.approx(0.005 * 122 * 4096, rel=0.01)


def test_another_clock_outdates_every_result_in_pulse_widths():
    files = load_car("dart-01", ["cars"])
    steered = Calibration(car="dart-01", provenance={"esc": {}, "steering": {}, "imu": {}})
    measured = replace(files, calibration=steered)
    caution = typed_clock(measured, 1.02 * 25e6 / (122 * 4096), 0.005).notes[-1]
    assert "run dart-hal calibrate esc and steering again" in caution
    assert len(typed_clock(measured, 25e6 / (122 * 4096), 0.005).notes) == 1  # the same clock
    assert len(typed_clock(files, 1.02 * 25e6 / (122 * 4096), 0.005).notes) == 1  # none measured


def test_picture_of_a_typed_frequency_shows_the_error_of_the_pulses_that_it_removes(tmp_path):
    with Car.open(f"{URL}0", cars=tmp_path) as car:
        found = typed_clock(car.files, 1.02 * 25e6 / (122 * 4096), 0.005)
    before = car.files.oscillator_hz.value
    assert before == pytest.approx(25e6, rel=1e-3)
    graph = found.graph
    # A chip that is 2 % faster than known makes pulses that are 2 % shorter.
    assert graph.y == pytest.approx(graph.x * (before / (1.02 * 25e6) - 1.0))
    assert np.interp(1500.0, graph.x, graph.y) == pytest.approx(-29.4, abs=0.5)
    assert "29.4 us too short" in graph.title
    assert not graph.fit_y.any()
    assert graph.half == pytest.approx(1.645 * graph.x * 0.005 / 51.03, rel=1e-3)


@pytest.mark.slow
def test_frequency_and_std_are_required_together(tmp_path, capsys):
    from dart_hal.cli.main import main

    where = ["calibrate", "clock", "--url", f"{URL}0", "--cars", str(tmp_path), "--json"]
    with pytest.raises(SystemExit) as left:
        main([*where, "--frequency", "50.02"])
    assert left.value.code
    capsys.readouterr()
    with pytest.raises(SystemExit) as left:
        main([*where, "--frequency", "50.02", "--std", "0.01"])
    assert not left.value.code
    found = json.loads(capsys.readouterr().out)
    assert found["quantities"][NAME]["unit"] == "Hz"
    assert found["written"]
