"""The capture wire: the board's clock as the Nano sees it, against the hidden truth."""

from __future__ import annotations

import sys

import pytest

from dart_hal.core.config import parse_car
from dart_hal.core.errors import EmulatorMissing, LinkLost
from dart_hal.devices.actuation.pca9685 import Pca9685
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of
from tests.common import ROOT

sys.path.insert(0, str(ROOT / "hardware"))

import measure_clock


def truth(url: str) -> float:
    """Hz, hidden from the program."""
    backend = open_backend(url)
    try:
        return float(world_of(backend).car.oscillator_hz)
    finally:
        backend.close()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [7, 8, 9])
def test_it_finds_the_hidden_clock(seed):
    url = f"sim://?seed={seed}&nano=mock"
    hertz, std = measure_clock.measure(url)
    assert hertz == pytest.approx(truth(url), rel=50e-6)
    assert std < 2000


@pytest.mark.emulator
@pytest.mark.slow
def test_the_firmware_times_it():
    url = "sim://?seed=7&nano=avr"
    try:
        open_backend(url).close()
    except EmulatorMissing as error:
        pytest.skip(f"emulator: {error.what}")
    assert measure_clock.measure(url)[0] == pytest.approx(truth(url), rel=50e-6)


@pytest.mark.parametrize("cutoff", ["oe", "mux"])
def test_a_cut_off_lets_the_pulses_pass_while_it_measures(cutoff, short):
    url = f"sim://?seed=7&nano=mock&cutoff={cutoff}"
    assert measure_clock.measure(url)[0] == pytest.approx(truth(url), rel=500e-6)


@pytest.mark.slow
def test_without_heartbeats_a_cut_off_shows_nothing(monkeypatch, short):
    monkeypatch.setattr(measure_clock.Heart, "beat", lambda self, mode: None)
    with pytest.raises(LinkLost, match="timed no pulse"):
        measure_clock.measure("sim://?seed=7&nano=mock&cutoff=oe")


@pytest.fixture
def short(monkeypatch):
    """2 s of pulses instead of 20."""
    monkeypatch.setattr(measure_clock, "PERIODS", 100)
    monkeypatch.setattr(measure_clock, "PATIENCE", 5.0)


@pytest.mark.slow
def test_without_comparing_the_clocks_the_resonator_shows(monkeypatch):
    """Control: the Nano of seed 7 is 565 ppm off, and that is taken out."""
    monkeypatch.setattr(measure_clock, "rate", lambda pairs: (0.5e-6, 0.0))
    url = "sim://?seed=7&nano=mock"
    assert abs(measure_clock.measure(url)[0] / truth(url) - 1) > 400e-6


def test_no_wire_is_reported(monkeypatch, capsys):
    monkeypatch.setattr(Pca9685, "write_channel", lambda *_: None)
    monkeypatch.setattr(measure_clock, "PERIODS", 50)
    monkeypatch.setattr(measure_clock, "PATIENCE", 3.0)
    monkeypatch.setattr(sys, "argv", ["measure_clock.py", "sim://?seed=7&nano=mock"])
    assert measure_clock.main() == 2
    message = capsys.readouterr().err
    assert "the Nano timed no pulse" in message
    assert "check the capture wire" in message


def test_no_bus_is_reported(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["measure_clock.py", "avr://default"])
    monkeypatch.setattr(measure_clock, "open_backend", without_bus)
    assert measure_clock.main() == 2
    assert "names no I2C bus" in capsys.readouterr().err


def without_bus(url):
    backend = open_backend("sim://?nano=mock")
    backend.bus = None
    return backend


@pytest.mark.slow
def test_it_prints_what_car_toml_takes(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["measure_clock.py", "sim://?seed=7&nano=mock"])
    assert measure_clock.main() == 0
    text = (ROOT / "cars" / "dart-01" / "car.toml").read_text(encoding="utf-8")
    line = capsys.readouterr().out.splitlines()[1]
    files = parse_car(text.replace("[pwm]", f"[pwm]\n{line}"), "test")
    assert files.oscillator_hz.value == pytest.approx(25_220_131, abs=50)
