"""A gamepad read straight from Linux's joystick device.

Events are 8 bytes, ``struct js_event``: time u32 [ms], value i16, type u8,
number u8 (kernel documentation, input/joydev). No library is needed.
"""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass
from typing import Protocol

from dart_hal.errors import PortMissing

EVENT = struct.Struct("<IhBB")
BUTTON, AXIS, INIT = 0x01, 0x02, 0x80
FULL = 32767
DEAD_ZONE = 0.05
"""Worn sticks rest up to 5 % beside the centre."""


class Manual(Protocol):
    """A source of manual commands."""

    def read(self) -> tuple[float, float, bool]:
        """Steering -1..1 (+1 = left), throttle -1..1, True = stop was asked."""

    def close(self) -> None: ...


@dataclass(frozen=True, slots=True)
class Layout:
    """Which axes and buttons are used; the default fits Xbox-like pads.

    steering: left stick, left/right; throttle: right stick, up/down; dead_man
    must be held (right bumper); stop ends the drive (button B).
    """

    steering: int = 0
    throttle: int = 4
    dead_man: int = 5
    stop: int = 1


class Gamepad:
    """Reads ``/dev/input/js0`` without blocking. Raises PortMissing."""

    def __init__(self, path: str = "/dev/input/js0", layout: Layout | None = None) -> None:
        self._layout = layout or Layout()
        self._axes: dict[int, float] = {}
        self._buttons: dict[int, bool] = {}
        try:
            self._fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        except OSError as error:
            raise PortMissing(f"no gamepad at {path}", found=str(error),
                              likely="not plugged in, or the joydev module is not loaded",
                              remedy="ls /dev/input/js* ; dart-hal drive --keyboard") from error

    def read(self) -> tuple[float, float, bool]:
        try:
            while data := os.read(self._fd, EVENT.size * 64):
                self.feed(data)
        except BlockingIOError:
            pass
        except OSError as error:
            raise PortMissing("the gamepad is gone", found=str(error),
                              likely="pulled out, or its battery is empty",
                              remedy="plug it in again") from error
        layout = self._layout
        held = self._buttons.get(layout.dead_man, False)
        throttle = -self._axes.get(layout.throttle, 0.0) if held else 0.0
        ended = self._buttons.get(layout.stop, False)
        return -self._axes.get(layout.steering, 0.0), throttle, ended

    def feed(self, data: bytes) -> None:
        """Take whole events; the kernel never splits one, so a torn end is dropped."""
        whole = len(data) - len(data) % EVENT.size
        for _, value, kind, number in EVENT.iter_unpack(data[:whole]):
            if kind & ~INIT == AXIS:
                x = max(-1.0, value / FULL)
                self._axes[number] = x if abs(x) > DEAD_ZONE else 0.0
            elif kind & ~INIT == BUTTON:
                self._buttons[number] = bool(value)

    def close(self) -> None:
        os.close(self._fd)
