"""The guard: a separate process that writes neutral when the driver dies or hangs.

The PCA9685 repeats its last pulse for ever, and no handler runs after kill -9. The guard has its
own session (a closed terminal does not end it), its own descriptor of the bus, and two pipes:

    driver -> guard   b beat    o beat, pulses off    a acknowledge trip    q end, at neutral
    guard -> driver   r ready   b beat                t tripped             x bus error

1. It trips at end of file, at a change of its parent process (a child of the driver may keep the
   pipe open), 100 ms after the last beat, or after a suspend of the computer.
2. It then writes neutral to the throttle channel, 50 times a second, and leaves the steering as
   it is. A throttle channel that is off already stays off.
3. After 0.2 s of neutral it switches all channels off instead, because no sensor shows whether
   the neutral drives the car.
4. It stops when the driver acknowledges the trip, or 1 s after the driver is gone. With the driver
   gone, it writes nothing while another process owns the chip.

Run as ``python -m dart_hal.devices.actuation.guard``. The driver names the function that opens the
bus, since this package does not know the kinds of buses.
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
from dart_hal.devices.actuation.pca9685 import (
    ALIASES,
    AUTO_INCREMENT,
    FINAL_WRITES,
    NEUTRAL_FRAMES,
)
from dart_hal.devices.actuation.servokit import MODE1, SLEEP

# s without a beat after which the driver counts as dead: two missed beats of 50 Hz, and margin.
BEAT_TIMEOUT = 0.100
# One write that ends the pulses of all channels: register ALL_LED_OFF_H, bit FULL_OFF.
ALL_OFF = bytes([0xFD, 0x10])
# s for which writes to a failing bus are repeated after the driver is gone.
MAX_RETRY_TIME = 30.0


class GuardLogic:
    """The guard's decisions, without I/O: time and received bytes are arguments.

    The time-out runs from the first beat on; end of file always counts.
    """

    def __init__(self) -> None:
        self.tripped = self.gone = self.done = False
        self.found_off = False
        """The driver had switched the throttle channel off before the trip."""
        self.written = 0
        """Successful writes since the trip."""
        self._beat = math.inf
        self._gone_at = math.inf
        self._final_writes = 0

    def note_bytes(self, data: bytes, now: float) -> None:
        """Process bytes from the driver; b"" = end of file."""
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

    def note_suspend(self) -> None:
        """Trip after a suspend of the computer, once the driver has sent a beat."""
        self.tripped = self.tripped or self._beat < math.inf

    def due(self, now: float) -> bool:
        """Return whether neutral must be written now: tripped, and not MAX_RETRY_TIME later."""
        self.tripped = self.tripped or now - self._beat > BEAT_TIMEOUT
        self.done = self.done or now - self._gone_at > MAX_RETRY_TIME
        return self.tripped and not self.done

    @property
    def switches_off(self) -> bool:
        """Whether the write that is due ends all pulses; otherwise it is neutral."""
        return self.found_off or self.written >= NEUTRAL_FRAMES

    def note_write(self, ok: bool) -> None:
        """Count a successful write; with the driver gone, FINAL_WRITES of them are the end."""
        self.written += ok
        self._final_writes += ok and self.gone
        self.done = self.done or self._final_writes >= FINAL_WRITES


def watch(bus: Bus, address: int, channel: int, counts: int, *, beats: int, status: int,
          clock: Callable[[], float] = elapsed,
          is_chip_owned: Callable[[], bool] = lambda: False,
          was_suspended: Callable[[], bool] = lambda: False) -> None:
    """Guard until the driver closes or is gone.

    channel, counts: of the throttle at neutral; ``beats``, ``status``: file descriptors of the
    pipes from and to the driver; ``is_chip_owned``: whether another process than this guard's
    driver owns the chip; ``was_suspended``: whether the computer was suspended since the last call.
    """
    neutral = bytes([0x06 + 4 * channel, 0, 0, counts & 0xFF, counts >> 8])
    driver = os.getppid()
    state = GuardLogic()
    reported = False
    written = -1.0
    _send_status(status, b"r")
    while not state.done:
        # Wait for bytes of the driver for at most a quarter of a PWM frame.
        ready = wait_readable(None if state.gone else beats, PWM_FRAME / 4)
        now = clock()
        if ready:
            state.note_bytes(os.read(beats, 4096), now)
        elif os.getppid() != driver and not state.gone:
            state.note_bytes(b"", now)
        if was_suspended():
            state.note_suspend()
        if state.due(now):
            # The first write is immediate, the others follow once per PWM frame.
            if not reported or (now - written >= PWM_FRAME
                                and not (state.gone and is_chip_owned())):
                reported = True
                written = now
                data = ALL_OFF if state.switches_off else neutral
                state.note_write(_write(bus, address, data, status))
                if state.written == 1:
                    _answer_one_address(bus, address)
                _send_status(status, b"t")
        else:
            reported = False
            if now - written >= PWM_FRAME:
                written = now
                _send_status(status, b"b")


def _answer_one_address(bus: Bus, address: int) -> None:
    """Clear the bits by which the chip answers further addresses, without waking it."""
    mode1 = bytearray(1)
    try:
        bus.writeto_then_readfrom(address, bytes([MODE1]), mode1)
        if mode1[0] & ALIASES:
            bus.writeto(address, bytes([MODE1, mode1[0] & SLEEP | AUTO_INCREMENT]))
    except OSError:                          # the write of the pulses must not depend on this one
        return


def _write(bus: Bus, address: int, data: bytes, status: int) -> bool:
    """Write to the chip; return whether the bus took it, and report an error to the driver."""
    try:
        bus.writeto(address, data)
    except OSError:
        _send_status(status, b"x")
        return False
    return True


def _send_status(status: int, word: bytes) -> None:
    """Send one byte to the driver; a driver that is gone or does not read is no error."""
    try:
        os.write(status, word)
    except (BrokenPipeError, BlockingIOError):
        return


def main(arguments: list[str]) -> int:
    """Run ``guard MODULE:OPENER BUS ADDRESS CHANNEL COUNTS``: the driver is on standard input."""
    driver = os.getppid()
    opener, spec = arguments[:2]
    address, channel, counts = (int(a, 0) for a in arguments[2:])
    os.set_blocking(1, False)
    open_bus: Callable[[str], Bus] = resolve_name(opener)
    try:
        bus = open_bus(spec)
        bus.writeto_then_readfrom(address, b"\x00", bytearray(1))     # test before arming
    except BusError as error:
        sys.stderr.write(str(error) + "\n")
        return 1
    _lower_oom_score()
    path = lock_path(spec, address)
    watch(bus, address, channel, counts, beats=0, status=1,
          is_chip_owned=lambda: _is_chip_owned(path, driver),
          was_suspended=SuspendDetector().was_suspended)
    return 0


def _is_chip_owned(path: Path, driver: int) -> bool:
    """Return whether another program, or a later car of the driver, owns the chip.

    A lock that a child of the dead driver still holds does not count.
    """
    pid = holder(path)
    return pid is not None and (pid != driver or os.getppid() == driver)


def _lower_oom_score() -> None:
    """Make the kernel end this process last when memory runs out, where that is permitted."""
    try:
        with open("/proc/self/oom_score_adj", "w", encoding="ascii") as file:
            file.write("-1000")
    except OSError:
        return


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
