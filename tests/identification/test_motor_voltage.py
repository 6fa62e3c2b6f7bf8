"""The voltage at which a motor holds: found in recordings, stated in model files and worlds."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from dart_hal.core.config import load_model, save_model
from dart_hal.core.config.model import parse_model
from dart_hal.core.errors import ConfigError
from dart_hal.core.url import Url
from dart_hal.recording.dart import BatteryVoltage
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.load import vehicle_of
from dart_lab.identification.battery import find_mean_voltage, set_motor_voltage
from dart_lab.identification.outcome import identify
from dart_lab.identification.write import build_model
from dart_lab.sim.battery import NOMINAL_VOLTAGE
from dart_lab.sim.drawn import resolve_car
from tests.diagnosis import made_by_hand

FADING = apply(PAPER, "battery_fade", k=-0.1)


@pytest.fixture(scope="module")
def drive():
    """A drive whose pack falls evenly from 8 to 7 V."""
    made = made_by_hand.recording()
    span = made.messages.arrival[[0, -1]]
    return replace(made, battery=BatteryVoltage(span, np.array([8.0, 7.0])))


def test_the_mean_is_that_of_the_time_with_a_throttle(drive):
    m = drive.messages
    resting = replace(drive, messages=replace(
        m, throttle=np.where(m.arrival < m.arrival[[0, -1]].mean(), 0.0, 0.3)))
    assert find_mean_voltage([resting]) == pytest.approx(7.25, abs=0.02)
    assert find_mean_voltage([resting, replace(drive, battery=None)]) is None
    assert find_mean_voltage([]) is None


def test_a_new_fade_counts_from_the_model_else_from_the_recordings(drive):
    bare = replace(drive, battery=None)
    stated = replace(PAPER, motor_voltage=7.4)
    assert set_motor_voltage(PAPER, [drive]).motor_voltage == find_mean_voltage([drive])
    assert set_motor_voltage(stated, [drive]) == stated
    assert set_motor_voltage(stated, [drive, bare]).motor_voltage is None
    for kept in (FADING, replace(FADING, motor_voltage=7.4)):
        assert set_motor_voltage(kept, [drive]) == set_motor_voltage(kept, [bare]) == kept


def test_the_file_of_a_model_states_it(tmp_path):
    path = save_model(model_of(PAPER), tmp_path / "model.toml")
    assert load_model(path).motor_voltage is None
    save_model(msgspec.structs.replace(load_model(path), motor_voltage=7.4), path)
    assert vehicle_of(load_model(path)) == replace(vehicle_of(model_of(PAPER)), motor_voltage=7.4)
    with pytest.raises(ConfigError, match="motor_voltage"):
        parse_model(path.read_text().replace("7.4", "0.0"), "model.toml")


@pytest.mark.slow
def test_an_identified_motor_holds_at_the_voltage_of_its_recordings(drive):
    def write(base):
        found = identify([drive], base, ("friction", "motor"))
        made = build_model(found.fits, base, found.source)
        assert "motor" in made.sections
        return made.model.motor_voltage, found.fits["motor"].notes

    assert write(model_of(PAPER))[0] == find_mean_voltage([drive])
    # A base with battery_fade keeps the law of its k.
    volt, notes = write(model_of(FADING))
    assert volt is None
    assert any("states no motor_voltage" in note for note in notes)
    assert write(model_of(replace(FADING, motor_voltage=7.4)))[0] == 7.4


@pytest.mark.parametrize(("vehicle", "battery", "expected"), [
    (PAPER, "1", NOMINAL_VOLTAGE), (PAPER, "0", None), (FADING, "1", None),
    (replace(FADING, motor_voltage=8.0), "1", 8.0), (replace(FADING, motor_voltage=8.0), "0", 8.0)])
def test_a_world_with_a_battery_has_a_reference(tmp_path, vehicle, battery, expected):
    path = save_model(model_of(vehicle), tmp_path / "model.toml")
    car = resolve_car(Url.parse(f"sim://?vehicle={path}&battery={battery}"))
    assert car.true.vehicle.motor_voltage == expected
    left_out = expected is not None and battery == "0"
    assert ["battery_fade" in notice for notice in car.notices] == [True] * left_out
