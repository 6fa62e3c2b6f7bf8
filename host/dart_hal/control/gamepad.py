"""A gamepad: its events, and when its throttle is refused.

Events are read straight from Linux's joystick device. They are 8 bytes, ``struct js_event``:
time u32 [ms], value i16, type u8, number u8 (kernel documentation, input/joydev). No library is
needed. ``sdl_gamepad`` gets its events from SDL and writes them in the same form.

The device reports changes only. A pad whose radio link is lost looks like a stick that is held
perfectly still, so a throttle without any event for ``MAX_UNCHANGED_S`` is refused: neutral until
the dead-man button was released and pressed again. An event of any axis or button counts, because
it proves that the pad is alive and would have reported a change of the throttle. The state that
the kernel reports by itself when the device is opened (the INIT bit) is no event of the pad.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

from dart_hal.control.input_age import MAX_READ_GAP_S, MAX_UNCHANGED_S, InputAge
from dart_hal.core.errors import PortMissing
from dart_hal.core.process.suspend import elapsed

# time, value, type, number of an event; types, and the value of a full deflection.
EVENT = struct.Struct("<IhBB")
BUTTON = 0x01
AXIS = 0x02
INIT = 0x80
FULL_SCALE = 32767
JOYSTICK = "/dev/input/js0"
# Worn sticks rest up to 5 % off the centre.
DEAD_ZONE = 0.05
PRESS_AGAIN = "release the right bumper and press it again"


class Manual(Protocol):
    """A source of manual commands."""

    @property
    def notice(self) -> str:
        """Why the throttle is neutral although the control is pressed, and the remedy; or ""."""

    def read(self) -> tuple[float, float, bool]:
        """Steering -1..1 (+1 = left), throttle -1..1, True = stop was requested."""

    def close(self) -> None: ...


@dataclass(frozen=True, slots=True)
class AxisTravel:
    """One direction of an axis: its number, and its values at rest and at the end, -1..1."""

    number: int
    rest: float
    end: float

    def deflection(self, value: float) -> float:
        """Return 0 at rest and 1 at the end, negative in the opposite direction."""
        share = (value - self.rest) / (self.end - self.rest)
        return share if abs(share) > DEAD_ZONE else 0.0


@dataclass(frozen=True, slots=True)
class GamepadLayout:
    """Which axes and buttons are used; the default fits Xbox-like pads.

    left: left stick; forward, backward: right stick up and down, or two triggers; dead_man must be
    held (right bumper); stop ends the drive (button B).
    """

    left: AxisTravel = AxisTravel(0, 0.0, -1.0)
    forward: AxisTravel = AxisTravel(4, 0.0, -1.0)
    backward: AxisTravel = AxisTravel(4, 0.0, 1.0)
    dead_man: int = 5
    stop: int = 1


def open_joystick(path: str) -> int:
    """Open a joystick device without blocking; returns its descriptor. Raises PortMissing."""
    try:
        return os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except OSError as error:
        raise PortMissing(f"no gamepad at {path}", found=str(error),
                          likely="not plugged in, or the joydev module is not loaded",
                          remedy="ls /dev/input/js* ; dart-hal drive --keyboard") from error


def read_joystick(fd: int) -> Iterator[bytes]:
    """Yield the events that a joystick device has sent so far.

    Raises PortMissing when the gamepad is unplugged.
    """
    try:
        while data := os.read(fd, EVENT.size * 64):
            yield data
    except BlockingIOError:
        return
    except OSError as error:
        raise PortMissing("the gamepad is gone", found=str(error),
                          likely="pulled out, or its battery is empty",
                          remedy="plug it in again") from error


class Gamepad:
    """Reads ``/dev/input/js0`` without blocking; clock [s]: by which reports age.

    Raises PortMissing.
    """

    def __init__(self, path: str = JOYSTICK, layout: GamepadLayout | None = None,
                 clock: Callable[[], float] = elapsed) -> None:
        self._layout = layout or GamepadLayout()
        self._clock = clock
        # Values of the axes that have reported, -1..1.
        self._axes: dict[int, float] = {}
        self._buttons: dict[int, bool] = {}
        self._age = InputAge(MAX_UNCHANGED_S)
        self._read_at = clock()
        self._refused = ""
        self._open(path)

    def _open(self, path: str) -> None:
        """Open the device. Raises PortMissing."""
        self._fd = open_joystick(path)

    @property
    def notice(self) -> str:
        """Why a pressed dead-man button gives no throttle, and the remedy; or ""."""
        return self._refused

    def read(self) -> tuple[float, float, bool]:
        """Steering, throttle and stop after all events so far.

        Raises PortMissing when the gamepad is unplugged.
        """
        now = self._clock()
        pause = now - self._read_at
        self._read_at = now
        self._poll()
        if pause > MAX_READ_GAP_S:
            self._refuse(f"the gamepad was not read for {pause:.1f} s (limit {MAX_READ_GAP_S} s)")
        steering = min(1.0, max(-1.0, self._deflection(self._layout.left)))
        return steering, self._throttle(now), self._buttons.get(self._layout.stop, False)

    def _poll(self) -> None:
        """Process the events so far. Raises PortMissing when the gamepad is unplugged."""
        for data in read_joystick(self._fd):
            self.feed(data)

    def feed(self, data: bytes) -> None:
        """Process whole events; the kernel never splits one, so a torn end is dropped."""
        whole = len(data) - len(data) % EVENT.size
        for _, value, kind, number in EVENT.iter_unpack(data[:whole]):
            initial = bool(kind & INIT)
            if kind & ~INIT == AXIS:
                self._move(number, value, initial)
            elif kind & ~INIT == BUTTON:
                self._press(number, bool(value), initial)
            else:
                continue
            if not initial:
                self._age.report(self._clock())

    def close(self) -> None:
        os.close(self._fd)

    def _move(self, number: int, value: int, initial: bool) -> None:
        layout = self._layout
        if initial and number in (layout.forward.number, layout.backward.number):
            # Before its first report a pad may claim a deflection without a hand on it.
            self._axes.pop(number, None)
            return
        self._axes[number] = max(-1.0, value / FULL_SCALE)

    def _deflection(self, travel: AxisTravel) -> float:
        """Return the deflection of an axis, 0 before its first report."""
        value = self._axes.get(travel.number)
        return 0.0 if value is None else travel.deflection(value)

    def _press(self, number: int, pressed: bool, initial: bool) -> None:
        self._buttons[number] = pressed
        if number != self._layout.dead_man:
            return
        if not pressed:
            self._refused = ""
        elif initial:
            self._refuse("the right bumper was pressed before the gamepad was opened")

    def _throttle(self, now: float) -> float:
        """Throttle that may be applied at ``now`` [s]."""
        if not self._buttons.get(self._layout.dead_man, False):
            return 0.0
        forward, backward = (min(1.0, max(0.0, self._deflection(travel)))
                             for travel in (self._layout.forward, self._layout.backward))
        throttle = forward - backward
        if throttle != 0.0 and self._age.is_over(now):
            self._refuse(f"no event from the gamepad for {MAX_UNCHANGED_S} s with the stick "
                         "deflected")
        return 0.0 if self._refused else throttle

    def _refuse(self, reason: str) -> None:
        """Keep the throttle neutral until a pressed dead-man button was released."""
        if self._buttons.get(self._layout.dead_man, False) and not self._refused:
            self._refused = f"{reason}: the throttle is neutral; {PRESS_AGAIN}"
