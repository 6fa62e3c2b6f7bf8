"""The driver's side of the guard process."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Callable
from typing import IO

from dart_hal.core.errors import BusError
from dart_hal.core.ports import Bus
from dart_hal.core.process.forks import private
from dart_hal.core.process.suspend import elapsed
from dart_hal.core.process.waiting import wait_readable
from dart_hal.devices.actuation.arming import MAX_GUARD_AGE

# s from the start of the guard process until it reports that it is ready.
MAX_START_TIME = 10.0

# Guards that run on without a car; referenced until they have ended, so that none becomes a zombie.
_left: list[subprocess.Popen[bytes]] = []


class Guard:
    """A running guard. ``gate`` goes to the actuator, ``beat`` into the frame step.

    Start it when the actuator is open: it writes counts, which are neutral only at the right
    prescale. It watches from the first beat on. ``opener`` opens the bus in the guard's process,
    where it is found by its name: a function of a module. Raises BusError when the guard cannot
    open the bus.
    """

    def __init__(self, bus: str, opener: Callable[[str], Bus], *, address: int, channel: int,
                 neutral_counts: int, clock: Callable[[], float] = elapsed) -> None:
        command = [sys.executable, "-m", "dart_hal.devices.actuation.guard",
                   f"{opener.__module__}:{opener.__qualname__}", bus, str(address),
                   str(channel), str(neutral_counts)]
        _left[:] = [process for process in _left if process.poll() is None]
        self._clock = clock
        self._heard = -math.inf
        self.tripped = self._watched = False
        self.failed = False
        """Whether the bus has refused a write of the guard since its trip."""
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                         stderr=subprocess.PIPE, start_new_session=True)
        beats, status, _ = self._pipes()
        self._beats = beats.fileno()
        self._status = status.fileno()
        os.set_blocking(self._beats, False)
        os.set_blocking(self._status, False)
        self._wait_ready()

    @property
    def pid(self) -> int:
        """Process id of the guard."""
        return self._process.pid

    @property
    def age(self) -> float | None:
        """Time [s] since the guard's last byte; None = it has ended. ``Facts.guard_age``."""
        self._listen()
        return None if self._process.poll() is not None else self._clock() - self._heard

    def beat(self, *, off: bool = False) -> None:
        """Send a beat, at 50 Hz or more, from the frame step. ``off``: the pulses are off."""
        self._watched = True
        self._send(b"o" if off else b"b")

    def gate(self) -> str | None:
        """Return why no throttle may be written now: GUARD_TRIPPED, GUARD_SILENT, None = it may.

        After SIGCONT the trip is already in the pipe, so an old command is not written. Before the
        first beat the guard does not watch: GUARD_SILENT.
        """
        age = self.age
        if self.tripped:
            return "GUARD_TRIPPED"
        silent = age is None or age > MAX_GUARD_AGE or not self._watched
        return "GUARD_SILENT" if silent else None

    def acknowledge(self) -> None:
        """Acknowledge the trip, with the throttle at neutral; the guard stops writing."""
        self._listen()
        self.tripped = False
        self._send(b"a")

    def close(self) -> None:
        """End the guard without a write: the driver has closed at neutral."""
        self._send(b"q")
        self._process.communicate(timeout=MAX_START_TIME)

    def leave(self) -> None:
        """Let the guard write neutral without the driver, which could not write it on closing.

        Closing the pipe limits the time for which the guard tries. It writes nothing while another
        car owns the chip, in this process too.
        """
        for pipe in self._pipes():
            pipe.close()
        _left.append(self._process)

    def _pipes(self) -> tuple[IO[bytes], IO[bytes], IO[bytes]]:
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        return private(process.stdin), private(process.stdout), private(process.stderr)

    def _wait_ready(self) -> None:
        """Wait for the first byte of the guard. Raises BusError when it does not start."""
        first = os.read(self._status, 1) if wait_readable(self._status, MAX_START_TIME) else b""
        if first != b"r":
            self._process.kill()
            _, error = self._process.communicate(timeout=MAX_START_TIME)
            raise BusError("the guard process does not start",
                           found=error.decode("utf-8", "replace").strip() or "no answer",
                           likely="the bus allows one program only, or has gone",
                           remedy="dart-hal doctor")
        self._heard = self._clock()

    def _listen(self) -> None:
        """Read the bytes that the guard has sent: they prove that it runs; t is a trip."""
        try:
            data = os.read(self._status, 65536)
        except BlockingIOError:
            return
        if data:
            self._heard = self._clock()
            self.tripped = self.tripped or b"t" in data
            self.failed = self.tripped and (self.failed or b"x" in data)

    def _send(self, word: bytes) -> None:
        try:
            os.write(self._beats, word)
        except (BrokenPipeError, BlockingIOError):      # the next ``gate`` finds it by the age
            return
