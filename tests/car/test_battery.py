"""The voltage of the battery: in the State, the recording and at the ESC's pin."""

from __future__ import annotations

import logging
import time
from dataclasses import replace
from math import nan

import numpy as np
import pytest

from dart_hal.car import Car, join
from dart_hal.car.battery import (
    DECIDING_READINGS,
    READ_INTERVAL,
    BatteryLimit,
    BatteryMonitor,
    RecordedBattery,
)
from dart_hal.car.runs import read_run
from dart_hal.core.config.car import BatteryConfig
from dart_hal.core.errors import BusError, ConfigError, UsageError
from dart_hal.core.url import Url
from dart_hal.devices.battery.ina219 import check_ina219, decode_voltage
from dart_hal.devices.links.base import open_backend
from dart_hal.fleet.peers import Peers
from dart_hal.fleet.transports.local import open_local
from dart_hal.recording.run import RunReader
from dart_lab.live.view.told import status_message
from dart_lab.sim.battery import Ina219Model, SimBattery, parse_battery
from dart_lab.sim.truth import world_of
from dart_lab.sim.world import THROTTLE_CHANNEL
from tests.common import NEUTRAL_TOLERANCE_US, NEUTRAL_US

pytestmark = pytest.mark.usefixtures("armed_esc")

URL = "sim://?nano=mock&physics=kinematic&battery="
# Charge at which the voltage at rest is above the limit, and under load below it.
NEARLY_EMPTY = "charge=0.1"
# Throttle of a count of the PCA9685, by which its pulses alternate.
THROTTLE_COUNT = 0.012


class Drive:
    """A car that is driven with a throttle; pulses: of the ESC's pin (t [s], us)."""

    def __init__(self, battery, throttle=0.5, seconds=4.0, change=None, record=None):
        backend = open_backend(URL + battery)
        self.world = world_of(backend)
        self.chip = next((d for d in self.world.bus.devices if isinstance(d, Ina219Model)), None)
        self.pulses = []
        self.throttle = throttle
        self.states = []
        self.applied = []
        self.world.watchers.append(self._watch)
        with Car.over(backend, record=record) as car:
            for _ in car.states(duration=1.0):
                pass
            car.arm()
            for state in car.states(duration=seconds):
                if change is not None:
                    change(self, state)
                self.applied.append(car.drive(steering=0.0, throttle=self.throttle))
                self.states.append(state)
            self.ended = self.world.t

    def _watch(self, channel, pulse):
        if channel == THROTTLE_CHANNEL:
            self.pulses.append((pulse[1], (pulse[1] - pulse[0]) * 1e6))

    def late_us(self):
        """Pulses of the last second of driving [us]."""
        return [us for t, us in self.pulses if self.ended - 1.0 < t < self.ended]


@pytest.mark.slow
def test_the_voltage_is_in_the_state_and_sags_with_the_load():
    driven = Drive("1", throttle=0.5)
    volts = [s.battery for s in driven.states]
    assert volts[0] == pytest.approx(2 * (3.3 + 0.9 * 0.8) - 0.04 * 1.0, abs=0.01)
    assert volts[-1] == pytest.approx(volts[0] - 0.04 * 15.0 * 0.5, abs=0.08)
    assert "BATTERY" not in {reason for a in driven.applied for reason in a.limited}
    assert not driven.chip.written, "a reading writes no register"


@pytest.mark.slow
def test_a_car_without_a_sensor_has_no_voltage_and_no_transfer():
    driven = Drive("0", seconds=0.5)
    assert {s.battery for s in driven.states} == {None}
    assert not [one for one in driven.world.bus.log if one.address == 0x41]


def test_a_low_battery_limits_the_throttle_at_the_pin():
    driven = Drive(NEARLY_EMPTY, throttle=0.5)
    limit = NEUTRAL_US + 0.2 * (max(us for _, us in driven.pulses) - NEUTRAL_US) / 0.5
    assert max(us for _, us in driven.pulses) > limit + 50.0, "it first had its full throttle"
    assert max(driven.late_us()) <= limit + NEUTRAL_TOLERANCE_US
    assert min(driven.late_us()) > NEUTRAL_US + 20.0, "it can still drive home"
    assert "BATTERY" in driven.applied[-1].limited
    assert driven.states[-1].applied.throttle == pytest.approx(0.2, abs=THROTTLE_COUNT)
    assert driven.states[-1].applied.throttle_us == pytest.approx(driven.late_us()[-1], abs=6.0)


@pytest.mark.slow
def test_control_a_full_battery_has_its_whole_throttle():
    driven = Drive("charge=0.9", throttle=0.5)
    assert driven.states[-1].applied.throttle == pytest.approx(0.5, abs=THROTTLE_COUNT)
    assert min(driven.late_us()) == pytest.approx(max(driven.late_us()), abs=6.0)
    assert "BATTERY" not in driven.applied[-1].limited


@pytest.mark.slow
@pytest.mark.parametrize("throttle", [0.1, -0.1])
def test_a_smaller_throttle_is_not_changed(throttle):
    driven = Drive("charge=-0.1", throttle=throttle)
    assert driven.states[-1].battery < 6.6
    assert driven.states[-1].applied.throttle == pytest.approx(throttle, abs=THROTTLE_COUNT)
    assert "BATTERY" not in driven.applied[-1].limited


@pytest.mark.slow
def test_the_brake_is_not_limited():
    def brake(driven, state):
        driven.throttle = 0.5 if state.t < 4.0 else -0.5

    driven = Drive("charge=-0.1", change=brake)
    assert any(a.throttle == pytest.approx(0.2, abs=THROTTLE_COUNT) for a in driven.applied)
    assert driven.states[-1].applied.throttle == pytest.approx(-0.5, abs=THROTTLE_COUNT)
    assert "BATTERY" not in driven.applied[-1].limited
    full = min(driven.late_us()) - NEUTRAL_US
    limited = max(us for t, us in driven.pulses if t < 4.0) - NEUTRAL_US
    assert full < -2.0 * limited, "at the pin"


@pytest.mark.slow
def test_raw_pulses_are_limited_too():
    backend = open_backend(URL + "charge=-0.1")
    with Car.over(backend) as car, car.raw():
        span = car.files.config.throttle.span_us
        for _ in car.states(duration=2.5):
            applied = car.pulses(steering_us=1500.0, throttle_us=1700.0)
    assert "BATTERY" in applied.limited
    assert applied.throttle_us <= NEUTRAL_US + 0.2 * span + NEUTRAL_TOLERANCE_US


def test_the_limit_has_a_hysteresis():
    limit = BatteryLimit(BatteryConfig())
    states = []
    for cell in (3.4, 3.25, 3.4, 3.49, 3.51):
        for _ in range(DECIDING_READINGS):
            limit.add(2 * cell)
        states.append((limit.low, limit.limited))
    assert states == [(True, False), (True, True), (True, True), (True, True), (True, False)]


def test_a_short_sag_is_no_empty_battery():
    limit = BatteryLimit(BatteryConfig())
    for volts in [7.4] * 4 + [6.0] * (DECIDING_READINGS - 1) + [7.4]:
        limit.add(volts)
        assert not limit.limited
        assert not limit.low


@pytest.mark.slow
def test_a_sensor_that_is_lost_gives_none_one_notice_and_no_delay(caplog):
    def lose(driven, state):
        driven.chip.absent = driven.world.t > 2.5

    with caplog.at_level(logging.WARNING, "dart_hal"):
        driven = Drive("1", change=lose)
    assert driven.states[0].battery is not None
    assert driven.states[-1].battery is None
    assert [m for m in caplog.messages if "no battery voltage" in m] == [
        next(m for m in caplog.messages if "no battery voltage" in m)]
    assert driven.states[-1].applied.throttle == pytest.approx(0.5, abs=THROTTLE_COUNT)
    gaps = [b - a for (a, _), (b, _) in zip(driven.pulses[60:], driven.pulses[61:], strict=False)]
    assert max(gaps) < 0.021


@pytest.mark.slow
def test_a_limit_stays_when_the_sensor_is_lost():
    def lose(driven, state):
        driven.chip.absent = "BATTERY" in state.applied.limited or driven.chip.absent

    driven = Drive(NEARLY_EMPTY, change=lose)
    assert driven.states[-1].battery is None
    assert driven.states[-1].applied.throttle == pytest.approx(0.2, abs=THROTTLE_COUNT)


def test_another_chip_at_the_address_is_not_read(caplog):
    backend = open_backend(URL + "1")
    chip = next(d for d in world_of(backend).bus.devices if isinstance(d, Ina219Model))
    chip.configuration = 0xE2E4
    with caplog.at_level(logging.WARNING, "dart_hal"), Car.over(backend) as car:
        for state in car.states(duration=1.5):
            assert state.battery is None
    assert len([m for m in caplog.messages if "is no INA219" in m]) == 1


@pytest.mark.parametrize("registers", [
    {0: 0x399F, 2: 0x0000, 5: 0}, {0: 0x399F, 2: 0x7FFA, 5: 0}, {0: 0x3998, 2: 0x39D2, 5: 0},
    {0: 0xB99F, 2: 0x39D2, 5: 0}, {0: 0x399F, 2: 0x39D6, 5: 0}, {0: 0x399F, 2: 0x39D2, 5: 1},
    {0: 0x1111, 2: 0xE2E2, 5: 0xE0E0}])
def test_what_is_no_ina219_is_refused(registers):
    with pytest.raises(BusError, match="no INA219"):
        check_ina219(Registers(registers), 0x41, 2)


class Registers:
    """A bus with one device, whose 16-bit registers are given."""

    where = "a bus of a test"

    def __init__(self, registers):
        self._registers = registers

    def writeto_then_readfrom(self, address, out_buffer, in_buffer, **cut):
        in_buffer[:] = self._registers[out_buffer[0]].to_bytes(2, "big")


def test_the_registers_of_the_data_sheet_are_accepted():
    """7.4 V are 1850 counts of 4 mV: 1850 * 8 = 0x39D0, with the bit of a ready conversion."""
    check_ina219(Registers({0: 0x399F, 2: 0x39D2, 5: 0}), 0x41, 2)
    assert decode_voltage(0x39D2) == pytest.approx(7.4)
    assert decode_voltage(0x1F42) == pytest.approx(4.0)


@pytest.mark.slow
def test_a_recording_has_the_voltage_and_a_replay_gives_it(tmp_path):
    def lose(driven, state):
        driven.chip.absent = driven.world.t > 3.0

    run = tmp_path / "run.mcap"
    driven = Drive("1", change=lose, record=run)
    with Car.open(f"replay://{run}") as again:
        replayed = {s.seq: s.battery for s in again.states()}
    live = {s.seq: s.battery for s in driven.states}
    assert {replayed[n] for n in live} == set(live.values())
    assert [replayed[n] for n in live] == list(live.values())
    assert None in live.values()


@pytest.mark.slow
def test_a_recording_without_a_sensor_has_no_channel(tmp_path):
    run = tmp_path / "run.mcap"
    Drive("0", seconds=0.3, record=run)
    with Car.open(f"replay://{run}") as again:
        assert {s.battery for s in again.states()} == {None}
    assert b"/battery" not in run.read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize(("silence", "measured"), [
    (0.0, True), (3.5, False), pytest.param(1.5, True, marks=pytest.mark.slow)])
def test_a_read_run_has_a_voltage_that_was_measured_throughout(tmp_path, silence, measured):
    def lose(driven, state):
        driven.chip.absent = 1.5 < driven.world.t < 1.5 + silence

    Drive("charge=0.8,resistance=0.1", seconds=4.0, change=lose, record=tmp_path / "run.mcap")
    battery = read_run(tmp_path / "run.mcap").battery
    assert (battery is not None) == measured
    if battery is not None:
        # 1 A at rest, 8.5 A at half throttle: 0.75 V of 7.94 V - 0.1 V less.
        resting, driving = battery.interpolate(np.array([0.5, 4.0]))
        assert resting == pytest.approx(7.94, abs=0.01)
        assert driving == pytest.approx(7.94 - 0.75, abs=0.08)


@pytest.mark.slow
def test_the_voltage_of_a_filmed_run_is_on_the_clock_of_its_poses(tmp_path):
    run = tmp_path / "run.mcap"
    with Car.open("sim://?seed=3&nano=mock&battery=1&mocap=1", record=run) as car:
        list(car.states(duration=1.5))
    filmed, plain = read_run(run), read_run(run, poses=False)
    shift = next(RunReader(run).applied()).t - filmed.commands.t[0]
    assert abs(shift) > 0.001
    assert plain.battery.t - filmed.battery.t == pytest.approx(shift)


@pytest.mark.slow
def test_readings_come_at_their_low_rate_and_between_the_pulses():
    driven = Drive("1", seconds=3.0)
    log = driven.world.bus.log
    reads = [one for one in log if one.address == 0x41 and one.written == b"\x02"]
    span = reads[-1].t_start - reads[0].t_start
    assert len(reads) == pytest.approx(span / READ_INTERVAL, abs=3)
    writes = [one.t_start for one in log if one.address == 0x40]
    for one in reads[2:]:
        assert min(t for t in writes if t > one.t_start) - one.t_stop > 0.005


@pytest.mark.parametrize("text", ["2", "charge=2", "charge=x", "volts=7", "charge=0,charge=0"])
def test_options_of_the_battery_that_make_no_sense_are_refused(text):
    with pytest.raises(UsageError):
        parse_battery(text)


def test_the_charge_is_used_up():
    world = world_of(open_backend(URL + "1"))
    battery = SimBattery(world, parse_battery("rest_current=10,capacity=0.1"))
    while world.t < 3.6:
        world.advance(3.6)
    assert battery.charge == pytest.approx(0.8 - 10.0 * 3.6 / 360.0, abs=0.002)


@pytest.mark.parametrize("table", ["address = 0x40", "cells = 0", "limit_cell = 3.9",
                                   "limited_throttle = 1.5", "warn_cell = nan", "volts = 7"])
def test_a_wrong_table_is_refused(table):
    backend = open_backend(URL + "0")
    backend.car_toml += f"\n[battery]\n{table}\n"
    with pytest.raises(ConfigError, match="battery"):
        Car.over(backend)


@pytest.mark.slow
def test_the_live_page_gets_the_voltage():
    found = []
    for battery in "10":
        with Car.open(URL + battery) as car:
            for state in car.states(duration=1.5):
                pass
            found.append(status_message(car, state, {})["battery"])
    assert found == [pytest.approx(8.0, abs=0.05), None]


@pytest.mark.realtime
def test_a_thread_reads_it_in_real_time():
    with Car.open(URL + "1&pace=1") as car:
        for state in car.states(duration=1.5):
            pass
        assert state.battery == pytest.approx(8.0, abs=0.05)


@pytest.mark.slow
def test_a_bus_that_hangs_delays_no_frame():
    class HangingBus:
        where = "a bus of a test"

        def writeto_then_readfrom(self, address, out_buffer, in_buffer, **cut):
            time.sleep(0.3)
            raise OSError(110, "Connection timed out")

    backend = replace(open_backend(URL + "1"), bus=HangingBus(), virtual=False)
    battery = BatteryMonitor(backend, BatteryConfig())
    took = []
    for k in range(20):
        begun = time.monotonic()
        battery.update(0.02 * k)
        took.append(time.monotonic() - begun)
        time.sleep(0.02)
    battery.close()
    assert max(took) < 0.02
    assert battery.voltage is None
    assert "bus did not become free" in str(battery.trouble)


def test_nan_in_a_recording_is_no_voltage():
    battery = RecordedBattery([(1.0, 7.4), (2.0, nan)])
    found = []
    for t in (1.0, 1.5, 2.5):
        battery.reach(t)
        found.append(battery.voltage)
    assert found == [None, 7.4, None]


@pytest.mark.slow_except("0")
@pytest.mark.parametrize("battery", ["1", "0"])
def test_other_cars_of_a_room_receive_the_voltage(battery):
    """A car without a sensor, the control, sends none."""
    room = open_local(Url.parse("local://battery"))
    peers = Peers("blue", 1)
    with Car.open(URL + battery) as car, join(car, "local://battery", name="red"):
        state = list(car.states(duration=1.0))[-1]
        peers.receive(room, car.now)
        health = peers.other_poses(car.now)["red"].health
    room.close()
    expected = None if state.battery is None else pytest.approx(state.battery, abs=0.05)
    assert health.battery == expected
    assert (state.battery is not None) == (battery == "1")
