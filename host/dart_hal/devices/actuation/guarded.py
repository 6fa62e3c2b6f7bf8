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
from dart_hal.devices.actuation.arming import GUARD_ALIVE

START_TIME = 10.0
"""s that the guard may take to say that it is ready."""

_left: list[subprocess.Popen[bytes]] = []
"""Guards that go on by themselves; kept until they have ended, so that none stays a zombie."""


class Guard:
    """A running guard. ``gate`` goes to the actuator, ``beat`` into the frame step.

    Start it when the actuator is open: it writes counts, which mean neutral at
    the right prescale alone. It watches from the first beat on. ``opener`` opens
    the bus in the guard's process, where it is found by its name: a function of a
    module. Raises BusError when the guard cannot reach the bus.
    """

    def __init__(self, bus: str, opener: Callable[[str], Bus], *, address: int, channel: int,
                 neutral_counts: int, clock: Callable[[], float] = elapsed) -> None:
        command = [sys.executable, "-m", "dart_hal.devices.actuation.guard",
                   f"{opener.__module__}:{opener.__qualname__}", bus, str(address),
                   str(channel), str(neutral_counts)]
        _left[:] = [process for process in _left if process.poll() is None]
        self._clock, self._heard = clock, -math.inf
        self.tripped = self._watched = False
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                         stderr=subprocess.PIPE, start_new_session=True)
        beats, status, _ = self._pipes()
        self._beats, self._status = beats.fileno(), status.fileno()
        os.set_blocking(self._beats, False)
        os.set_blocking(self._status, False)
        self._wait_ready()

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def age(self) -> float | None:
        """s since the guard last spoke; None = it is dead. ``Facts.guard_age``."""
        self._listen()
        return None if self._process.poll() is not None else self._clock() - self._heard

    def beat(self, *, off: bool = False) -> None:
        """The driver lives; at 50 Hz or more, from the frame step. ``off``: without pulses."""
        self._watched = True
        self._tell(b"o" if off else b"b")

    def gate(self) -> str | None:
        """Why no throttle may be written now: GUARD_TRIPPED, GUARD_SILENT, None = go on.

        After SIGCONT the trip is in the pipe already, before any stale write.
        Before the first beat nobody watches: GUARD_SILENT.
        """
        age = self.age
        if self.tripped:
            return "GUARD_TRIPPED"
        silent = age is None or age > GUARD_ALIVE or not self._watched
        return "GUARD_SILENT" if silent else None

    def acknowledge(self) -> None:
        """The driver has seen the trip and holds neutral; the guard stops writing."""
        self._listen()
        self.tripped = False
        self._tell(b"a")

    def close(self) -> None:
        """The driver has closed at neutral: the guard ends without a write."""
        self._tell(b"q")
        self._process.communicate(timeout=START_TIME)

    def leave(self) -> None:
        """The driver closes and could not write neutral: the guard goes on trying by itself.

        Its pipe ends here, so that it gives up in the end; and it stands back
        while somebody else owns the chip, this process too.
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
        said = os.read(self._status, 1) if wait_readable(self._status, START_TIME) else b""
        if said != b"r":
            self._process.kill()
            _, error = self._process.communicate(timeout=START_TIME)
            raise BusError("the guard process does not start",
                           found=error.decode("utf-8", "replace").strip() or "no answer",
                           likely="the bus allows one program only, or has gone",
                           remedy="dart-hal doctor")
        self._heard = self._clock()

    def _listen(self) -> None:
        try:
            said = os.read(self._status, 65536)
        except BlockingIOError:
            return
        if said:
            self._heard = self._clock()
            self.tripped = self.tripped or b"t" in said

    def _tell(self, word: bytes) -> None:
        try:
            os.write(self._beats, word)
        except (BrokenPipeError, BlockingIOError):      # seen by age, at the next gate
            return
