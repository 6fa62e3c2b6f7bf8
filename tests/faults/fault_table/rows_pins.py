"""Rows asserted at the ESC pin in virtual time: link, Nano, bus, commands, RAW."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from math import inf, nan
from typing import Any

from dart_hal.car import Car
from fault_table.bench import Bench
from fault_table.drive import FULL, Drive, forward
from fault_table.layers import remove_layers
from fault_table.row import NEVER, Measured, Row, case

MS = "ms"
PULSE = 20.0
"""ms: the period of the pulse that may be under way."""
SLOT = 0.010
"""s of the Nano's slot: one STATE."""
PHASES = 12
"""Phases of the PWM frame to the slot in which a hang is tried."""
# [s] A start after which the pulses of a car that hangs last nearly as long as of any.
LATE_START = 0.0175
AFTER_FEED = 0.0075
"""s from a STATE to the moment at which a hang lasts longest: the watchdog has just been fed."""


def silence(nano: str) -> Callable[[Bench], Measured]:
    def measure(bench: Bench) -> Measured:
        drive = bench.drive(nano=nano).driving()
        at = drive.silence()
        drive.car.drive(throttle=0.4, valid_for=0.5)
        drive.run(1.5)
        return Measured(drive.last_wrong(at), drive.car.mode)
    return measure


def reset(nano: str, options: str, hello_lost: bool = False) -> Callable[[Bench], Measured]:
    """Last driving pulse after a reset at full throttle; the user goes on requesting for 3.5 s."""
    def measure(bench: Bench) -> Measured:
        drive = bench.drive(options, nano=nano).driving(FULL)
        drive.deaf_to_hello = hello_lost
        at = drive.fail("mcu:brownout")
        drive.run(3.5, forward(FULL, 0.5))
        new = [t for t, _ in drive.hellos if t > at]
        hello = f"new HELLO {1e3 * (new[0] - at):.0f} ms after it" if new else "no new HELLO"
        return Measured(drive.last_wrong(at), f"{hello}, {drive.car.mode}")
    return measure


def after_hello(nano: str, options: str) -> Callable[[Bench], Measured]:
    """ms from the new boot's first HELLO to the last driving pulse."""
    def measure(bench: Bench) -> Measured:
        drive = bench.drive(options, nano=nano).driving(FULL)
        at = drive.fail("mcu:brownout")
        drive.run(3.5, forward(FULL, 0.5))
        new = [t for t, _ in drive.hellos if t > at]
        return Measured(drive.last_wrong(new[0]) if new else NEVER, drive.car.mode)
    return measure


def jump(nano: str) -> Callable[[Bench], Measured]:
    """Edges by which the pose outran the car when the Nano restarted at speed."""
    def measure(bench: Bench) -> Measured:
        drive = bench.drive(nano=nano).driving()
        edge = drive.car.files.metres_per_edge.value
        before = drive.states[-1]
        drive.fail("mcu:brownout")
        states = [before, *drive.run(1.5)]
        went = [drive.world.truth(state.t).distance for state in states]
        ahead = [abs(state.pose.x - before.pose.x) - (at - went[0])
                 for state, at in zip(states, went, strict=True)]
        return Measured(max(ahead) / edge, f"{min(ahead) / edge:.0f} edges behind at most")
    return measure


def fault(options: str, text: str, nano: str = "elf", command: float = 0.4,
          ) -> Callable[[Bench], Measured]:
    """Last driving pulse after a failure of this name; the user goes on asking."""
    def measure(bench: Bench) -> Measured:
        drive = bench.drive(options, nano={"elf": "avr"}.get(nano, nano)).driving(command)
        at = drive.fail(text)
        drive.run(2.0, forward(command, 0.5))
        return Measured(drive.last_wrong(at), drive.car.mode)
    return measure


def hang(cutoff: str, text: str) -> Callable[[Bench], Measured]:
    """Last driving pulse after the Nano hangs: the worst of 12 phases of slot and PWM frame."""
    def measure(bench: Bench) -> Measured:
        states = []
        phases = [(0.3 + k * 2 * SLOT / PHASES, AFTER_FEED) for k in range(PHASES)] \
            if bench.full else [(0.0, 0.0), (LATE_START, AFTER_FEED)]
        for opened, delay in phases:
            with Drive(bench.folder, f"&cutoff={cutoff}", nano="avr", opened=opened,
                       brief=bench.brief) as drive:
                drive.driving()
                at = drive.fail(text, delay=delay)
                drive.run(0.5, forward(0.4, 0.5))
                states.append(drive.last_wrong(at))
        return Measured(max(states),
                        f"{min(states):.0f} to {max(states):.0f} ms over {len(states)} phases")
    return measure


def host_dead(options: str, nano: str) -> Callable[[Bench], Measured]:
    """Bus and line have no writer any more: driver and guard are gone, or the computer is."""
    def measure(bench: Bench) -> Measured:
        drive = bench.drive(options, nano=nano).driving()
        at = drive.now
        drive.backend.clock.sleep(2.0)
        return Measured(drive.last_wrong(at))
    return measure


def alone(removed: str, measure: Callable[[Bench], Measured]) -> Callable[[Bench], Measured]:
    """The same with a second fault: a layer that would have answered too is gone."""
    def both(bench: Bench) -> Measured:
        with remove_layers(removed):
            return measure(bench)
    return both


def prescale(nano: str) -> Callable[[Bench], Measured]:
    """The frequency is halved: each pulse is a third longer until it is detected."""
    def measure(bench: Bench) -> Measured:
        drive = bench.drive(nano=nano).driving()
        at = drive.now
        for data in (b"\x00\x31", b"\xfe\xa0", b"\x00\x21"):
            drive.backend.bus.writeto(0x40, data)
        drive.run(2.5, forward(0.4, 0.5))
        return Measured(drive.last_wrong(at), drive.car.mode)
    return measure


def brown_out(bench: Bench) -> Measured:
    """ms until the car is no longer ARMED after the PCA9685 lost its registers."""
    drive = bench.drive().driving()
    at = drive.fail("pca:brownout")
    states: list[float] = []

    def look(car, state):  # type: ignore[no-untyped-def]
        car.drive(throttle=0.4)
        if car.mode != "ARMED":
            states.append(drive.now)

    drive.run(2.5, look)
    again = drive.last_wrong(at)
    found = 1e3 * (states[0] - at) if states else NEVER
    return Measured(max(found, again), f"last driving pulse {again:.0f} ms after it")


WILD = {"nan": nan, "inf": inf, "1e300": 1e300, "10**400": 10**400, "True": True, "None": None,
        "'x'": "x", "1.5": 1.5}


def wild(bench: Bench) -> Measured:
    """ms until neutral after each wild throttle, the worst; 1.5 may be limited instead."""
    return refuse_command(bench, WILD, lambda car, value: car.drive(throttle=value, valid_for=0.5))


def wild_speeds(bench: Bench) -> Measured:
    """ms until neutral after each setpoint of the speed loop that is not a finite number."""
    speeds = {name: WILD[name] for name in ("nan", "'x'")}
    return refuse_command(bench, speeds, lambda car,
                          value: car.drive_speed(steering=0.0, speed=value))


def refuse_command(bench: Bench, values: dict[str, Any], command: Callable[[Car, Any], object],
                   ) -> Measured:
    """ms until neutral after ``command`` with each of the values; it must raise, but for 1.5."""
    worst = 0.0
    results = []
    for name, value in values.items():
        with Drive(bench.folder, brief=bench.brief) as drive:
            drive.driving()
            at = drive.now
            error = ""
            try:
                command(drive.car, value)
            except Exception as raised:  # noqa: BLE001 - any exception is judged
                error = type(raised).__name__
            drive.run(0.8)
            last = drive.last_wrong(at)
            if name != "1.5":
                worst = max(worst, last if error else NEVER)
            results.append(f"{name}: {error or 'accepted'} {last:.0f}")
    return Measured(worst, ", ".join(results))


def backward(bench: Bench) -> Measured:
    """Time going back."""
    drive = bench.drive().driving()
    at = drive.now
    with suppress(ValueError):
        drive.car._engine.driver.actuator.command(0.0, 0.4, 0.5, "user", at - 1.0)
    drive.run(0.8)
    return Measured(drive.last_wrong(at), drive.car.mode)


def stall_loop(bench: Bench) -> Measured:
    """A loop that computes: without a request; the last command was good for 0.5 s."""
    drive = bench.drive().driving()
    drive.car.drive(throttle=0.4, valid_for=60.0)
    at = drive.now
    drive.run(3.0)
    return Measured(drive.last_wrong(at), drive.car.mode)


def raw_stall(bench: Bench) -> Measured:
    """A calibration that sends one pulse and then computes."""
    drive = bench.drive()
    drive.run(1.0)
    with drive.car.raw():
        drive.run(0.2, lambda car, state: car.pulses(steering_us=1500, throttle_us=1700))
        at = drive.now
        drive.run(3.0)
        return Measured(drive.last_wrong(at), drive.car.mode)


AFTER_RESET = {
    ("none", False): ("reboot_disarm",),
    ("old", False): ("reboot_disarm", "link_stale"),
    ("optiboot", False): ("reboot_disarm",),
    ("none", True): ("cutoff", "reboot_disarm", "cut_off"),
    ("old", True): ("cutoff",),
    ("optiboot", True): ("cutoff",),
}
"""Who answers a reset, by bootloader and whether a cut-off is fitted. The old one is silent
for 1.3 s, which the host takes for a lost link before it hears of a reset."""

ROWS = (
    Row(4, "100 ms of silence on the line", "flag, throttle neutral by the HAL", (
        case("mock", "line off", silence("mock"), 100 + PULSE, MS, "link_stale", fast=True),
        case("elf", "line off", silence("avr"), 100 + PULSE, MS, "link_stale"),
    )),
    Row(8, "Nano reset in mid stream, at full throttle", "disarmed, neutral for ever after", (
        *(case(world, f"{boot}, {cut}", reset(nano, f"&boot={boot}&cutoff={cut}"),
               120.0 if cut == "none" else 40.0, MS, *AFTER_RESET[boot, cut != "none"],
               fast=world == "mock" and boot == "none")
          for world, nano in (("mock", "mock"), ("elf", "avr"))
          for boot in ("none", "old", "optiboot") for cut in ("none", "oe", "mux")),
        case("mock", "after the new HELLO", after_hello("mock", "&boot=none"), 40.0, MS,
             "reboot_disarm", fast=True),
        case("mock", "HELLOs lost", reset("mock", "&boot=none", True), 120.0, MS,
             "reboot_disarm", fast=True),
        case("mock", "HELLOs lost, mux", reset("mock", "&boot=none&cutoff=mux", True),
             40.0, MS, *AFTER_RESET["none", True]),
        case("mock", "odometry", jump("mock"), 1.0, "edges", "rebase"),
        case("elf", "odometry", jump("avr"), 1.0, "edges", "rebase"),
    )),
    Row(9, "Nano main loop hangs", "watchdog interrupt: outputs safe", (
        case("elf", "oe", hang("oe", "mcu:hang"), 80, MS, "watchdog", fast=True),
        case("elf", "mux", hang("mux", "mcu:hang"), 80 + PULSE, MS, "watchdog",
             "link_stale", "beat_interrupt"),
        case("elf", "none", hang("none", "mcu:hang"), 100 + PULSE, MS, "link_stale"),
        case("elf", "interrupts off, oe", hang("oe", "mcu:freeze"), 80, MS, "watchdog"),
        case("elf", "interrupts off, mux", hang("mux", "mcu:freeze"), 80, MS, "watchdog"),
    )),
    Row(25, "driver and guard killed, kernel dead, computer without power", "the Nano cuts", (
        *(case(world, cut, host_dead(f"&cutoff={cut}", nano), 120 + PULSE, MS, *control,
               fast=world == "mock")
          for world, nano, control in (("mock", "mock", ("cutoff",)),
                                       ("elf", "avr", ("beat_loop", "beat_interrupt")))
          for cut in ("oe", "mux")),
        case("elf", "mux, the loop deaf", alone("beat_loop", host_dead("&cutoff=mux", "avr")),
             120 + PULSE, MS, "beat_interrupt"),
        case("elf", "mux, the interrupt deaf",
             alone("beat_interrupt", host_dead("&cutoff=mux", "avr")), 120 + PULSE, MS,
             "beat_loop"),
    )),
    Row(27, "PCA9685 brown-out, NACK, wrong prescale", "found by read-back, neutral, disarm", (
        case("mock", "brown-out", brown_out, 1100.0, MS, "read_back", fast=True),
        case("mock", "prescale", prescale("mock"), 1100.0, MS, "read_back"),
    )),
    Row(28, "I2C write fails while driving", "2 retries, then the cut-off", (
        case("mock", "mux", fault("&cutoff=mux", "pca:nack", "mock"), 20 + PULSE, MS, "cutoff",
             fast=True),
        case("mock", "oe", fault("&cutoff=oe", "pca:nack", "mock"), 20 + PULSE, MS, "cutoff"),
        case("elf", "mux", fault("&cutoff=mux", "pca:nack"), 20 + PULSE, MS, "cutoff"),
        case("elf", "oe", fault("&cutoff=oe", "pca:nack"), 20 + PULSE, MS, "cutoff"),
    )),
    Row(29, "command NaN, inf, out of range, no number, time going back",
        "refused with a reason, neutral", (
            case("mock", "wild numbers", wild, PULSE, MS, "bad_command", fast=True),
            case("mock", "wild speeds", wild_speeds, PULSE, MS, "bad_command", fast=True),
            case("mock", "time going back", backward, PULSE, MS, "bad_command", fast=True),
        )),
    Row(33, "Nano loses power with a cut-off fitted", "outputs off, or signal loss", (
        *(case("elf", cut, fault(f"&cutoff={cut}", "power:nano"), 20 + PULSE, MS, "cutoff")
          for cut in ("oe", "mux")),
    )),
    Row(34, "the user's loop stalls", "the command runs out", (
        case("mock", "valid_for 0.5 s", stall_loop, 500 + PULSE, MS, "expiry", fast=True),
    )),
    Row(35, "a calibration stalls in RAW", "pulses run out", (
        case("mock", "one pulse of 1700 us", raw_stall, 250.0, MS, "raw_hold", fast=True),
    )),
)
