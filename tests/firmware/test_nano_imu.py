"""The ELF in simavr: STATE and the encoder go on under any fault of the IMU and its bus."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path

import pytest
from firmware_rig import FLAG, Rig, build_patched, eeprom_image

from dart_hal.estimation.imu_clock import PERIOD, ImuClock

pytestmark = pytest.mark.emulator
Make = Callable[..., Rig]
VALID, STALE, STUCK, ABSENT = (FLAG[f"IMU_{n}"] for n in ("VALID", "STALE", "STUCK", "ABSENT"))


def alive(rig: Rig, seconds: float) -> list[int]:
    """Run with a changing IMU and a turning wheel; flags per STATE."""
    if rig.now == 0:
        rig.run(0.02)  # the ring counts from 3 ms after the reset on
    start = rig.now
    for n in range(round(seconds / 0.01)):
        wave = math.sin(rig.now * 7)
        rig.nano.set_imu((0.2 * wave, 0.1, 1.0 + 0.3 * wave), (wave, 0.5, 0.2 * wave))
        rig.nano.set_wheel(12 + n % 2)
        rig.run(0.01)
    return [s["flags"] for s in rig.states(start)]


def check_stream(rig: Rig) -> None:
    ticks = [s["t_ck"] for s in rig.states()]
    assert all(abs(b - a - 20_000) <= 1000 for a, b in itertools.pairwise(ticks))
    rig.nano.set_wheel(0)
    rig.run(0.03)
    assert rig.state()["enc_count"] == rig.nano.edges(0)


def test_samples_are_valid_half_a_second_after_power(nano: Make) -> None:
    rig = nano()
    alive(rig, 1.0)
    assert rig.state()["flags"] & VALID
    assert not rig.state()["flags"] & STALE
    first = next(i for i, s in enumerate(rig.states()) if s["flags"] & VALID)
    assert first <= 60
    assert not rig.states()[0]["flags"] & VALID
    assert rig.states()[0]["imu_age"] == 65535


def test_values_and_age(nano: Make) -> None:
    rig = nano()
    rig.nano.set_imu((0.1, -0.2, 0.3), (1, -2, 3))
    rig.run(1.5)
    state = rig.state()
    assert state["gyro"] == pytest.approx((90, -180, 270), abs=2)
    assert state["lin_acc"] == pytest.approx((100, -200, 300), abs=2)
    assert state["imu_age"] * 4e-6 == pytest.approx(6.5e-3, abs=0.3e-3)


@pytest.mark.parametrize("clock", [0.006, -0.006])
@pytest.mark.slow
def test_looks_measure_the_clock_of_the_part(nano: Make, clock: float) -> None:
    """Its clock against the Nano's, which is true here: phase to 0.5 ms, rate to 3 %."""
    rig = nano()
    rig.nano.set_imu_errors(clock=clock)
    alive(rig, 4.5)
    follower = ImuClock()
    sampled = []
    for state in rig.states(0.6):
        read = state["t_ck"] * 0.5e-6 - state["imu_age"] * 4e-6
        sampled.append(follower.sample_time(read, state["calib"] & 3))
    assert {state["calib"] & 3 for state in rig.states(0.6)} >= {1, 2, 3 if clock > 0.0 else 0}
    assert follower.rate == pytest.approx(clock, rel=0.03)
    late = [t for t in sampled[-150:] if t is not None]
    turns = [(t - late[0]) * (1.0 + clock) / PERIOD for t in late]
    assert max(abs(turn - round(turn)) for turn in turns) < 0.05


def test_a_slow_part_is_read_and_not_looked_at(nano: Make) -> None:
    """At 300 us a byte a look would be in the way of the read."""
    rig = nano()
    rig.nano.set_i2c("ok", stretch_us=300)
    flags = alive(rig, 2.0)
    assert all(f & VALID for f in flags[100:])
    assert {state["calib"] & 3 for state in rig.states(1.0)} == {0}


@pytest.mark.slow
def test_one_in_ten_reads_refused(nano: Make) -> None:
    rig = nano()
    alive(rig, 1.0)
    rig.nano.set_i2c("nack", p=0.01)
    flags = alive(rig, 2.0)
    assert sum(bool(f & VALID) for f in flags) > 0.5 * len(flags)
    assert not all(f & VALID for f in flags)
    check_stream(rig)


@pytest.mark.slow_except("9")
@pytest.mark.parametrize("clocks", [1, 5, 9])
def test_sda_held_low_is_freed_at_once_by_up_to_nine_clocks(nano: Make, clocks: int) -> None:
    """One sample is lost: a bus clear of fewer clocks needs several slots for nine."""
    rig = nano()
    alive(rig, 1.0)
    rig.nano.set_i2c("sda", clocks=clocks)
    flags = alive(rig, 0.5)
    assert [i for i, f in enumerate(flags) if not f & VALID] == [1]
    check_stream(rig)


TWBR = 0xB8
WITHOUT_STOP = ("src/board/twi.cpp", "  scl_low();\n  sda_low();\n  half_period();\n", "")


def time_of_stop(rig: Rig) -> float | None:
    """s from the last rise of SCL in a bus clear to the rise of SDA behind it; None: no rise."""
    alive(rig, 1.0)
    rig.nano.set_i2c("sda", clocks=5)
    rig.nano.pin_log()
    alive(rig, 0.05)
    log = rig.nano.pin_log()
    scl = [event for event in log if event.pin == "SCL"]
    sda = [event for event in log if event.pin == "SDA"]
    assert scl[-1].level is None, "not driven"
    return sda[-1].t - scl[-1].t if sda and sda[-1].level is None else None


def test_a_bus_clear_ends_with_a_stop(nano: Make) -> None:
    """A part that lost count of its byte waits for SDA to rise while SCL is high: half a period."""
    assert time_of_stop(nano()) == pytest.approx(5e-6, abs=0.5e-6)


@pytest.mark.slow
def test_a_bus_clear_of_clocks_alone_makes_no_stop(nano: Make, elf: Path, tmp_path: Path) -> None:
    """The control."""
    assert time_of_stop(nano(build_patched(tmp_path, WITHOUT_STOP))) is None


@pytest.mark.parametrize(("khz", "bit_rate"), [(400, 12), (100, 72)])
def test_the_bus_has_the_clock_of_the_parameter_also_after_a_bus_clear(nano: Make, khz: int,
                                                                       bit_rate: int) -> None:
    """16 MHz / (16 + 2 n). The BNO055 bears 400 kHz; at n = 0 it would be 1 MHz."""
    rig = nano(eeprom=eeprom_image(twi_khz=khz))
    alive(rig, 0.8)
    assert rig.nano.peek(TWBR) == bit_rate
    rig.nano.set_i2c("sda", clocks=5)
    alive(rig, 0.05)
    assert rig.nano.peek(TWBR) == bit_rate


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["scl", "sda", "dead"])
def test_a_dead_bus_never_stops_the_stream_and_heals(nano: Make, fault: str) -> None:
    rig = nano()
    alive(rig, 1.0)
    rig.nano.set_i2c(fault, clocks=0)                # no clock frees it
    flags = alive(rig, 1.0)
    assert not flags[2] & VALID
    assert flags[3] & STALE
    rig.nano.set_i2c("ok")
    alive(rig, 2.5)
    assert rig.state()["flags"] & VALID
    check_stream(rig)


@pytest.mark.slow
def test_an_absent_imu_is_reported_within_6_s(nano: Make) -> None:
    rig = nano()
    rig.nano.set_imu_fault("off")
    flags = alive(rig, 6.0)
    assert not any(f & VALID for f in flags)
    assert flags[-1] & ABSENT
    assert [s["lin_acc"] for s in rig.states()] == [(0, 0, 0)] * len(rig.states())
    check_stream(rig)
    rig.nano.set_imu_fault("ok")
    alive(rig, 7.0)
    assert rig.state()["flags"] & VALID
    assert not rig.state()["flags"] & ABSENT


@pytest.mark.slow
def test_a_reset_of_the_part_is_over_within_1_4_s(nano: Make) -> None:
    rig = nano()
    alive(rig, 1.0)
    rig.nano.reset_imu()
    alive(rig, 1.4)
    assert rig.state()["flags"] & VALID
    check_stream(rig)


def test_stuck_is_reported_after_200_ms_of_driving(nano: Make) -> None:
    rig = nano()
    alive(rig, 1.0)
    rig.nano.set_imu_fault("stuck")
    flags = alive(rig, 0.3)
    first = next(i for i, f in enumerate(flags) if f & STUCK)
    assert 19 <= first <= 22
    assert not flags[first] & VALID
    check_stream(rig)


def test_a_part_slower_than_the_deadline(nano: Make) -> None:
    rig = nano()
    rig.nano.set_i2c("ok", stretch_us=900)
    alive(rig, 2.0)
    check_stream(rig)
    assert not rig.state()["flags"] & VALID


@pytest.mark.slow
def test_offsets_are_stored_at_rest_and_restored_after_a_reset(nano: Make) -> None:
    rig = nano()
    rig.nano.set_imu_errors(calibrated_after=(0.1, 0.1, 0.1))
    rig.nano.set_imu((0.0, 0.01, 0.0), (0.0, 0.0, 0.05))  # zeros would be no sample
    rig.run(5.0)
    saved = rig.nano.eeprom
    assert saved[0x20:0x22] == b"\x44\x4f" or saved[0x60:0x62] == b"\x44\x4f"
    rig.nano.reset("external")
    rig.run(1.5)
    assert not any("factory" in str(v) for _, n, v in rig.frames[-100:] if n == "LOG")
    assert rig.state()["flags"] & VALID
    stored = rig.nano.eeprom
    at = 0x60 if stored[0x60:0x62] == b"\x44\x4f" else 0x20
    assert bytes(rig.nano.imu_register(0x55 + i) for i in range(22)) == stored[at + 6:at + 28]


def test_d4_switches_the_supply_and_the_lines_are_low(nano: Make) -> None:
    rig = nano(eeprom=eeprom_image())
    alive(rig, 1.0)
    rig.nano.pin_log()
    rig.nano.set_i2c("scl")
    rig.run(0.4)
    log = rig.nano.pin_log()
    d4 = [e for e in log if e.pin == "D4"]
    assert d4[0].level == 0
    assert d4[1].level == 1
    assert d4[1].t - d4[0].t == pytest.approx(0.1, abs=0.008)
    driven = {e.pin: e.level for e in log if e.t <= d4[0].t + 20e-6}
    assert driven.get("SDA") == 0
    assert driven.get("SCL") == 0
    assert not any(e.pin in ("SDA", "SCL") and e.level == 1 for e in log)  # never driven high
