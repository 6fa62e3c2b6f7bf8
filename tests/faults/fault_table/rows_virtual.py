"""Rows of processes and ports once more, in virtual time or without a car: the quick run has them.

The guard is that of ``world_guard``; a program that is killed or stopped is a world that goes on
without it.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from contextlib import suppress

from dart_hal.car import guarding
from dart_hal.car.exit_signals import stop_on_signals
from dart_hal.car.pump import ThreadPump
from dart_hal.core.errors import DartHalError, LinkLost
from dart_hal.core.types import State
from dart_hal.core.url import Url
from dart_hal.devices.links.base import Backend
from dart_hal.devices.links.serial_port import SerialLink
from fault_table.bench import Bench
from fault_table.drive import Drive, forward
from fault_table.layers import list_removed
from fault_table.row import NEVER, Measured, Row, case
from fault_table.rows_pins import MS, PULSE
from fault_table.world_guard import WorldGuard

DRIVE_SECONDS = 1.0
"""s that the world goes on after the fault."""


def drive_with_guard(bench: Bench) -> tuple[Drive, WorldGuard]:
    """A car on its way with its guard."""
    drive = bench.drive()
    drive.run(0.1)
    guard = WorldGuard(drive)
    bench._stack.callback(guard.close)
    return drive.driving(), guard


def kill_driver(bench: Bench) -> Measured:
    """Last driving pulse after the driver is gone."""
    drive, guard = drive_with_guard(bench)
    at = drive.now
    guard.kill_driver()
    drive.backend.clock.sleep(DRIVE_SECONDS)
    return Measured(drive.last_wrong(at))


def stop_process(bench: Bench) -> Measured:
    """Last driving pulse after SIGSTOP; SIGCONT comes 0.8 s later and the program goes on."""
    drive, _ = drive_with_guard(bench)
    at = drive.now
    drive.backend.clock.sleep(0.8)
    drive.run(0.5, forward(0.4, 0.5))
    return Measured(drive.last_wrong(at), drive.car.mode)


def guard_killed(bench: Bench) -> Measured:
    """Last driving pulse after the guard is gone; the program goes on requesting."""
    drive, guard = drive_with_guard(bench)
    at = drive.now
    guard.kill()
    drive.run(0.5, forward(0.4, 0.5))
    return Measured(drive.last_wrong(at), ", ".join(drive.car.causes))


def listener(bench: Bench) -> Measured:
    """Last driving pulse after a listener blocks for a second, within the step of the engine."""
    drive, _ = drive_with_guard(bench)
    at = drive.now
    blocks = [DRIVE_SECONDS]

    def block(state: State) -> None:
        if blocks:
            drive.backend.clock.sleep(blocks.pop())

    drive.car.on_state(block)
    with suppress(LinkLost):
        drive.run(1.2, forward(0.4, 0.5))
    return Measured(drive.last_wrong(at), drive.car.mode)


def neighbour(bench: Bench) -> Measured:
    """Pulses of the second car that do not drive, and driving ones of the first, once it is killed.
    """
    kill_driver, guard = drive_with_guard(bench)
    other, _ = drive_with_guard(bench)
    at = kill_driver.now
    guard.kill_driver()
    kill_driver.backend.clock.sleep(0.5)
    begin = other.now
    other.run(0.5, forward(0.4, 0.5))
    wrong = sum(not other.wrong(pulse) for pulse in other.pulses if pulse[0] > begin)
    return Measured(wrong + (kill_driver.last_wrong(at) > 50.0), f"mode {other.car.mode}")


def raise_in_loop(bench: Bench) -> Measured:
    """Last driving pulse after an exception leaves the ``with`` block of the car."""
    drive = bench.drive()
    try:
        with drive.car:
            drive.driving()
            at = drive.now
            raise ZeroDivisionError
    except ZeroDivisionError:
        go_on(drive)
    return Measured(drive.last_wrong(at))


def go_on(drive: Drive) -> None:
    """The world goes on after the car is closed."""
    end = drive.world.t + 0.5
    while drive.world.t < end:
        drive.world.advance(end)


def hung_up(bench: Bench) -> Measured:
    """Last driving pulse after SIGHUP to this process; without a handler it would end here."""
    before = {n: signal.getsignal(n) for n in (signal.SIGHUP, signal.SIGTERM)}
    try:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
        if "signals" not in list_removed():
            stop_on_signals()
        drive = bench.drive().driving()
        at = drive.now
        if signal.getsignal(signal.SIGHUP) is signal.SIG_DFL:
            return Measured(NEVER, "no handler")
        try:
            with drive.car:
                os.kill(os.getpid(), signal.SIGHUP)
                drive.run(0.5, forward(0.4))
        except SystemExit:
            go_on(drive)
        return Measured(drive.last_wrong(at))
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def remove_port(bench: Bench) -> Measured:
    """Last driving pulse after the thread of the link finds its port gone."""
    drive = bench.drive().driving()
    pump = object.__new__(ThreadPump)
    pump._engine = drive.car._engine
    pump._news = threading.Condition()
    pump._count = pump._delivered = 0
    pump._ended = threading.Event()
    pump._ended.set()
    at = drive.now
    pump._hold(LinkLost("the port vanished"), None)
    drive.backend.clock.sleep(DRIVE_SECONDS)
    return Measured(drive.last_wrong(at), drive.car.mode)


def opened_twice(bench: Bench) -> Measured:
    """Links that open a port in addition to the one that has it."""
    ends = os.openpty()
    try:
        port = os.ttyname(ends[1])
        first = SerialLink(port)
        try:
            SerialLink(port).close()
            return Measured(1, "opened twice")
        except DartHalError as error:
            return Measured(0, type(error).__name__)
        finally:
            first.close()
    finally:
        for end in ends:
            os.close(end)


def owned_twice(bench: Bench) -> Measured:
    """Programs that become the owner of a PCA9685 in addition to the one that drives it."""
    drive = bench.drive()

    def become_owner() -> Backend:
        url = Url.parse(f"serial:///dev/ttyUSB0?i2c=unix:{bench.folder / 'i2c'}")
        backend = Backend(url, drive.backend.link, drive.backend.bus, drive.backend.clock, False)
        guarding.own_actuator(backend, drive.car.files)
        return backend

    first = become_owner()
    try:
        second = become_owner()
    except DartHalError as error:
        return Measured(0, f"{type(error).__name__}: {error.found}")
    finally:
        for closer in first.closers:
            closer()
    for closer in second.closers:
        closer()
    return Measured(1, "two owners")


def virtual(what: str, measure: Callable[[Bench], Measured], limit: float, unit: str,
            *control: str):  # type: ignore[no-untyped-def]
    """A case of the quick run."""
    return case("mock", what, measure, limit, unit, *control, fast=True)


ROWS = (
    Row(5, "cable of the Nano unplugged", "LinkLost, neutral, no busy loop", (
        virtual("port gone", remove_port, PULSE, MS, "lost"),)),
    Row(7, "second process opens the port", "refused, holder's pid named", (
        case("wire", "a pty opened twice", opened_twice, 0, "links", "port_lock", fast=True),)),
    Row(21, "host kill -9 while driving", "the guard writes neutral", (
        virtual("driver gone", kill_driver, 50, MS, "guard"),)),
    Row(22, "SIGSTOP, a pause of the interpreter, swap", "neutral, nothing stale after SIGCONT", (
        virtual("driver stopped for 0.8 s", stop_process, 150, MS, "guard"),)),
    Row(23, "kill -9 of the process group, terminal closed", "the guard survives", (
        virtual("SIGHUP", hung_up, PULSE, MS, "signals"),)),
    Row(24, "guard killed", "the driver disarms", (
        virtual("guard gone", guard_killed, 100, MS, "guard_gate"),)),
    Row(36, "an exception in the user's loop", "neutral on the way out", (
        virtual("ZeroDivisionError", raise_in_loop, PULSE, MS, "close_neutral"),)),
    Row(37, "a listener blocks, then SIGTERM", "neutral, and the program ends", (
        virtual("blocks for 1 s", listener, 150, MS, "guard"),)),
    Row(40, "two drivers, two Nanos, one bus", "the second is refused, the first drives on", (
        virtual("owners of one chip", owned_twice, 0, "programs", "owner"),)),
    Row(44, "two cars on one computer, one driver killed", "the other drives on", (
        virtual("driver gone", neighbour, 0, "pulses", "guard"),)),
)
