"""Driving with the arrow keys of a terminal.

A terminal reports presses, never releases. It repeats a held key, so the source reports
periodically: without a key for ``MAX_REPORT_AGE_S`` the throttle is neutral. That silence is the
release.

A connection that was frozen delivers late what was typed meanwhile, in one burst, and then the
repeats of a key that is still held. Keys that come faster than a terminal repeats are therefore
ignored, the throttle is neutral, and nothing drives until no key has come for ``RELEASE_S``.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import suppress

from dart_hal.control.input_age import MAX_READ_GAP_S, MAX_REPORT_AGE_S, InputAge
from dart_hal.core.errors import PortMissing, UsageError
from dart_hal.core.process.suspend import elapsed
from dart_hal.core.process.waiting import wait_readable

with suppress(ImportError):  # absent on Windows
    import termios
    import tty

KEYS = {b"\x1b[A": "up", b"\x1b[B": "down", b"\x1b[C": "right", b"\x1b[D": "left",
        b"w": "up", b"s": "down", b"d": "right", b"a": "left", b" ": "stop", b"q": "quit",
        b"\x03": "quit", b"\x1b": "quit"}
STEERING_STEP = 0.15
THROTTLE_STEP = 0.05
# Keys per second that a terminal may send: it repeats a held key 10 to 60 times a second.
MAX_KEY_RATE = 100.0
# Keys that may come at once beyond that rate: 0.1 s of delay on a connection at usual rates.
MAX_BURST_KEYS = 5.0
# Pause without a key that shows that all keys were released: longer than between two repeats,
# shorter than the 0.2 s or more that a terminal waits before it repeats a key.
RELEASE_S = 0.15
# Factor by which the steering returns at each read without a recent key.
CENTRING = 0.95
RELEASE = "release the keys and press again"


class Terminal:
    """The keys of this terminal, read without waiting; restores it on close().

    Raises UsageError where standard input is none, or on Windows.
    """

    def __init__(self) -> None:
        if not sys.stdin.isatty():
            raise UsageError("the keyboard needs a terminal", found="standard input is not one",
                             remedy="dart-hal drive SCRIPT.py")
        if "termios" not in globals():
            raise UsageError("the keyboard needs a terminal of Linux or macOS", found=sys.platform,
                             remedy="dart-hal drive SCRIPT.py, or drive on the live page")
        self._fd = sys.stdin.fileno()
        self._saved = termios.tcgetattr(self._fd)
        tty.setcbreak(self._fd)

    def keys(self) -> bytes:
        """Bytes typed since the last call. Raises PortMissing when the terminal is gone."""
        if not wait_readable(self._fd, 0.0):
            return b""
        try:
            data = os.read(self._fd, 4096)
        except OSError as error:
            raise _gone(str(error)) from error
        if not data:
            raise _gone("end of input")
        return data

    def close(self) -> None:
        termios.tcsetattr(self._fd, termios.TCSADRAIN, self._saved)


def _gone(found: str) -> PortMissing:
    return PortMissing("the terminal is gone", found=found,
                       likely="its window or its connection was closed",
                       remedy="open a terminal and run the command again")


class Keyboard(Terminal):
    """Steers and drives by arrow keys or WASD; clock [s]: by which keys age. Raises UsageError."""

    def __init__(self, clock: Callable[[], float] = elapsed) -> None:
        super().__init__()
        self.begin(clock)

    def begin(self, clock: Callable[[], float]) -> None:
        """Start at neutral without a key."""
        self.steering = 0.0
        self.throttle = 0.0
        self.notice = ""
        self._clock = clock
        self._age = InputAge(MAX_REPORT_AGE_S)
        self._read_at = clock()
        self._backlog = 0.0
        self._ignores_keys = False

    def read(self) -> tuple[float, float, bool]:
        return self.press(self.keys())

    def press(self, keys: bytes) -> tuple[float, float, bool]:
        """Apply the bytes of one read; returns steering, throttle, quit."""
        now = self._clock()
        pause = now - self._read_at
        self._read_at = now
        names = _names(keys)
        self._backlog = max(0.0, self._backlog - pause * MAX_KEY_RATE) + len(names)
        if self._age.is_over(now):
            self._refuse(f"no key for {MAX_REPORT_AGE_S} s", "press again to drive")
            self.steering *= CENTRING
        if names and now - self._age.reported_at >= RELEASE_S:
            self._ignores_keys = False
            self._backlog = len(names)
        if self._backlog > MAX_BURST_KEYS:
            self._ignores_keys = True
            self._refuse("keys came that were typed earlier", RELEASE)
        elif pause > MAX_READ_GAP_S:
            names = [name for name in names if name in ("stop", "quit")]
            self._refuse(f"the keyboard was not read for {pause:.1f} s", RELEASE)
        for name in names:
            self._age.report(now)
            if name == "quit":
                return 0.0, 0.0, True
            self._act(name)
        return self.steering, self.throttle, False

    def _refuse(self, reason: str, remedy: str) -> None:
        """Set the throttle to neutral and state why."""
        if self.throttle != 0.0 or self._ignores_keys:
            self.notice = f"{reason}: the throttle is neutral; {remedy}"
        self.throttle = 0.0

    def _act(self, name: str) -> None:
        if name == "stop":
            self.throttle = self.steering = 0.0
        elif name in ("left", "right"):
            step = STEERING_STEP if name == "left" else -STEERING_STEP
            self.steering = min(1.0, max(-1.0, self.steering + step))
        elif not self._ignores_keys:
            step = THROTTLE_STEP if name == "up" else -THROTTLE_STEP
            self.throttle = min(1.0, max(-1.0, self.throttle + step))
            self.notice = ""


def _names(keys: bytes) -> list[str]:
    """The known keys in the bytes of one read."""
    names = []
    while keys:
        code = next((c for c in KEYS if keys.startswith(c)), None)
        keys = keys[len(code):] if code else keys[1:]
        if code:
            names.append(KEYS[code])
    return names
