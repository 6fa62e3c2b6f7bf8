"""Driving with the arrow keys of a terminal.

A terminal reports presses, never releases: throttle and steering fall back
towards zero when no key came for a while, so letting go stops the car.
"""

from __future__ import annotations

import os
import sys
import termios
import tty

from dart_hal.errors import UsageError
from dart_hal.process.waiting import wait_readable

KEYS = {b"\x1b[A": "up", b"\x1b[B": "down", b"\x1b[C": "right", b"\x1b[D": "left",
        b"w": "up", b"s": "down", b"d": "right", b"a": "left", b" ": "stop", b"q": "quit",
        b"\x03": "quit", b"\x1b": "quit"}
STEERING_STEP = 0.15
THROTTLE_STEP = 0.05
RELEASE = 50
"""Reads without a key after which the throttle is let go: 0.5 s at 100 Hz, the
usual delay before a terminal repeats a held key."""


class Terminal:
    """The keys of this terminal, read without waiting; restores it on close().

    Raises UsageError where standard input is none.
    """

    def __init__(self) -> None:
        if not sys.stdin.isatty():
            raise UsageError("the keyboard needs a terminal", found="standard input is not one",
                             remedy="dart-hal drive SCRIPT.py")
        self._fd = sys.stdin.fileno()
        self._saved = termios.tcgetattr(self._fd)
        tty.setcbreak(self._fd)

    def keys(self) -> bytes:
        """What was typed since the last call."""
        return os.read(self._fd, 64) if wait_readable(self._fd, 0.0) else b""

    def close(self) -> None:
        termios.tcsetattr(self._fd, termios.TCSADRAIN, self._saved)


class Keyboard(Terminal):
    """Steers and drives by arrow keys or WASD. Raises UsageError."""

    def __init__(self) -> None:
        super().__init__()
        self.steering = 0.0
        self.throttle = 0.0
        self._quiet = 0

    def read(self) -> tuple[float, float, bool]:
        return self.press(self.keys())

    def press(self, keys: bytes) -> tuple[float, float, bool]:
        """Apply the bytes of one read; returns steering, throttle, quit."""
        self._quiet = 0 if keys else self._quiet + 1
        while keys:
            code = next((c for c in KEYS if keys.startswith(c)), None)
            keys = keys[len(code):] if code else keys[1:]
            if code and self._act(KEYS[code]):
                return 0.0, 0.0, True
        if self._quiet > RELEASE:
            self.throttle = 0.0
            self.steering *= 0.95
        return self.steering, self.throttle, False

    def _act(self, name: str) -> bool:
        if name == "quit":
            return True
        if name == "stop":
            self.throttle = self.steering = 0.0
        elif name in ("left", "right"):
            step = STEERING_STEP if name == "left" else -STEERING_STEP
            self.steering = min(1.0, max(-1.0, self.steering + step))
        else:
            step = THROTTLE_STEP if name == "up" else -THROTTLE_STEP
            self.throttle = min(1.0, max(-1.0, self.throttle + step))
        return False
