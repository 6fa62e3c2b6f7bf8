"""A process of its own that writes neutral when the driver dies or hangs.

The PCA9685 repeats its last pulse for ever, and no handler runs after kill -9.
This process has its own session (a closed terminal does not reach it), its own
descriptor of the bus, and a pipe from the driver:

    driver -> guard   b beat    o beat, pulses off    a trip seen    q the driver closes, at neutral
    guard -> driver   r ready   b beat         t tripped    x bus error

End of file, another parent than before (a child of the driver may keep the pipe
open), 100 ms without a beat, or a suspend of the computer: the throttle channel
gets neutral, 50 times a second, until the driver has seen the trip or, when it is
gone, for a second.
After 0.2 s of neutral all channels are switched off instead: nobody sees whether
the neutral drives the car. A throttle channel that is off already stays off.
With the driver gone it stands back while somebody else owns the chip. Until then
steering is left where it is. Run as ``python -m dart_hal.devices.actuation.guard``; the driver says
which function opens the bus, since this room does not know the kinds of buses.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable
from pathlib import Path
from pkgutil import resolve_name

from dart_hal.core.errors import BusError
from dart_hal.core.ports import Bus
from dart_hal.core.process.locks import holder
from dart_hal.core.process.suspend import SuspendDetector, elapsed
from dart_hal.core.process.waiting import wait_readable
from dart_hal.core.timing import PWM_FRAME
from dart_hal.devices.actuation.owner import lock_path
from dart_hal.devices.actuation.pca9685 import ALIASES, AUTO_INCREMENT, NEUTRAL_FRAMES
from dart_hal.devices.actuation.servokit import MODE1, SLEEP

SILENCE = 0.100
"""s without a beat that count as a dead driver: two missed of 50 Hz, and margin."""
LAST_WORDS = 50
"""Writes that must succeed after the driver is gone: one second."""
ALL_OFF = bytes([0xFD, 0x10])
"""One write that ends the pulses of all channels."""
GIVE_UP = 30.0
"""s for which a bus that fails is tried after the driver is gone."""


class Watch:
    """The guard's decisions, free of I/O: time and what came are arguments.

    Silence counts from the first beat on; end of file counts always.
    """

    def __init__(self) -> None:
        self.tripped = self.gone = self.done = False
        self.found_off = False
        """The driver had switched the throttle channel off before the trip."""
        self.written = 0
        """Good writes since the trip."""
        self._beat, self._gone_at, self._last_words = math.inf, math.inf, 0

    def heard(self, data: bytes, now: float) -> None:
        """Bytes from the driver; b"" = end of file."""
        if not data:
            self.tripped = self.gone = True
            self._gone_at = now
            return
        self.done = self.done or b"q" in data
        newest = max(data.rfind(b"b"), data.rfind(b"o"))
        if newest >= 0:
            self._beat = now
            self.found_off = data[newest:newest + 1] == b"o"
        if b"a" in data:
            self.tripped, self._beat = False, now
            self.found_off, self.written = False, 0

    def woke(self) -> None:
        """The computer was suspended: whatever the driver asked for is old."""
        self.tripped = self.tripped or self._beat < math.inf

    def due(self, now: float) -> bool:
        """Whether neutral must be written now; a bus that never comes back is given up."""
        self.tripped = self.tripped or now - self._beat > SILENCE
        self.done = self.done or now - self._gone_at > GIVE_UP
        return self.tripped and not self.done

    @property
    def switches_off(self) -> bool:
        """Whether the write that is due ends all pulses; else it is neutral."""
        return self.found_off or self.written >= NEUTRAL_FRAMES

    def wrote(self, ok: bool) -> None:
        """The outcome of a write; with the driver gone, the end comes in sight."""
        self.written += ok
        self._last_words += ok and self.gone
        self.done = self.done or self._last_words >= LAST_WORDS


def watch(bus: Bus, address: int, channel: int, counts: int, *, beats: int, status: int,
          clock: Callable[[], float] = elapsed,
          taken: Callable[[], bool] = lambda: False,
          slept: Callable[[], bool] = lambda: False) -> None:
    """Guard until the driver closes or is gone; file descriptors ``beats``, ``status``.

    ``taken``: whether another than this guard's driver owns the chip by now; ``slept``: whether
    the computer was suspended since the last call.
    """
    neutral = bytes([0x06 + 4 * channel, 0, 0, counts & 0xFF, counts >> 8])
    driver = os.getppid()
    state, told, written = Watch(), False, -1.0
    _say(status, b"r")
    while not state.done:
        ready = wait_readable(None if state.gone else beats, PWM_FRAME / 4)
        now = clock()
        if ready:
            state.heard(os.read(beats, 4096), now)
        elif os.getppid() != driver and not state.gone:
            state.heard(b"", now)
        if slept():
            state.woke()
        if state.due(now):
            if not told or (now - written >= PWM_FRAME and not (state.gone and taken())):
                told, written = True, now
                data = ALL_OFF if state.switches_off else neutral
                state.wrote(_write(bus, address, data, status))
                if state.written == 1:
                    _answer_one_address(bus, address)
                _say(status, b"t")
        else:
            told = False
            if now - written >= PWM_FRAME:
                written = now
                _say(status, b"b")


def _answer_one_address(bus: Bus, address: int) -> None:
    """Clear the bits by which the chip answers further addresses; it is not woken by that."""
    mode1 = bytearray(1)
    try:
        bus.writeto_then_readfrom(address, bytes([MODE1]), mode1)
        if mode1[0] & ALIASES:
            bus.writeto(address, bytes([MODE1, mode1[0] & SLEEP | AUTO_INCREMENT]))
    except OSError:                          # as good as the bus allows; the pulses come first
        return


def _write(bus: Bus, address: int, data: bytes, status: int) -> bool:
    try:
        bus.writeto(address, data)
    except OSError:
        _say(status, b"x")
        return False
    return True


def _say(status: int, word: bytes) -> None:
    """Tell the driver; one that is gone or does not read must not stop the guard."""
    try:
        os.write(status, word)
    except (BrokenPipeError, BlockingIOError):
        return


def main(arguments: list[str]) -> int:
    """``guard MODULE:OPENER BUS ADDRESS CHANNEL COUNTS``: watches standard input."""
    driver = os.getppid()
    opener, spec = arguments[:2]
    address, channel, counts = (int(a, 0) for a in arguments[2:])
    os.set_blocking(1, False)
    open_bus: Callable[[str], Bus] = resolve_name(opener)
    try:
        bus = open_bus(spec)
        bus.writeto_then_readfrom(address, b"\x00", bytearray(1))     # tested before arming
    except BusError as error:
        sys.stderr.write(str(error) + "\n")
        return 1
    _live_longer()
    path = lock_path(spec, address)
    watch(bus, address, channel, counts, beats=0, status=1,
          taken=lambda: _taken(path, driver), slept=SuspendDetector().was_suspended)
    return 0


def _taken(path: Path, driver: int) -> bool:
    """Whether somebody owns the chip: the next program, or the next car of the driver.

    What a dead driver's child still holds does not count.
    """
    pid = holder(path)
    return pid is not None and (pid != driver or os.getppid() == driver)


def _live_longer() -> None:
    """Where the right is given, the kernel takes this process last when memory ends."""
    try:
        with open("/proc/self/oom_score_adj", "w", encoding="ascii") as file:
            file.write("-1000")
    except OSError:
        return


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
