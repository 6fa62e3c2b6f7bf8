"""Rows of the firmware alone: its ELF in the emulator, and a host that only knows the wire."""

from __future__ import annotations

import itertools
import math
from typing import Any

from dart_hal.wire.messages import STATE_FLAGS
from fault_table.bench import Bench
from fault_table.row import NEVER, Measured, Row, case
from fault_table.rows_pins import alone

IMU_VALID, STALE, STUCK, ABSENT, OVERRUN = (
    1 << STATE_FLAGS.index(name)
    for name in ("IMU_VALID", "IMU_STALE", "IMU_STUCK", "IMU_ABSENT", "SLOT_OVERRUN"))
SLOT_S = 0.01
AGE = 4e-6
"""s per count of imu_age."""
FRESH_S = 0.015
"""s: a sample of this slot is 7 ms old, the one before 17."""


def live(rig: Any, seconds: float, rate: float = 12.0) -> list[tuple[float, dict[str, Any]]]:
    """Run with a changing IMU and turning wheels; (time of arrival, STATE)."""
    if rig.now == 0.0:
        rig.run(0.02)
    start = len(rig.frames)
    for n in range(round(seconds / SLOT_S)):
        wave = math.sin(rig.now * 7)
        rig.nano.set_imu((0.2 * wave, 0.1, 1.0 + 0.3 * wave), (wave, 0.5, 0.2 * wave))
        rig.nano.set_wheel(rate + n % 2)
        rig.run(SLOT_S)
    return [(t, values) for t, name, values in rig.frames[start:] if name == "STATE"]


def steady(rig: Any) -> str:
    """"" if the stream had no gap and every edge was counted; else what was wrong."""
    ticks = [values["t_ck"] for values in rig.states()]
    jitter = max(abs(b - a - 20_000) for a, b in itertools.pairwise(ticks)) / 2e3
    rig.nano.set_wheel(0)
    rig.run(0.03)
    missed = rig.nano.edges(0) - rig.state()["enc_count"]
    return (f"STATE jitter {jitter:.2f} ms" if jitter > 0.5 else "") + (
        f"{missed} edges missed" if missed else "")


def judge_figure(rig: Any, value: float, detail: str = "") -> Measured:
    """The figure, or NEVER where stream or encoder suffered."""
    wrong = steady(rig)
    return Measured(NEVER if wrong else value, wrong or detail)


def refused_reads(bench: Bench) -> Measured:
    """States that call the sample before a refused read valid; 3 % of bytes are refused."""
    rig = bench.rig()
    live(rig, 1.0)
    rig.nano.set_i2c("nack", p=0.03)
    states = [values for _, values in live(rig, 3.0)]
    old = sum(bool(s["flags"] & IMU_VALID) and s["imu_age"] * AGE > FRESH_S for s in states)
    good = sum(bool(s["flags"] & IMU_VALID) for s in states)
    return judge_figure(rig, old, f"{good} of {len(states)} valid")


def hold_line(fault: str, mask: int, gone: bool, clocks: int = 9) -> Any:
    """ms until a flag of STATE reports that a line is held."""
    def measure(bench: Bench) -> Measured:
        rig = bench.rig()
        live(rig, 1.0)
        rig.nano.set_i2c(fault, clocks=clocks)
        at = rig.now
        times = [t for t, s in live(rig, 0.3) if bool(s["flags"] & mask) is not gone]
        return judge_figure(rig, 1e3 * (times[0] - at) if times else NEVER)
    return measure


def free_line(bench: Bench) -> Measured:
    """ms from the moment that SDA is held to the last clock that frees it."""
    rig = bench.rig()
    live(rig, 1.0)
    rig.nano.pin_log()
    rig.nano.set_i2c("sda", clocks=5)
    at = rig.now
    live(rig, 0.3)
    clocks = [e.t for e in rig.nano.pin_log() if e.pin == "SCL" and e.t > at]
    valid = bool(rig.state()["flags"] & IMU_VALID)
    return judge_figure(rig, 1e3 * (clocks[-1] - at) if clocks and valid else NEVER,
                        f"{len(clocks)} edges of SCL")


def back(fault: str, lasts: float) -> Any:
    """s from the end of a fault of the bus (or from a reset) to valid samples."""
    def measure(bench: Bench) -> Measured:
        rig = bench.rig()
        live(rig, 1.0)
        if fault == "reset":
            rig.nano.reset_imu()
        else:
            rig.nano.set_i2c(fault)
            live(rig, lasts)
            rig.nano.set_i2c("ok")
        at = rig.now
        bad = [t for t, s in live(rig, 4.0) if not s["flags"] & IMU_VALID]
        healed = bool(rig.state()["flags"] & IMU_VALID)
        return judge_figure(rig, max(bad, default=at) - at if healed else NEVER)
    return measure


def stuck(bench: Bench) -> Measured:
    """ms until samples that never change are reported and no longer valid."""
    rig = bench.rig()
    live(rig, 1.0)
    rig.nano.set_imu_fault("stuck")
    at = rig.now
    times = [t for t, s in live(rig, 0.5) if s["flags"] & STUCK and not s["flags"] & IMU_VALID]
    return judge_figure(rig, 1e3 * (times[0] - at) if times else NEVER)


def absent(bench: Bench) -> Measured:
    """s from power to ABSENT; a single valid sample before is NEVER."""
    rig = bench.rig()
    rig.nano.set_imu_fault("off")
    states = live(rig, 7.0)
    times = [t for t, s in states if s["flags"] & ABSENT]
    wrong = any(s["flags"] & IMU_VALID for _, s in states)
    return judge_figure(rig, times[0] if times and not wrong else NEVER)


def damage_parameters(bench: Bench) -> Measured:
    """Boots with one damaged byte of the parameters that believe something else than a default.

    Nor may a torn record be silent: the flag reports that defaults are in force.
    """
    from firmware_rig import FLAG, eeprom_image

    whole = eeprom_image(edges_per_rev_a=18)
    wrong = 0
    boots = 0
    for at in range(0xA0, 0xA0 + 40, 1 if bench.full else 3):
        image = bytearray(whole)
        image[at] ^= 0x04
        rig = bench.rig(eeprom=bytes(image))
        rig.run(0.25)
        edges = rig.hello()["edges_per_rev"][0]
        default = bool(rig.state()["flags"] & FLAG["PARAM_DEFAULTS"])
        wrong += (edges, default) not in ((18, False), (20, True))
        boots += 1
        rig.nano.close()
    return Measured(wrong, f"{boots} boots")


def storm(bench: Bench) -> Measured:
    """Bytes lost and slots overrun: full traffic, the IMU, and 5 kHz of edges."""
    rig = bench.rig()
    live(rig, 1.0)
    lost = rig.nano.uart_stats().overrun
    rig.nano.set_wheel(250.0)
    for n in range(150):
        for _ in range(3):
            rig.send("TIME_PING", ping_id=n)
        rig.send("HEARTBEAT", arm_token=rig.hello()["boot_nonce"])
        rig.run(0.02)
    over = sum(bool(s["flags"] & OVERRUN) for s in rig.states())
    bytes_lost = rig.nano.uart_stats().overrun - lost
    return Measured(bytes_lost + over, f"{bytes_lost} bytes, {over} slots")


def flood(bench: Bench) -> Measured:
    """Oldest heartbeat [ms] while the line is full of garbage and one comes each 20 ms."""
    rig = bench.rig()
    rig.run(0.5)
    noise = bytes((i * 37 + 11) % 255 + 1 for i in range(940)) + b"\0"
    nonce = rig.hello()["boot_nonce"]
    oldest = 0
    for n in range(100):
        rig.send("HEARTBEAT", arm_token=nonce)
        rig.nano.write(noise)
        states = [values for _, name, values in rig.run(0.02) if name == "STATE"]
        if n > 5:
            oldest = max([oldest, *(s["beat_age"] for s in states)])
    return Measured(oldest, f"{rig.nano.uart_stats().overrun} bytes lost")


ROWS = (
    Row(11, "IMU refuses reads", "age grows, flag; STATE at 100 Hz within 0.5 ms", (
        case("elf", "3 % of bytes", refused_reads, 0, "States", "imu_fail"),
    )),
    Row(12, "SDA held low", "TWI reset, clocks, STOP", (
        case("elf", "not valid", hold_line("sda", IMU_VALID, True, clocks=0), 20, "ms", "imu_fail"),
        case("elf", "stale", hold_line("scl", STALE, False), 30, "ms", "imu_stale"),
        case("elf", "freed", free_line, 20, "ms", "bus_clear", fast=True),
    )),
    Row(13, "SCL held low, BNO055 hung", "soft reset, then its supply", (
        case("elf", "after a reset", alone("imu_mode", back("reset", 0.0)), 1.0, "s",
             "imu_ladder"),
        case("elf", "SCL for 1 s", back("scl", 1.0), 2.3, "s", "imu_power"),
    )),
    Row(15, "IMU stuck, garbage, wrong, absent", "not valid, encoder only", (
        case("elf", "stuck", stuck, 200 + 20, "ms", "imu_stuck", fast=True),
        case("elf", "absent", absent, 6.0, "s", "imu_absent"),
    )),
    Row(16, "parameters torn or damaged in the EEPROM", "default with a flag", (
        case("elf", "each byte", damage_parameters, 0, "boots", "slot_crc"),
    )),
    Row(20, "interrupt storm", "no byte lost, no slot overrun", (
        case("elf", "traffic and 5 kHz", storm, 0, "bytes", "short_interrupts"),
    )),
    Row(31, "the line to the Nano full of garbage", "heartbeats heard, loop not starved", (
        case("elf", "full rate", flood, 20 + 20, "ms", "short_interrupts"),
    )),
)
