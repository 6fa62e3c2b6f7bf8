"""The layers of the host and of the world, each with the line that removes it."""

from __future__ import annotations

import math
import subprocess
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from weakref import WeakKeyDictionary

import serial

from dart_hal.car.cutoff_test import CutoffTest
from dart_hal.car.driver import Driver
from dart_hal.car.pump import ThreadPump
from dart_hal.devices.actuation import limits
from dart_hal.devices.actuation.pca9685 import Pca9685
from dart_hal.devices.actuation.servokit import Shield, load_servokit
from dart_hal.estimation.bounds import ThrottleMargin
from dart_hal.estimation.frames import FrameReader
from dart_hal.estimation.imu_checks import ImuCheck
from dart_hal.estimation.single_samples import AcceptedSample, SingleSampleFilter
from dart_hal.fleet.peers import Order, Sender
from dart_hal.fleet.stopping import StopCall, StopRule
from dart_hal.wire.blocks import BlockReader
from dart_hal.wire.frame import WireFrame
from fault_table.layers import FOREVER, host


def nothing(*_: Any, **__: Any) -> None:
    """Replaces a function of a layer."""


_ADVANCE = FrameReader._advance
_READ = BlockReader.read
_CAUSES = Driver._causes
_LEFT: WeakKeyDictionary[BlockReader, int] = WeakKeyDictionary()


class NoGuard:
    """Looks like a guard that is well, and is not there."""

    age = 0.0
    tripped = writes = False

    def __init__(self, *_: Any) -> None:
        self.ready = self.beat = self.close = nothing


class EqualsAll:
    """A checksum that every frame carries."""

    def __eq__(self, other: object) -> bool:
        return True

    __hash__ = None  # type: ignore[assignment]


def eternal(steering: float, throttle: float, valid_for: float, source: str,
            now: float, reasons: tuple[str, ...] = ()) -> limits.SourceCommand:
    """A command that never runs out."""
    command = limits.parse_command(steering, throttle, valid_for, source, now)
    return limits.SourceCommand(command.steering, command.throttle, math.inf, source,
                                reasons=reasons)


def in_our_session(*words: Any, **options: Any) -> subprocess.Popen[bytes]:
    """A child that dies with the process group."""
    return subprocess.Popen(*words, **{**options, "start_new_session": False})


def clumsy(reader: BlockReader, block: bytes, end: int, frames: list[WireFrame]) -> None:
    """After a damaged block the next two are lost as well."""
    if left := _LEFT.get(reader, 0):
        _LEFT[reader] = left - 1
        return
    known = len(frames)
    _READ(reader, block, end, frames)
    if len(frames) == known:
        _LEFT[reader] = 2


def unaware(reader: FrameReader, t_raw: int, t_arrival: float, count: int) -> bool:
    """The device clock goes on with any reading."""
    _ADVANCE(reader, t_raw, t_arrival, count)
    return False


def trusting(check: ImuCheck, now: float, t_imu: float, gyro: Any, acc: Any, *_: Any) -> bool:
    """All samples that the Nano marks valid are good."""
    check.trusted, check.doubts = gyro is not None, frozenset()
    return check.trusted


class Unfiltered(SingleSampleFilter):
    """Accepts every sample and states no residual."""

    def add(self, t: float, value: float, stamp: float) -> AcceptedSample:
        return AcceptedSample(value, stamp)


def as_adafruit(pca: Pca9685, neutral: tuple[int, int]) -> None:
    """The constructor of ServoKit, which wakes with the contents of the registers."""
    shield = Shield(pca._bus, pca.address, False, pca._sleep)
    load_servokit()(channels=16, i2c=shield, address=pca.address)


class SharedPort(serial.Serial):
    """A port that other programs may open as well."""

    @property
    def exclusive(self) -> bool:
        return False

    @exclusive.setter
    def exclusive(self, exclusively: bool) -> None: ...


def endless(*request: Any) -> limits.RawPulses:
    """Pulses that never run out."""
    return replace(limits.parse_raw_pulses(*request), until=math.inf)


def accept_any_answer(test: CutoffTest, came: bool, now: float) -> None:
    """The cut-off passes its test with any answer."""
    test._requested_at = None
    test.outcome = "passed"
    test.done = True


def deaf(driver: Driver, now: float) -> list[str]:
    """A link that is silent is no cause."""
    return [name for name in _CAUSES(driver, now) if name != "LINK_STALE"]


def ignore_silence(rule: StopRule, now: float) -> str:
    """A silence is never too long."""
    return "stopped" if now < rule._until else ""


def believing(peers: Any, sender: Sender, heard: Any, arrived: float) -> None:
    """A sender is alive, also with repeated frames."""
    sender.proof = arrived


def forgetful(sender: Sender, seq: int) -> Order:
    """Each number is the newest."""
    sender.newest = seq
    return Order.NEWEST


def by_name(call: StopCall) -> set[str]:
    """Whose name has not answered."""
    return {s.name for s in call.cars} - {s.name for s in call._answers}


def for_ever(pump: ThreadPump) -> None:
    """End the thread, however long it takes."""
    pump._ended.set()
    pump._thread.join()


def leave_pulses(driver: Driver, now: float) -> None:
    """Close without a write to the pins."""
    driver.end_pulses = nothing  # type: ignore[method-assign]


def always(value: Any) -> Callable[..., Any]:
    """A function that answers the same to everything."""
    return lambda *_, **__: value


host("crc", "the checksum of a frame", "dart_hal.wire.blocks.crc_hqx", always(EqualsAll()))
host("delimiter", "after damage the next delimiter begins anew",
     "dart_hal.wire.blocks.BlockReader.read", clumsy)
host("frame_gates", "a STATE must also be possible", "dart_hal.wire.decoder.Gates.passes",
     always(True))
host("ledger", "sequence numbers tell what was lost",
     "dart_hal.wire.decoder.SequenceTracker.add_frame", nothing)
host("unwrap", "counters that wrap run on", "dart_hal.estimation.frames.WRAP", 1 << 40)
host("raw_hold", "pulses of a calibration run out",
     "dart_hal.devices.actuation.chain.parse_raw_pulses", endless)
host("cutoff_test", "a cut-off that does not cut is found at arm()",
     "dart_hal.car.cutoff_test.CutoffTest._judge", accept_any_answer)
host("cut_off", "a Nano that cuts while the host drives is noticed",
     "dart_hal.car.driver.Driver._cut_off", always(False))
host("expiry", "a command runs out", "dart_hal.devices.actuation.chain.parse_command", eternal)
host("link_stale", "80 ms without a frame trip", "dart_hal.car.driver.Driver._causes", deaf)
host("reboot_disarm", "another boot of the Nano disarms", "dart_hal.car.driver.Driver.on_boot",
     nothing)
host("suspend", "a suspend of the computer is noticed",
     "dart_hal.core.process.suspend.SuspendDetector.was_suspended", always(False))
host("own_address", "the PCA9685 answers no address of another chip",
     "dart_hal.devices.actuation.pca9685.ALIASES", 0)
host("neutral_watch", "a car that speeds up at neutral gets no pulse",
     "dart_hal.devices.actuation.neutral_watch.NeutralWatch.update", always(False))
host("blind", "no pulse while no State shows what neutral does",
     "dart_hal.car.facts.Observer.blind", always(False))
host("pulses_end", "whoever stops watching leaves no pulse on any channel",
     "dart_hal.devices.actuation.pca9685.Pca9685.all_off", nothing)
host("guard", "a process that outlives the driver", "dart_hal.car.driver.GuardPost", NoGuard)
host("cutoff", "the Nano's hardware cut-off (without: it welds once tested)",
     "fault_table.drive.CUTOFF_HOLDS", False)
host("read_back", "MODE1 and PRE_SCALE are read back",
     "dart_hal.devices.actuation.chain.Actuator._read_back", always(True))
host("bad_command", "a command that is no number trips",
     "dart_hal.devices.actuation.chain.Actuator.refuse", nothing)

host("rebase", "counts are re-based when the Nano's clock begins anew",
     "dart_hal.estimation.frames.FrameReader._advance", unaware)
host("guard_session", "the guard lives in a session of its own",
     "dart_hal.devices.actuation.guarded.subprocess",
     SimpleNamespace(Popen=in_our_session, PIPE=subprocess.PIPE,
                     DEVNULL=subprocess.DEVNULL, TimeoutExpired=subprocess.TimeoutExpired))
host("guard_gate", "a throttle is written only while the guard speaks",
     "dart_hal.devices.actuation.guarded.Guard.gate", nothing)
host("signals", "SIGTERM and SIGHUP end through the with block",
     "dart_hal.car.car.stop_on_signals", nothing)
host("close_neutral", "closing writes neutral, then no pulse",
     "dart_hal.car.driver.Driver.close", leave_pulses)
host("imu_check", "a sample of the IMU must be possible",
     "dart_hal.car.telemetry.ImuCheck.judge", trusting)
host("single_samples", "a single wrong sample of the IMU is left out, and covered",
     "dart_hal.car.telemetry.SingleSampleFilter", Unfiltered)
host("encoder_check", "the encoder is held against model and accelerometer",
     "dart_hal.car.telemetry.EncoderCheck.judge", nothing)
host("margins", "a weak or loaded car is no dead encoder",
     "dart_hal.estimation.bounds.UNIDENTIFIED_MARGIN", ThrottleMargin(-0.3, 0.3, -0.3))
host("edge_gate", "edges that no wheel makes are dropped",
     "dart_hal.estimation.speed.MAX_ACCELERATION", FOREVER)
host("ring_table", "uneven marks are learnt", "fault_table.rows_sensors.learnt", nothing)
host("refusals", "a car that is not fit does not arm", "dart_hal.car.driver.refusals", always(()))
host("signature", "who answers at 0x40 is read before any write",
     "dart_hal.devices.actuation.pca9685.Pca9685._recognise", nothing)
host("open_neutral", "neutral stands in the registers before the chip wakes",
     "dart_hal.devices.actuation.pca9685.Pca9685.open", as_adafruit)
host("owner", "one owner of a PCA9685", "dart_hal.car.guarding.lock_chip", always(nothing))
host("port_lock", "one program on a port",
     "dart_hal.devices.links.serial_port.serial.Serial", SharedPort)
host("search", "a board that comes back is searched by its number",
     "dart_hal.car.reconnect.BoardSearch.look", always(None))
host("lost", "a link that is gone means neutral at once", "dart_hal.car.driver.Driver.lost",
     nothing)
host("hold_pace", "without a link neutral is repeated at 50 Hz, not in a busy loop",
     "dart_hal.car.pump.REFRESH_INTERVAL", 0.0)
host("stop_patience", "closing does not wait for a listener that blocks",
     "dart_hal.car.pump.ThreadPump.stop", for_ever)
host("run_stop", "a stop of all cars of a room trips",
     "dart_hal.car.driver.Driver.set_run_stop", nothing)
host("beat_within", "a car drives only while its room is watched",
     "dart_hal.fleet.stopping.StopRule.drive_block", ignore_silence)
host("echo", "a beat counts from the car's own message that its sender repeats",
     "dart_hal.fleet.peers.Peers._prove", believing)
host("replay_window", "a message is taken once", "dart_hal.fleet.peers.Sender.classify", forgetful)
host("room_key", "a message must be signed with the key of the room",
     "dart_hal.fleet.key.RoomKey.verify", always(True))
host("stop_answers", "each session of a name has to answer a stop",
     "dart_hal.fleet.stopping.StopCall.silent", property(by_name))
host("input_age", "a human input whose source is silent is neutral",
     "dart_hal.control.input_age.InputAge.is_over", always(False))
host("rc_signal", "a driver whose RC signal is lost trips",
     "dart_hal.car.rc.RcOverride.has_signal", always(True))
host("key_backlog", "keys that were typed earlier do not drive",
     "dart_hal.control.keyboard.MAX_BURST_KEYS", FOREVER)
host("page_hold", "a command of a live page holds 0.2 s, its age taken off",
     "dart_lab.live.view.operator.MAX_COMMAND_AGE_S", FOREVER)
host("topic_release", "ROS drives again after a silence only when safety_value was 0",
     "dart_lab.live.ros.commands.Commands._refuse", nothing)
