"""Rows of a neutral that drives: judged by the ESC's own neutral, not by the car's files."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from dart_hal.core.config import Calibration, Quantity, save_calibration
from dart_hal.core.errors import NotArmed
from dart_hal.devices.actuation.quantiser import prescale_for
from dart_hal.devices.actuation.standby import Throttle, stop
from dart_lab.sim.esc import Esc, EscMode
from dart_lab.sim.pca9685 import MODE1, PRE_SCALE
from dart_lab.sim.pwm_output import Pulse
from dart_lab.sim.world import World
from fault_table.bench import Bench
from fault_table.drive import WAIVED, Drive, Edit
from fault_table.row import NEVER, Measured, Row, case

MILLISECONDS = "ms"
DRIVES_US = 60.0
"""us from the ESC's neutral: beyond every dead band of the simulated cars."""
OSCILLATOR_EDIT: Edit = (r"oscillator_hz = \{[^}]*\}",
                         "oscillator_hz = { value = 27e6, std = 1000 }")
"""Accepted, and 8 % from the oscillator of car 0: neutral is 1621 us."""
NEUTRAL_EDIT: Edit = (r"neutral_us = 1500.0", "neutral_us = 1600.0")
SWAPPED: tuple[Edit, ...] = ((r"(?<=\[steering\]\n)channel = 0", "channel = 1"),
                             (r"(?<=\[throttle\]\n)channel = 1", "channel = 0"),
                             (r"center_us = [\d.]+", "center_us = 1620.0"))


class ArmedEsc(Esc):
    """An ESC that an earlier program has armed, and that obeys again after a loss of the signal."""

    def pulse(self, pulse: Pulse) -> None:
        if self.mode is EscMode.UNARMED:
            self.mode = EscMode.READY
        super().pulse(pulse)


def arm_esc(world: World) -> None:
    world.esc = ArmedEsc(world.car.esc)


def driving(drive: Drive) -> list[Pulse]:
    """Pulses at the ESC that drive it, either way."""
    neutral = drive.world.car.esc.neutral_us
    return [(rise, fall) for rise, fall in drive.pulses
            if abs(1e6 * (fall - rise) - neutral) > DRIVES_US]


def open_idle(options: str, *edits: Edit, fail: str = "") -> Callable[[Bench], Measured]:
    """ms from the first driving pulse to the last one of a car that is opened and left alone."""
    def measure(bench: Bench) -> Measured:
        drive = bench.drive(options, edits=edits, prepare=arm_esc)
        if fail:
            drive.fail(fail)
        drive.run(4.0)
        pulses = driving(drive)
        if not pulses:
            return Measured(0.0, "no pulse drives")
        lasted = 1e3 * (pulses[-1][1] - pulses[0][0])
        rolled = abs(drive.world.truth(pulses[-1][1]).distance)
        ends = drive.now - pulses[-1][1] > 0.5
        return Measured(lasted if ends else NEVER,
                        f"{1e3 * rolled:.0f} mm, {', '.join(drive.car.causes)}")
    return measure


def steer_alone(bench: Bench) -> Measured:
    """The same of an armed car whose ESC is on the steering's channel; it only steers."""
    drive = bench.drive(edits=(*SWAPPED[:2], (r"center_us = [\d.]+", "center_us = 1500.0")),
                        prepare=arm_esc).arm()
    at = drive.now
    drive.run(2.0, lambda car, state: car.drive(steering=0.3, throttle=0.0))
    pulses = [pulse for pulse in driving(drive) if pulse[0] > at]
    ends = pulses and drive.now - pulses[-1][1] > 0.5
    return Measured(1e3 * (pulses[-1][1] - pulses[0][0]) if ends else NEVER,
                    ", ".join(drive.car.causes))


def before_states(bench: Bench) -> Measured:
    """Driving pulses until the Nano, which boots for 1.3 s, has sent something."""
    drive = bench.drive("&boot=old", edits=(OSCILLATOR_EDIT,), prepare=arm_esc)
    return Measured(len(driving(drive)), f"{len(drive.pulses)} pulses in {drive.now:.1f} s")


def left_by_close(bench: Bench) -> Measured:
    """Pulses at the ESC later than 0.1 s after a program closed its car."""
    drive = bench.drive().arm()
    drive.car.close()
    at = drive.now
    drive.backend.clock.sleep(1.0)
    return Measured(sum(rise > at + 0.1 for rise, _ in drive.pulses))


def left_by_stop(bench: Bench) -> Measured:
    """The same after ``dart-hal stop`` to a car whose program and guard are gone."""
    drive = bench.drive().driving()
    assert drive.backend.bus is not None
    sleep = drive.backend.clock.sleep
    done = stop(Throttle(drive.car.files, drive.backend.bus, sleep), lambda: None, sleep)
    at = drive.now
    sleep(1.0)
    return Measured(sum(rise > at + 0.1 for rise, _ in drive.pulses) + (not done.at_rest),
                    f"found {done.found_us:.0f} us")


FOREIGN_WRITE = bytes([0x0A, 0, 0, 0x9A, 0x01])
"""Data for another chip: 2001 us, if the PCA9685 took them for its channel 1."""


def talk_to_others(drive: Drive) -> None:
    """Somebody writes to every other address of the bus."""
    assert drive.backend.bus is not None
    for address in range(0x08, 0x78):
        if address != 0x40:
            with suppress(OSError):
                drive.backend.bus.writeto(address, FOREIGN_WRITE)


def left_answering(mode1: int) -> Callable[[Bench], Measured]:
    """Driving pulses of a car that is opened on a chip in that mode, among data for others."""
    def measure(bench: Bench) -> Measured:
        def prepare(world: World) -> None:
            arm_esc(world)
            counts = prescale_for(50.0, world.car.oscillator_hz)
            for register, value in ((PRE_SCALE, counts), (MODE1, 0x20), (MODE1, mode1)):
                world.pca.write(bytes([register, value]), [0.0, 0.0], 0.0)

        drive = bench.drive(prepare=prepare)
        for _ in range(20):
            drive.run(0.1)
            talk_to_others(drive)
        return Measured(len(driving(drive)), f"MODE1 {drive.world.pca.peek(0):#04x}")
    return measure


def answering_while_driven(bench: Bench) -> Measured:
    """ms until the chip answers its own address alone again, after another program changed that."""
    drive = bench.drive().arm()
    at = drive.now
    drive.backend.bus.writeto(0x40, b"\x00\xa1")  # type: ignore[union-attr]
    while drive.world.pca.peek(0) & 0x0F and drive.now < at + 3.0:
        drive.run(0.02)
    ends = not drive.world.pca.peek(0) & 0x0F
    return Measured(1e3 * (drive.now - at) if ends else NEVER, ", ".join(drive.car.causes))


def other_board(bench: Bench) -> Measured:
    """Cars that arm with a calibration of another Nano: its neutral and its steering map."""
    folder = bench.folder / "sim-0"
    folder.mkdir()
    save_calibration(Calibration(car="sim-0", board="da27ffff").with_quantities(
        {"throttle.neutral_us": Quantity(1590.0, 1.0)}), folder)
    drive = bench.drive()
    drive.run(drive.settling)
    try:
        drive.car.arm(waive=WAIVED)
    except NotArmed as error:
        return Measured("CALIBRATION_OTHER_BOARD" not in error.reasons, ", ".join(error.reasons))
    return Measured(1, drive.car.mode)


ROWS = (
    Row(55, "neutral is none: a wrong number, channels or leads swapped",
        "all pulses end by the wheel speed alone", (
            case("mock", "27 MHz", open_idle("", OSCILLATOR_EDIT), 300.0, MILLISECONDS,
                 "neutral_watch", fast=True),
            case("mock", "27 MHz, oe", open_idle("&cutoff=oe", OSCILLATOR_EDIT), 300.0,
                 MILLISECONDS, "neutral_watch"),
            case("mock", "neutral 1600", open_idle("", NEUTRAL_EDIT), 700.0, MILLISECONDS,
                 "neutral_watch"),
            case("mock", "leads swapped", open_idle("", NEUTRAL_EDIT, fail="esc:wrong"), 700.0,
                 MILLISECONDS,
                 "neutral_watch"),
            case("mock", "channels swapped", open_idle("", *SWAPPED), 300.0, MILLISECONDS,
                 "neutral_watch"),
            case("mock", "channels swapped, armed", steer_alone, 300.0, MILLISECONDS,
                 "neutral_watch",
                 fast=True),
        )),
    Row(56, "nobody sees whether neutral drives the car", "no pulse on any channel", (
        case("mock", "the Nano boots", before_states, 0, "pulses", "blind", fast=True),
        case("mock", "after close()", left_by_close, 0, "pulses", "pulses_end", fast=True),
        case("mock", "after dart-hal stop", left_by_stop, 0, "pulses", "pulses_end"),
    )),
    Row(58, "the PCA9685 is found answering addresses of other chips", "its own address alone", (
        *(case("mock", f"MODE1 {mode1:#04x}", left_answering(mode1), 0, "pulses", "own_address",
               fast=mode1 == 0xA1) for mode1 in (0xA1, 0x28, 0x24, 0x22)),
        case("mock", "changed while armed", answering_while_driven, 1100.0, MILLISECONDS,
             "own_address"),
    )),
    Row(60, "the calibration is that of another Nano", "refused, named", (
        case("mock", "armed", other_board, 0, "cars", "refusals", fast=True),
    )),
)
