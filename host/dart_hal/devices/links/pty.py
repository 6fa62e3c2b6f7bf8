"""A Nano on a real pseudo-terminal, in real time, for any serial program.

A thread advances the world with the wall clock and transfers bytes between it and the pty. Opening
the pty resets the Nano, as DTR does on the board.
"""

from __future__ import annotations

import contextlib
import os
import select
import termios
import threading
import time
import tty
from collections.abc import Callable
from types import TracebackType
from typing import Protocol

from dart_hal.devices.links.paced import MAX_WORLD_LAG

# Real time [s] between two accesses to the line.
LINE_INTERVAL = 0.002

# The same while no program has the pty open.
IDLE_INTERVAL = 0.01

# Real time [s] of reset after an open: a serial library discards bytes that arrive during its open.
# The boot loader of a board takes ten times as long.
RESET_HOLD_TIME = 0.05

# Longest step of the world [s]; the hook is called before each step.
MAX_WORLD_STEP = 0.001

_SPEEDS = {getattr(termios, name): int(name[1:]) for name in dir(termios)
           if name[0] == "B" and name[1:].isdigit() and name != "B0"}


class PacedNano(Protocol):
    """Methods of a Nano that `Pty` uses; `EmulatedNano` and a simulated car have them."""

    @property
    def now(self) -> float: ...

    def run(self, until: float) -> bool: ...
    def read(self) -> list[tuple[bytes, float]]: ...
    def write(self, data: bytes) -> None: ...
    def set_baud(self, host_baud: float) -> None: ...
    def reset(self, cause: str = "external") -> None: ...


class Pty:
    """Serve a Nano on a pty; ``path`` is what a serial program opens.

    ``tick(t)`` is called before each step of at most 1 ms, to turn the wheel or move the world.
    ``reset_on_open`` False: opening does not reset the firmware. Time passes only while a program
    has the port open, or with ``always`` at all times, as for a car that rolls. The line rate of
    the program's port becomes that of the host. ``unplug`` and ``plug`` are the USB cable; each
    plugging gives another ``path``. Use as a context manager, or `start` and `close`; `close`
    raises an exception of the thread.
    """

    def __init__(self, nano: PacedNano, tick: Callable[[float], None] | None = None, *,
                 reset_on_open: bool = True, always: bool = False) -> None:
        self.nano = nano
        self._tick = tick
        self._reset_on_open = reset_on_open
        self._always = always or not reset_on_open
        self._master, self.path = _open_pty()
        self._plugged = self._master
        self._spare: tuple[int, str] | None = None
        self._wake_read, self._wake_write = os.pipe()
        self._thread: threading.Thread | None = None
        self._failure: BaseException | None = None
        self._stop = False
        self._speed = 0
        self.opens = 0
        self.is_open = False
        """Whether a program had the port open at the last access."""
        self.dropped = 0

    def __enter__(self) -> Pty:
        self.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    def start(self) -> None:
        """Run the Nano in a thread."""
        self._thread = threading.Thread(target=self._run, name="pty", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the thread and remove the pty; raise the exception that ended the thread, if any."""
        self._stop = True
        with contextlib.suppress(OSError):
            os.write(self._wake_write, b"x")
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        spare = self._spare[0] if self._spare is not None else -1
        for fd in {self._master, self._plugged, spare, self._wake_read, self._wake_write}:
            with contextlib.suppress(OSError):
                os.close(fd)
        self._master = self._plugged = self._wake_read = self._wake_write = -1
        failure = self._failure
        self._failure = None
        if failure is not None:
            raise failure

    def unplug(self) -> None:
        """Unplug the cable: the port vanishes for the program that has it open."""
        if self._spare is None:
            self._spare = _open_pty()  # opened while the old name is still in use
            self._plugged = -1

    def plug(self) -> None:
        """Plug the cable in again; ``path`` changes."""
        if self._spare is not None:
            self._plugged, self.path = self._spare
            self._spare = None

    def _move_cable(self) -> None:
        """Change to the master that is plugged in, and close the former one."""
        if self._plugged != self._master:
            if self._master >= 0:
                os.close(self._master)
            self._master = self._plugged
            self._speed = 0

    @property
    def alive(self) -> bool:
        """Whether the thread runs; `close` raises the exception that has ended it."""
        return self._thread is not None and self._thread.is_alive()

    def _run(self) -> None:
        try:
            self.serve()
        except BaseException as error:  # noqa: BLE001 - handed to close()
            self._failure = error

    def serve(self) -> None:
        """Run the Nano in the calling thread until another one calls `close`."""
        start = time.monotonic() - self.nano.now
        while not self._stop:
            self._move_cable()
            was_open = self.is_open
            is_open = self.is_open = self._slave_open()
            if is_open and not was_open:
                start += self._on_open()
            if not is_open and not self._always:
                self._wait(IDLE_INTERVAL, listen=False)
                start = time.monotonic() - self.nano.now
                continue
            lag = time.monotonic() - start - self.nano.now
            if lag > MAX_WORLD_LAG:
                start += lag
            if is_open:
                self._from_host()
            self._advance(time.monotonic() - start, is_open)
            if self._wait(LINE_INTERVAL, listen=is_open):
                is_open = False  # it was closed, even if it is open again

    def _slave_open(self) -> bool:
        if self._master < 0:
            return False
        poll = select.poll()
        poll.register(self._master, 0)
        return not any(event & select.POLLHUP for _, event in poll.poll(0))

    def _on_open(self) -> float:
        """Reset the Nano for an open; return the real time [s] for which the world stops."""
        self.opens += 1
        with contextlib.suppress(OSError, termios.error):
            termios.tcflush(self._master, termios.TCOFLUSH)
        self._follow_speed()
        if not self._reset_on_open:
            return 0.0
        self.nano.reset("external")
        return RESET_HOLD_TIME

    def _follow_speed(self) -> None:
        with contextlib.suppress(termios.error):
            speed = termios.tcgetattr(self._master)[5]
            if speed != self._speed and speed in _SPEEDS:
                self._speed = speed
                self.nano.set_baud(_SPEEDS[speed])

    def _wait(self, seconds: float, *, listen: bool) -> bool:
        """Sleep until the host sends, at most for ``seconds``; return whether it has hung up."""
        poll = select.poll()
        poll.register(self._wake_read, select.POLLIN)
        if listen:
            poll.register(self._master, select.POLLIN)
        return any(event & select.POLLHUP for _, event in poll.poll(1000 * seconds))

    def _from_host(self) -> None:
        self._follow_speed()
        with contextlib.suppress(BlockingIOError):
            try:
                data = os.read(self._master, 4096)
            except OSError as error:
                if isinstance(error, BlockingIOError):
                    raise
                return  # closed between poll and read
            self.nano.write(data)

    def _advance(self, until: float, is_open: bool) -> None:
        nano = self.nano
        while nano.now < until:
            if self._tick is not None:
                self._tick(nano.now)
            step = min(until, nano.now + MAX_WORLD_STEP)
            while nano.run(step):
                pass
        data = b"".join(chunk for chunk, _ in nano.read())
        if data and is_open:
            self._to_host(data)

    def _to_host(self, data: bytes) -> None:
        """Send bytes; they are lost if the kernel's buffer is full, as on a USB bridge."""
        try:
            sent = os.write(self._master, data)
        except BlockingIOError:
            sent = 0
        self.dropped += len(data) - sent


def _open_pty() -> tuple[int, str]:
    """Open a pty; return its master and the name of its slave."""
    master, slave = os.openpty()
    name = os.ttyname(slave)
    tty.setraw(slave)
    os.close(slave)  # only now does poll() report the missing slave
    os.set_blocking(master, False)
    return master, name
