"""The battery by a divider at the Nano: its error, what it detects, and the limit at the pin."""

from __future__ import annotations

import logging

import pytest

from dart_hal.car import Car
from dart_hal.core.errors import BatteryUnmeasured, ConfigError
from dart_hal.devices.battery.divider import decode_divider
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.battery import DIVIDER_RATIO
from dart_lab.sim.truth import world_of
from dart_lab.sim.world import THROTTLE_CHANNEL
from tests.common import NEUTRAL_TOLERANCE_US, NEUTRAL_US

MAX_ERROR = 0.02
"""Stated relative error; in the emulator the band gap is exact, and counts alone remain."""
COUNTS_ERROR = 0.008
NANO_URL = "sim://?physics=kinematic&nano={}&battery=nano"


def read_voltage(nano: str, supply: float = 5.0, connected: bool = True) -> tuple[float, float]:
    """The voltage that a car reads after one second, and the true one [V]."""
    backend = open_backend(NANO_URL.format(nano))
    world = world_of(backend)
    world.nano.set_vcc(supply)
    with Car.over(backend) as car:
        world.divider.connected = connected
        for state in car.states(duration=1.0):
            pass
        return state.battery, world.divider.battery.voltage


@pytest.mark.slow_except("mock-5.2")
@pytest.mark.parametrize("supply", [4.6, 5.0, 5.2])
@pytest.mark.parametrize("nano", ["mock", "avr"])
def test_the_voltage_is_within_its_error_at_any_supply(nano, supply):
    measured, true = read_voltage(nano, supply)
    assert measured == pytest.approx(true, rel=COUNTS_ERROR)


def test_control_of_a_reading_against_the_supply_alone():
    """Without the band gap the supply of 4.6 V would be taken for 5 V."""
    counts = {"pin": 4 * 593, "reference": 4 * 244, "pulled": 650}   # 2.667 V at 4.6 V
    assert decode_divider(counts, DIVIDER_RATIO, 2) == pytest.approx(8.0, rel=MAX_ERROR)
    assert pytest.approx(8.0, rel=MAX_ERROR) != DIVIDER_RATIO * 5.0 * 593 / 1023


@pytest.mark.slow_except("mock")
@pytest.mark.parametrize("nano", ["mock", "avr"])
def test_a_divider_that_is_off_gives_none_and_one_notice(nano, caplog):
    """Control: the same car with its divider has a voltage, above."""
    with caplog.at_level(logging.WARNING, "dart_hal"):
        measured, _ = read_voltage(nano, connected=False)
    assert measured is None
    assert len([m for m in caplog.messages if "no divider holds A0" in m]) == 1


@pytest.mark.parametrize(("pin", "reference", "pulled"), [
    (2000, 900, 1023), (4092, 900, 500), (2000, 0, 500), (0, 900, 60), (3400, 900, 860)])
def test_counts_that_are_no_battery_are_refused(pin, reference, pulled):
    """Floating, upper or lower resistor off, no conversion, no battery, three cells for two."""
    values = {"pin": pin, "reference": reference, "pulled": pulled}
    assert isinstance(decode_divider(values, DIVIDER_RATIO, 2), BatteryUnmeasured)


@pytest.mark.slow
@pytest.mark.parametrize(("charge", "limited"), [(-0.1, True), (0.8, False)])
def test_an_empty_battery_limits_the_throttle_at_the_pin(charge, limited):
    backend = open_backend(NANO_URL.format("avr") + f",charge={charge}")
    pulses = []
    world_of(backend).watchers.append(lambda channel, pulse: channel == THROTTLE_CHANNEL
                                      and pulses.append(1e6 * (pulse[1] - pulse[0])))
    with Car.over(backend) as car:
        for _ in car.states(duration=1.0):
            pass
        car.arm()
        for state in car.states(duration=1.5):
            car.drive(throttle=0.5)
        span = car.files.config.throttle.span_us
        assert ("BATTERY" in state.applied.limited) == limited
        limit = NEUTRAL_US + 0.2 * span + NEUTRAL_TOLERANCE_US
        assert (max(pulses[-10:]) <= limit) == limited


@pytest.mark.slow
def test_a_recording_has_the_voltage_at_the_rate_of_the_readings(tmp_path):
    run = tmp_path / "run.mcap"
    with Car.open(NANO_URL.format("mock"), record=run) as car:
        live = [state.battery for state in car.states(duration=1.5)]
    with Car.open(f"replay://{run}") as again:
        replayed = [state.battery for state in again.states()]
    assert set(live) - {None} <= set(replayed)
    assert run.read_bytes().count(b"/battery") > 0


@pytest.mark.parametrize("table", ['source = "nano"', 'source = "nano"\nratio = 1.5',
                                   'source = "nano"\nratio = 3.0\ncells = 4',
                                   'source = "usb"', "ratio = 50.0"])
def test_a_wrong_table_of_a_divider_is_refused(table):
    backend = open_backend("sim://?nano=mock")
    backend.car_toml += f"\n[battery]\n{table}\n"
    with pytest.raises(ConfigError, match="battery"):
        Car.over(backend)
