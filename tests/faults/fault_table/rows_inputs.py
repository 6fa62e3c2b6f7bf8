"""Rows of human inputs: the device falls silent, and the program still reads its last value."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from unittest.mock import patch

from dart_hal.cli import drive as verb
from dart_hal.control.gamepad import EVENT, FULL_SCALE, Gamepad, GamepadLayout, Manual
from dart_hal.control.keyboard import Keyboard
from dart_hal.core.types import State
from dart_lab.live.ros.bridge import Bridge
from dart_lab.live.view import messages
from dart_lab.live.view.access import Access
from dart_lab.live.view.desk import Desk
from dart_lab.live.view.operator import Refused
from fault_table.bench import Bench
from fault_table.drive import Drive, forward
from fault_table.row import Measured, Row, case
from fault_table.rows_pins import MS

DRIVES_S = 0.6
"""Time of driving before the device falls silent."""
SILENT_S = 2.5
"""Time that is watched after it."""
STICK_FORWARD_US = 1800.0
"""Pulse of a throttle stick."""
BUMPER = EVENT.pack(0, 1, 0x01, GamepadLayout().dead_man)
STICK = EVENT.pack(0, -FULL_SCALE, 0x02, GamepadLayout().forward.number)
JITTER = EVENT.pack(0, -FULL_SCALE + 200, 0x02, GamepadLayout().forward.number)
Feed = Callable[[float], bytes]
"""What the device writes at a time [s] since the car was armed."""


def measure_end(drive: Drive, t_fault: float) -> Measured:
    """ms from ``at`` to the end of the last driving pulse; the car must have driven before."""
    assert any(drive.wrong(pulse) for pulse in drive.pulses if t_fault
               - 0.1 < pulse[1] < t_fault), (
        f"it did not drive: {drive.car.mode} {drive.car.causes}")
    return Measured(drive.last_wrong(t_fault), f"then {drive.car.mode}")


def by_hand(drive: Drive, source: Manual, write: Callable[[bytes], object], feed: Feed) -> float:
    """Drive by ``source`` as the verb does while ``feed`` writes; the time of the last report."""
    drive.arm()
    start = drive.now
    reports = [drive.now]

    def each(state: State) -> None:
        data = feed(drive.now - start)
        if data:
            reports.append(drive.now)
            write(data)

    drive.car.on_state(each)
    with patch.object(verb, "limit_to_real_time", iter), patch.object(verb.console, "print"):
        verb.run_manual(drive.car, source, 0.4, DRIVES_S + SILENT_S)
    return next(t for t in reversed(reports) if t - start < DRIVES_S + 0.02)


def ticks(t: float, period: float) -> bool:
    """Whether a periodic report is due at a State at ``t`` [s]."""
    return t % period < 0.0101


@contextmanager
def gamepad(bench: Bench, drive: Drive) -> Iterator[tuple[Gamepad, Callable[[bytes], object]]]:
    """A gamepad over a named pipe, and what writes to it."""
    path = bench.folder / "js0"
    os.mkfifo(path)
    pad = Gamepad(str(path), clock=lambda: drive.now)
    writer = os.open(path, os.O_WRONLY)
    try:
        yield pad, lambda data: os.write(writer, data)
    finally:
        pad.close()
        os.close(writer)


def silent_gamepad(first: bytes, second: bytes) -> Callable[[Bench], Measured]:
    """Bumper and stick in this order, a hand that jitters, then no event."""
    def feed(t: float) -> bytes:
        if t < 0.1:
            return b""
        if t < 0.2:
            return first if ticks(t, 0.1) else b""
        if t < DRIVES_S:
            return second + JITTER + STICK if ticks(t, 0.1) else b""
        return b""

    def measure(bench: Bench) -> Measured:
        drive = bench.drive()
        with gamepad(bench, drive) as (pad, write):
            return measure_end(drive, by_hand(drive, pad, write, feed))
    return measure


def silent_keyboard(backlog: bool) -> Callable[[Bench], Measured]:
    """A held key whose repeats end; ``backlog``: they all come at once 1.5 s later, and go on."""
    resumes = DRIVES_S + 1.5

    def feed(t: float) -> bytes:
        if t < DRIVES_S:
            return b"w" if ticks(t, 0.03) else b""
        if not backlog or t < resumes:
            return b""
        return b"w" * 50 if t < resumes + 0.011 else b"w" if ticks(t, 0.03) else b""

    def measure(bench: Bench) -> Measured:
        drive = bench.drive()
        with ExitStack() as stack:
            master, slave = os.openpty()
            stack.callback(os.close, master)
            stdin = stack.enter_context(os.fdopen(slave))
            stack.enter_context(patch("sys.stdin", stdin))
            keyboard = Keyboard(clock=lambda: drive.now)
            stack.callback(keyboard.close)
            t_fault = by_hand(drive, keyboard, lambda data: os.write(master, data), feed)
            return measure_end(drive, t_fault)
    return measure


def page(hold: Callable[[float], messages.DriveRequest | None]) -> Callable[[Bench], Measured]:
    """A live page that sends ``hold(s since the last report of the hand)`` after DRIVES_S."""
    def measure(bench: Bench) -> Measured:
        drive = bench.drive()
        desk = Desk(drive.car, Access(8642, token="right"), drives=True, clock=lambda: drive.now)
        list(desk.open_page("page"))
        drive.arm()
        desk.handle_message("page", messages.Take("right"))
        start = drive.now
        last = drive.now + DRIVES_S

        def each(state: State) -> None:
            age = drive.now - last
            command = messages.DriveRequest(0.0, 1.0, 0.0) if age < 0.0 else hold(age)
            if command is not None:
                command.heard += drive.now - 0.03
                with suppress(Refused):  # a page that does not care goes on
                    desk.handle_message("page", command)

        drive.car.on_state(each)
        desk.run(last - start + SILENT_S)
        desk.close()
        return measure_end(drive, last)
    return measure


def late(age: float) -> messages.DriveRequest:
    """A command that the network has held back since the last report of the hand."""
    return messages.DriveRequest(0.0, 1.0, -age)


class Topics:
    """A middleware without a network: ``publish_to(topic, value)``."""

    is_closed = False

    def __init__(self) -> None:
        self.heard: dict[str, Callable[[float], None]] = {}

    def subscribe(self, topic: str, heard: Callable[[float], None]) -> None:
        self.heard[topic] = heard

    def advertise(self, topic: str, kind: str, is_latched: bool) -> None: ...

    def publish(self, topic: str, message: object) -> None: ...

    def close(self) -> None: ...


def silent_topic(silent: str, resumes: float = SILENT_S) -> Callable[[Bench], Measured]:
    """A publisher of ``silent`` (or all) ends; after ``resumes`` s its messages come again."""
    def measure(bench: Bench) -> Measured:
        drive = bench.drive()
        topics = Topics()
        bridge = Bridge(drive.car, 1, topics, lambda text: None, lambda: drive.now)
        drive.arm()
        start = drive.now
        last = dict.fromkeys(("safety_value", "throttle_1", "all"), drive.now)

        def each(state: State) -> None:
            t = drive.now - start
            if t < 0.1 or not ticks(t, 0.1):
                return
            frozen = DRIVES_S < t < DRIVES_S + resumes
            for topic, value in (("safety_value", 1.0), ("throttle_1", 0.4)):
                if not (frozen and silent in (topic, "all")):
                    topics.heard[topic](value)
                    if t <= DRIVES_S:
                        last[topic] = last["all"] = drive.now

        drive.car.on_state(each)
        bridge.run(iter(()), drive.car.states(duration=DRIVES_S + SILENT_S))
        return measure_end(drive, last[silent])
    return measure


def lose_rc_signal(nano: str) -> Callable[[Bench], Measured]:
    """The driver overrides the program, which requests throttle as well, and the signal ends."""
    def measure(bench: Bench) -> Measured:
        drive = bench.drive("&rc=1", nano=nano).arm()
        drive.world.receiver.pulses_us[1] = STICK_FORWARD_US
        drive.run(0.2, forward(0.0))
        assert drive.wrong(drive.pulses[-1])
        t_fault = drive.fail("rc:off")
        drive.run(0.3, forward(0.4))
        return Measured(drive.last_off(t_fault), ", ".join(drive.car.causes))
    return measure


ROWS = (
    Row(51, "gamepad out of range, bumper and stick held", "neutral after 1 s without an event", (
        case("mock", "bumper, then stick", silent_gamepad(BUMPER, STICK), 1000.0, MS, "input_age",
             fast=True),
        case("mock", "stick, then bumper", silent_gamepad(STICK, BUMPER), 1000.0, MS, "input_age"),
    )),
    Row(52, "keyboard silent, a key held", "neutral after 0.5 s without a key", (
        case("mock", "no repeats", silent_keyboard(False), 500.0, MS, "input_age", fast=True),
        case("mock", "keys come late", silent_keyboard(True), 500.0, MS, "key_backlog"),
    )),
    Row(53, "live page silent, stick held", "neutral; let go and hold again", (
        case("mock", "hand reports nothing", page(
            lambda age: messages.DriveRequest(0.0, 1.0, 0.0, age)), 1000.0, MS, "input_age",
        fast=True),
        case("mock", "tab is frozen", page(lambda age: None), 250.0, MS, "page_hold"),
        case("mock", "commands come late", page(late), 250.0, MS, "page_hold"),
    )),
    Row(54, "ROS publisher silent", "neutral after 0.3 s; 0, then 1 to go on", (
        case("mock", "safety_value", silent_topic("safety_value"), 500.0, MS, "input_age",
             fast=True),
        case("mock", "throttle", silent_topic("throttle_1"), 500.0, MS, "input_age"),
        case("mock", "messages come again", silent_topic("all", resumes=1.0), 500.0, MS,
             "topic_release"),
    )),
    Row(61, "signal of the RC receiver lost, its driver drives", "trip, neutral in 100 ms", (
        case("mock", "transmitter off", lose_rc_signal("mock"), 100.0, MS, "rc_signal", fast=True),
        case("elf", "transmitter off", lose_rc_signal("avr"), 100.0, MS, "rc_signal"),
    )),
)
"""Limits: 1 s where a device reports changes only, 0.5 s where it reports periodically, 0.25 s
where each command carries its age."""
