"""Rows of who may drive: ports, buses, chips, firmware that does not fit, refusals."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any
from unittest.mock import patch

from dart_hal.car import Car
from dart_hal.car.driver import Driver as CarDriver
from dart_hal.core.errors import BusError, DartHalError, LinkLost, NotArmed
from dart_hal.devices.links.base import open_backend
from dart_hal.wire.messages import PARAM_SET, PARAMS
from dart_lab.sim.cutoff import Direct
from fault_table.bench import Bench
from fault_table.drive import WAIVED, Drive
from fault_table.row import NEVER, Measured, Row, case
from fault_table.rows_pins import MS, PULSE, alone
from fault_table.rows_processes import TRIES

OWNER_TIMEOUT_S = 20.0
REQUIRE_CUTOFF_TEST = (r"\Z", "\n[safety]\ncutoff_test = true\n")
"""Edit of car.toml."""


def takes(car: Any) -> None:
    """A program that requests throttle in a loop, under any exception."""
    for _ in car.states(timeout=1.0):
        car.drive(throttle=0.3, valid_for=0.5)


def second_port(bench: Bench) -> Measured:
    """Programs that get the port in addition to its holder; the holder is named."""
    with bench.process_rig() as rig:
        driver = rig.driver()
        got = 0
        message = ""
        try:
            Car.open(rig.url, car=rig.name, cars=rig.cars).close()
            got = 1
        except DartHalError as error:
            message = f"{type(error).__name__}: {error.found}"
        named = str(driver.pid) in message
        time.sleep(0.2)
        return Measured(got + (not named) + (not rig.drove(time.monotonic())), message)


def two_drivers(bench: Bench) -> Measured:
    """Cars that are opened on a bus whose PCA9685 is driven, by another Nano's program."""
    with bench.process_rig() as one, bench.process_rig() as other:
        driver = one.driver()
        url = other.url.partition("?")[0] + "?" + one.url.partition("?")[2]
        got = 0
        message = ""
        try:
            Car.open(url, car=one.name, cars=one.cars).close()
            got = 1
        except DartHalError as error:
            message = f"{type(error).__name__}: {error.found}"
        time.sleep(0.2)
        still = one.drove(time.monotonic())
        return Measured(got + (not still), f"{message}; pid {driver.pid} drives on: {still}")


def unplug_nano(bench: Bench) -> Measured:
    """The Nano's cable comes out, the bus stays: last driving pulse."""
    with bench.process_rig() as rig:
        rig.driver()
        time.sleep(0.3)
        at = rig.order("unplug")
        time.sleep(1.5)
        return Measured(rig.last_wrong(at))


def idle(bench: Bench) -> Measured:
    """Share of a processor that a driver without its Nano takes, over 2 s [%]."""
    with bench.process_rig() as rig:
        driver = rig.driver("patient")
        time.sleep(0.3)
        rig.order("unplug")
        time.sleep(1.0)
        before = processor_time(driver.pid)
        time.sleep(2.0)
        return Measured(100 * (processor_time(driver.pid) - before) / 2.0)


def processor_time(pid: int) -> float:
    """s of user and system time of a process."""
    import os
    from pathlib import Path

    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def plug_in_again(bench: Bench) -> Measured:
    """s from plugging in again, as another tty, to States; disarmed, or it is NEVER."""
    with bench.process_rig() as rig, Car.open(rig.url, car=rig.name, cars=rig.cars) as car:
        for _ in car.states(duration=0.5, timeout=OWNER_TIMEOUT_S):
            pass
        rig.order("unplug")
        with suppress(LinkLost):
            for _ in car.states(timeout=0.5):
                pass
        time.sleep(0.5)
        at = rig.order("plug")
        while time.monotonic() - at < 8.0:
            with suppress(LinkLost):
                next(car.states(timeout=0.2))
                return Measured(time.monotonic() - at if car.mode == "DISARMED" else NEVER,
                                car.mode)
            time.sleep(0.01)
        return Measured(NEVER, car.mode)


class OtherChip:
    """A chip of 16-bit registers at the address of the PCA9685; it keeps what is written."""

    def __init__(self) -> None:
        self.written: list[bytes] = []
        self.pointer = 0

    def read(self, n: int) -> bytes:
        return (b"\x54\x49" * n)[:n] if self.pointer == 0xFE else (b"\x39\x9f" * n)[:n]


def meet_other_chip(bench: Bench) -> Measured:
    """Bytes written to a power monitor that answers at 0x40."""
    chip = OtherChip()
    backend = open_backend("sim://?nano=mock")

    def writeto(address: int, data: bytes, **_: Any) -> None:
        if data:
            chip.pointer = data[0]
        if len(data) > 1:
            chip.written.append(bytes(data))

    def readfrom(address: int, into: bytearray, **_: Any) -> None:
        into[:] = chip.read(len(into))

    def both(address: int, data: bytes, into: bytearray, **_: Any) -> None:
        writeto(address, data)
        readfrom(address, into)

    # type: ignore[union-attr]
    backend.bus.writeto = writeto
    backend.bus.readfrom_into = readfrom
    backend.bus.writeto_then_readfrom = both  # type: ignore[union-attr]
    message = ""
    try:
        Car.over(backend, cars=bench.folder).close()
    except BusError as error:
        message = type(error).__name__
    return Measured(sum(len(data) for data in chip.written), message)


def after_crash(bench: Bench) -> Measured:
    """Pulses above neutral after the first word of a new process to a chip left at throttle."""
    drive = bench.drive().driving()
    bus = drive.backend.bus
    clock = drive.backend.clock
    clock.sleep(0.2)
    drive.pulses.clear()
    at = drive.now
    fresh = CarDriver(drive.car.files, drive.backend, None, None)  # type: ignore[arg-type]
    fresh.actuator.open()
    clock.sleep(1.0)
    assert bus is not None
    wrong = [pulse for pulse in drive.pulses if drive.wrong(pulse) and pulse[0] > at + 0.022]
    return Measured(len(wrong), f"of {len(drive.pulses)} pulses")


def count_armed(bench: Bench) -> Measured:
    """Cars that arm although they must not, or do not name the reason."""
    silent = 0
    message = []
    for name, spoil in SPOILS.items():
        with Drive(bench.folder, brief=bench.brief) as drive:
            drive.run(drive.settling + 0.3)
            spoil(drive)
            try:
                drive.car.arm(waive=WAIVED)
                silent += 1
                message.append(f"{name}: armed")
            except NotArmed as error:
                if name not in error.reasons:
                    silent += 1
                    message.append(f"{name}: {', '.join(error.reasons)}")
    return Measured(silent, "; ".join(message) or f"{len(SPOILS)} reasons")


def _imu_off(drive: Drive) -> None:
    drive.fail("imu:off")
    drive.run(4.0)


def _throttle(drive: Drive) -> None:
    drive.car.drive(throttle=0.3, valid_for=0.5)


def _push(drive: Drive) -> None:
    nano = drive.world.nano
    nano.set_wheel(1.0)
    nano.set_wheel = lambda rate: None  # type: ignore[method-assign]
    drive.run(0.3)


def _nack(drive: Drive) -> None:
    drive.backend.bus.nack = 10**9
    drive.run(0.3)


SPOILS: dict[str, Callable[[Drive], None]] = {
    "IMU_STALE": _imu_off, "THROTTLE_NOT_NEUTRAL": _throttle, "ENCODER_MOVING": _push,
    "PCA_ABSENT": _nack}


def beat_limit(bench: Bench) -> Measured:
    """A Nano that waits 1 s for a heartbeat before it cuts: 0 = the car refuses to arm."""
    drive = bench.drive("&cutoff=mux")
    drive.run(1.0)
    number = next(p.id for p in PARAMS if p.name == "beat_timeout_ms")
    drive.car._engine.transmitter.send(
        PARAM_SET, {"id": number, "reserved": 0, "value": 1000}, drive.now)
    drive.run(0.3)
    drive.fail("mcu:reset")
    drive.run(2.5)
    message = ""
    try:
        drive.car.arm(waive=WAIVED)
    except NotArmed as error:
        message = ", ".join(error.reasons)
    return Measured(0 if "BEAT" in message else 1, message or "armed")


def weld_cutoff(cut: str) -> Callable[[Bench], Measured]:
    """Cars that arm although the cut-off that the Nano announces is a plain wire."""
    def measure(bench: Bench) -> Measured:
        with patch("dart_lab.sim.world.make_wiring", lambda _, pca: Direct(pca)):
            drive = bench.drive(f"&cutoff={cut}")
        drive.run(drive.settling)
        try:
            drive.car.arm(waive=WAIVED)
        except NotArmed as error:
            return Measured(not any("CUTOFF" in name for name in error.reasons),
                            ", ".join(error.reasons))
        return Measured(1, drive.car.mode)
    return measure


def unwire_capture(cut: str) -> Callable[[Bench], Measured]:
    """Cars that arm with cutoff_test = true although no pulse ever reaches the capture input."""
    def measure(bench: Bench) -> Measured:
        with patch("dart_lab.sim.world.World._capture_edges", lambda world: []):
            drive = bench.drive(f"&cutoff={cut}", edit=REQUIRE_CUTOFF_TEST)
            drive.run(drive.settling)
            try:
                drive.car.arm(waive=WAIVED)
            except NotArmed as error:
                return Measured("CUTOFF_TEST_FAILED" not in error.reasons,
                                ", ".join(error.reasons))
        return Measured(1, drive.car.mode)
    return measure


def cut_alone(bench: Bench) -> Measured:
    """ms for which the host reports ARMED though its Nano, which has restarted, gives neutral."""
    drive = bench.drive("&cutoff=mux&boot=none").driving()
    drive.deaf_to_hello = True
    at = drive.fail("mcu:brownout")
    armed = [at]

    def look(car: Car, state: Any) -> None:
        if car.mode == "ARMED":
            armed.append(drive.now)
        car.drive(throttle=0.4)

    drive.run(1.5, look)
    return Measured(1e3 * (armed[-1] - at), drive.car.mode)


def chatter(cut: str) -> Callable[[Bench], Measured]:
    """A million edges a second at D2 and the computer dies: last driving pulse."""
    def measure(bench: Bench) -> Measured:
        drive = bench.drive(f"&cutoff={cut}", nano="avr").driving()
        at = drive.fail("enc:chatter=1000000")
        drive.backend.clock.sleep(0.5)
        return Measured(drive.last_wrong(at))
    return measure


def neighbours(bench: Bench) -> Measured:
    """Two cars, two guards, one driver killed: idle pulses of the other, driving ones of it."""
    for attempt in range(1, TRIES + 1):
        with bench.process_rig() as one, bench.process_rig() as other:
            killed = one.driver()
            lives = other.driver()
            time.sleep(0.3)
            at = time.monotonic()
            killed.process.kill()
            time.sleep(1.0)
            after = [width for t, width in other.pulses() if t > at]
            wrong = sum(width < 1510.0 for width in after) + (one.last_wrong(at) > 100.0)
            calm = one.drove(at) and other.drove(at) and not other.longest_stall(at, at + 1.0)
        if calm:
            break
    return Measured(wrong if len(after) > 20 else NEVER,
                    f"{len(after)} pulses of pid {lives.pid}, try {attempt}")


ROWS = (
    Row(5, "cable of the Nano unplugged", "LinkLost, neutral, no busy loop", (
        case("pty", "neutral", alone("link_stale", unplug_nano), 100 + PULSE, MS,
             "lost"),
        case("pty", "processor", idle, 2.0, "%", "hold_pace"),
    )),
    Row(6, "plugged in again as another tty", "found by its number, disarmed", (
        case("pty", "States again", plug_in_again, 3.0, "s", "search"),
    )),
    Row(7, "second process opens the port", "refused, holder's pid named", (
        case("pty", "port", alone("owner", second_port), 0, "programs", "port_lock"),
    )),
    Row(26, "new process after a crash", "neutral before the chip wakes", (
        case("mock", "pulses above neutral", after_crash, 0, "pulses", "open_neutral", fast=True),
    )),
    Row(30, "throttle, moving wheels, IMU or bus fault at arm", "refused, reasons named", (
        case("mock", "not refused", count_armed, 0, "cars", "refusals", fast=True),
    )),
    Row(40, "two drivers, two Nanos, one bus", "the second is refused, the first drives on", (
        case("pty", "opened", two_drivers, 0, "cars", "owner"),
    )),
    Row(41, "something else answers at 0x40", "read before any write", (
        case("mock", "power monitor", meet_other_chip, 0, "bytes", "signature", fast=True),
    )),
    Row(42, "another heartbeat limit in the Nano", "noticed, refused", (
        case("mock", "1000 ms", beat_limit, 0, "cars", "refusals", fast=True),
    )),
    Row(45, "the cut-off is bridged, or never wired", "found at arm()", (
        *(case("mock", cut, weld_cutoff(cut), 0, "cars", "cutoff_test", fast=cut == "mux")
          for cut in ("oe", "mux")),
        *(case("mock", f"{cut}, not wired", unwire_capture(cut), 0, "cars", "cutoff_test",
               fast=cut == "mux") for cut in ("oe", "mux")),
    )),
    Row(46, "the Nano cuts and the host does not know", "noticed, disarmed", (
        case("mock", "mux, HELLOs lost", alone("reboot_disarm", cut_alone), 100.0, MS, "cut_off"),
    )),
    Row(43, "encoder input chatters at 1 M edges/s, the computer dies", "the Nano cuts", (
        *(case("elf", f"{cut}, no watchdog", alone("watchdog", chatter(cut)), 120 + PULSE, MS,
               "edge_budget") for cut in ("oe", "mux")),
    )),
    Row(44, "two cars on one computer, one driver killed", "the other drives on", (
        case("pty", "wrong pulses", neighbours, 0, "pulses", "guard"),
    )),
)
