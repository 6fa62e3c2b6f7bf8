"""Soak: one random fault a second for hours, and a program that drives and arms again.

    python tests/soak/soak.py [--hours 2] [--nano avr|mock] [--cutoff mux] [--seed 1]

Everything runs in virtual time through ``Car``, on a line with bit errors. At
every pulse: none above neutral but by a live command. At the end: frames sent
= received + lost, and nothing has grown: memory, threads, processes,
descriptors. What breaks a law is printed with the URL that repeats it.
"""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random

import dart_lab.sim.world
from dart_hal.car.car import Car
from dart_hal.core.errors import DartHalError, LinkLost, NotArmed
from dart_hal.devices.links.base import open_backend
from dart_hal.wire.codec import UP
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.frame import WireFrame
from dart_hal.wire.ledger import MASK32, T_CK, parse_boot
from dart_hal.wire.messages import HELLO, STATE
from dart_lab.sim.failure_kinds import FAILURE_KINDS
from dart_lab.sim.pwm_output import Pulse
from dart_lab.sim.world import THROTTLE_CHANNEL

CYCLE = 16.0
QUIET_S = 9.0
"""s: eight faults fall into the last 4.4 s of every 8, so that the ESC's 2 s of neutral, half
a second of good checks and a drive fit in between."""
LONGEST = 0.8
"""s that a fault lasts at most."""
BIT_ERROR = 2e-6
"""Of the line upwards: one frame in about 700 is damaged."""
COMMAND_VALID_S = 0.2
"""s that a command holds."""
TOLERANCE_US = 5.0
"""From neutral: a pulse of the other clock, and one count of the PCA9685."""
HOLD = {"oe": 0.140, "mux": 0.140}
"""s from the last live moment to the last pulse above neutral, of all failures at once."""
FINAL = frozenset({("eeprom", "torn")})
"""Not drawn: a torn byte takes the cut-off's setting away for good."""
NOT_BY_MOCK = frozenset(
    {("mcu", "hang"), ("mcu", "freeze"), ("power", "droop"), ("imu", "config"), ("imu", "reset"),
     ("enc", "chatter"), ("enc2", "chatter")})
NEEDS_RESET = frozenset({("mcu", "hang"), ("mcu", "freeze")})
"""After these the Nano comes back by its reset button alone, unless its watchdog may reset."""
GROWTH_KB = 4096
"""kB of resident memory between a quarter of the time and its end: page noise of malloc."""
KEPT = 4000
"""Records of the truth that the world keeps: its usual million would look like growth."""


Reader = Callable[[], list[tuple[bytes, float]]]


@dataclass
class Report:
    """What happened; ``broken``: laws, each with its time [s of the world]."""

    url: str
    seconds: float = 0.0
    wall: float = 0.0
    faults: int = 0
    arms: int = 0
    trips: int = 0
    driven: int = 0
    pulses: int = 0
    sent: int = 0
    received: int = 0
    lost: int = 0
    rebased: int = 0
    unreported: int = 0
    damaged: int = 0
    memory: list[int] = field(default_factory=list)
    handles: list[tuple[int, int, int]] = field(default_factory=list)
    broken: list[tuple[float, str]] = field(default_factory=list)
    now: Callable[[], float] = lambda: 0.0

    def breaks(self, law: str) -> None:
        self.broken.append((self.now(), law))

    def text(self) -> str:
        share = self.wall and self.seconds / self.wall
        lines = [
            f"{self.seconds / 3600:.2f} h simulated in {self.wall / 60:.1f} min "
            f"({share:.1f} times real time)",
            f"{self.faults} faults, {self.arms} times armed, {self.trips} trips, "
            f"{self.driven} frames with throttle, {self.pulses} pulses at the ESC",
            f"frames: {self.sent} numbered = {self.received} received + {self.lost} lost "
            f"+ {self.unreported} around {self.rebased} restarts; {self.damaged} blocks damaged",
            f"memory kB {self.memory}; threads, processes, descriptors {self.handles}",
            *(f"BROKEN at {t:.3f} s: {what}" for t, what in self.broken)]
        return "\n".join(lines)


def plan(seed: int, seconds: float, nano: str) -> list[str]:
    """The faults as ``fail=`` of a simulated car names them."""
    rng = Random(seed)
    kinds = sorted(k for k in FAILURE_KINDS if _can(k, nano))
    faults = []
    for cycle in range(1, int(seconds / CYCLE)):
        begin = cycle * CYCLE
        times = sorted(rng.uniform(begin + QUIET_S, begin + CYCLE - LONGEST)
                       for _ in range(int(CYCLE)))
        for at in times:
            target, kind = rng.choice(kinds)
            faults.append(f"{target}:{kind}@{at:.3f}+{rng.uniform(0.02, LONGEST):.3f}")
            if (target, kind) in NEEDS_RESET:
                faults.append(f"mcu:reset@{begin + CYCLE:.3f}+0.1")
    return faults


def _can(kind: tuple[str, str], nano: str) -> bool:
    """Kinds that a run comes back from, and that this Nano has."""
    lame = nano == "mock" and (kind[0] == "i2c" or kind in NOT_BY_MOCK)
    return kind not in FINAL and not lame


class Account:
    """Every frame on both ends of the line: what the Nano numbered, what the host took.

    ``lost``: numbered between two taken frames of one boot; ``unreported``: around a new
    boot of the Nano, whose HELLO may be lost, and where the host's count restarted.
    """

    def __init__(self, read: Reader, report: Report) -> None:
        self._read, self._report, self._before = read, report, FrameDecoder(UP)
        self._way: deque[tuple[tuple[int, int, bytes], int, bool]] = deque()
        self._seq = -1
        self._t = 0
        self._synced = False
        self._boot: tuple[int, int] | None = None
        self.unreported = 0

    def read(self) -> list[tuple[bytes, float]]:
        """The Nano's bytes, before the line."""
        chunks = self._read()
        for data, _ in chunks:
            for frame in self._before.feed(data):
                restarted = self._seq < 0 or self._boots(frame)
                step = 1 if restarted else (frame.seq - self._seq - 1 & 0xFF) + 1
                self._seq = frame.seq
                self._report.sent += step
                self._way.append((_name(frame), step, restarted))
        return chunks

    def _boots(self, frame: WireFrame) -> bool:
        """The first HELLO of another boot, or STATE: its clock went back."""
        if frame.message is HELLO:
            known = self._boot
            self._boot = parse_boot(frame.payload)
            return known != self._boot
        if frame.message is not STATE:
            return False
        before, (self._t,) = self._t, T_CK.unpack_from(frame.payload)
        return self._t - before & MASK32 > MASK32 // 2

    def attach(self, decoder: FrameDecoder) -> None:
        """Look at what this decoder takes from now on."""
        self._feed = decoder.feed
        self._counters = decoder.counters
        decoder.feed = self.feed  # type: ignore[method-assign]

    def feed(self, data: bytes) -> list[WireFrame]:
        """The host's decoder, behind the line; its account must be this one."""
        gaps = self._counters.gaps
        restarted = self._counters.rebased
        frames = self._feed(data)
        missed, boots = map(sum, zip((0, 0), *map(self._take, frames), strict=True))
        if not self._synced or boots or self._counters.rebased != restarted:
            self.unreported += missed - (self._counters.gaps - gaps)
        elif missed != self._counters.gaps - gaps:
            self._report.breaks(f"{missed} frames lost, {self._counters.gaps - gaps} counted")
        self._synced = self._synced or bool(frames)
        return frames

    def close(self) -> Reader:
        """What is read from now on is not counted."""
        return self._read

    def _take(self, frame: WireFrame) -> tuple[int, int]:
        """Numbers passed over until this frame, which must have been sent, and new boots."""
        passed = boots = 0
        while self._way:
            name, step, restarted = self._way.popleft()
            passed = passed + step
            boots = boots + restarted
            if name == _name(frame):
                return passed - 1, boots
        self._report.breaks(f"accepted and never sent: {frame}")
        return passed, boots

    @property
    def on_its_way(self) -> int:
        """Numbers behind the last frame that was taken."""
        return sum(step for _, step, _ in self._way)


def _name(frame: WireFrame) -> tuple[int, int, bytes]:
    return frame.message.id, frame.seq, frame.payload


class Pins:
    """The law of the ESC's pin, looked at with every pulse."""

    def __init__(self, car: Car, hold: float, report: Report) -> None:
        self._car = car
        self._hold = hold
        self._report = report
        throttle = car.files.config.throttle
        self._neutral = throttle.neutral_us
        self.commanded = -1.0
        self._live = -1.0
        self._mode = car.mode

    def __call__(self, channel: int, pulse: Pulse) -> None:
        if channel != THROTTLE_CHANNEL:
            return
        rise, fall = pulse
        self._report.pulses += 1
        before = self._mode
        self._mode = self._car.mode
        if self._mode == "ARMED":
            self._live = min(rise, self.commanded + COMMAND_VALID_S)
        elif before == "ARMED":
            self._report.trips += 1
        above = (fall - rise) * 1e6 - self._neutral
        if above > TOLERANCE_US and rise > self._live + self._hold:
            self._report.breaks(f"{above:+.0f} us above neutral {rise - self._live:.3f} s after "
                                f"the last live command; {self._mode} {self._car.causes}")


def soak(seconds: float, nano: str = "avr", cutoff: str = "mux", seed: int = 1,
         progress: Callable[[float], None] = lambda share: None,
         until: float | None = None) -> Report:
    """Drive for so long; stops at ``until`` s, or with the first broken law."""
    failures = plan(seed, seconds, nano)
    url = (f"sim://?nano={nano}&seed={seed}&physics=kinematic&tick=10&rc=1&cutoff={cutoff}"
           f"&ber={BIT_ERROR:g}&fail={','.join(failures)}")
    report = Report(url)
    begin = time.monotonic()
    backend = open_backend(url)
    world = backend.link._world  # type: ignore[attr-defined]
    report.now = lambda: world.t
    account = Account(world.nano.read, report)
    world.nano.read = account.read
    with Car.over(backend, raise_on_trip=False) as car:
        decoder = car._engine.receiver._decoder
        opened = replace(decoder.counters)
        account.attach(decoder)
        pins = Pins(car, HOLD[cutoff], report)
        world.watchers.append(pins)
        end = min(seconds, until or seconds)
        marks = [end * k / 4 for k in range(1, 5)]
        while world.t < end and not report.broken:
            _drive_until_it_stops(car, pins, report, min(end, marks[0] if marks else end))
            if marks and world.t >= marks[0] - 0.02:
                marks.pop(0)
                report.memory.append(_memory())
                report.handles.append(_handles())
            progress(world.t / seconds)
        _settle(car)
        world.nano.read = account.close()
        counters = decoder.counters
        report.received = counters.ok - opened.ok
        report.lost = counters.gaps - opened.gaps
        report.unreported = account.unreported + account.on_its_way
        report.rebased = counters.rebased
        report.damaged = counters.damaged
        report.seconds = world.t
    report.faults = sum(float(f.split("@")[1].split("+")[0]) < report.seconds for f in failures)
    report.wall = time.monotonic() - begin
    _judge(report)
    return report


def _drive_until_it_stops(car: Car, pins: Pins, report: Report, end: float) -> None:
    """Arm, drive a weave, until something stops it or the time is over."""
    engine = car._engine
    try:
        if car.mode == "LOCKED":
            car.unlock("soak")
        if car.mode == "DISARMED":
            car.arm(waive=("PWM_CLOCK_UNCALIBRATED", "CALIBRATION_MISSING"))
            report.arms += 1
        for state in car.states(duration=1.0):
            if engine.now >= end:
                return
            if car.mode != "ARMED":
                continue
            pins.commanded = engine.now
            throttle = 0.25 if state.seq % 400 < 300 else 0.0
            car.drive(steering=0.3 if state.seq % 200 < 100 else -0.3, throttle=throttle)
            report.driven += throttle > 0.0
    except NotArmed:
        _settle(car)
    except LinkLost:
        engine.backend.clock.sleep(0.1)


def _settle(car: Car) -> None:
    try:
        for _ in car.states(duration=0.3):
            pass
    except LinkLost:
        car._engine.backend.clock.sleep(0.1)


def _judge(report: Report) -> None:
    """Laws of the end: frames add up, nothing has grown."""
    t = report.seconds
    missing = report.sent - report.received - report.lost - report.unreported
    if missing:
        report.broken.append((t, f"{missing} frames neither received nor lost"))
    if len(report.memory) == 4 and report.memory[3] - report.memory[0] > GROWTH_KB:
        report.broken.append((t, f"memory grows: {report.memory} kB"))
    if len(set(report.handles)) > 1:
        report.broken.append((t, f"threads, processes, descriptors: {report.handles}"))


def _memory() -> int:
    """Resident memory [kB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") // 1024


def _handles() -> tuple[int, int, int]:
    """Threads, child processes, file descriptors."""
    tasks = Path("/proc/self/task")
    children = sum(len((t / "children").read_text(encoding="ascii").split())
                   for t in tasks.iterdir())
    return threading.active_count(), children, len(os.listdir("/proc/self/fd"))


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=2.0, help="simulated (2)")
    parser.add_argument("--nano", choices=("avr", "mock"), default="avr")
    parser.add_argument("--cutoff", choices=sorted(HOLD), default="mux")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--until", type=float, help="s: repeat a finding up to here")
    wish = parser.parse_args(arguments)

    dart_lab.sim.world._MAX_RECORDS = KEPT

    def bar(share: float) -> None:
        full = round(40 * share)
        print(f"\r[{'#' * full}{'.' * (40 - full)}] {share:6.1%}", end="", flush=True)

    report = soak(wish.hours * 3600, wish.nano, wish.cutoff, wish.seed, bar, wish.until)
    print("\n" + report.text())
    if report.broken:
        again = report.broken[0][0] + 1.0
        at = [f for f in report.url.split("fail=")[1].split(",")
              if float(f.split("@")[1].split("+")[0]) < again]
        print(f"to repeat it: python tests/soak/soak.py --hours {wish.hours} --nano {wish.nano} "
              f"--cutoff {wish.cutoff} --seed {wish.seed} --until {again:.1f}\n"
              f"its last faults: {report.url.split('fail=')[0]}fail={','.join(at[-10:])}")
    return 1 if report.broken else 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except DartHalError as error:
        sys.exit(str(error))
