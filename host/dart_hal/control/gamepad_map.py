"""Layouts of gamepads on disk, the questions that find one, and the choice of a pad's layout.

1. A layout that ``dart-hal drive --gamepad --map`` has written for a pad of this name.
2. The database of SDL, with the packages of the extra ``gamepad``.
3. The layout of Xbox-like pads.
"""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import msgspec

from dart_hal.control.gamepad import (
    AXIS,
    BUTTON,
    EVENT,
    FULL_SCALE,
    INIT,
    JOYSTICK,
    AxisTravel,
    Gamepad,
    GamepadLayout,
    open_joystick,
    read_joystick,
)
from dart_hal.control.sdl_gamepad import SdlGamepad, find_controller, load_sdl
from dart_hal.core.errors import ConfigError, UsageError

# Bytes of the name of a joystick, and the request of it: JSIOCGNAME(128).
NAME_BYTES = 128
NAME_REQUEST = 0x80006A13 | NAME_BYTES << 16
# Shortest travel of an axis that answers a question, and distance from rest of a released one.
MIN_ANSWER_TRAVEL = 0.5
MAX_REST_ERROR = 0.2
# Time for each answer [s]; without a report for QUIET_S a pad is released.
MAX_ANSWER_S = 30.0
QUIET_S = 1.5
POLL_S = 0.01
# Questions about axes and about buttons, by field of the layout.
AXES = {"left": "push the stick that steers fully to the left",
        "forward": "push the stick or trigger that drives forward to its end",
        "backward": "push the stick or trigger that brakes and drives backward to its end"}
BUTTONS = {"dead_man": "press the button that you will hold to drive",
           "stop": "press the button that stops the car"}


def layout_file(name: str) -> Path:
    """Return the file of the layout of a pad."""
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    plain = re.sub("[^a-z0-9]+", "-", name.lower()).strip("-")
    return Path(base) / "dart-hal" / "gamepads" / f"{plain or 'gamepad'}.json"


def save_layout(layout: GamepadLayout, name: str) -> Path:
    """Write the layout of a pad; return its file."""
    path = layout_file(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(msgspec.json.format(msgspec.json.encode(asdict(layout))) + b"\n")
    return path


def load_layout(name: str) -> GamepadLayout | None:
    """Return the saved layout of a pad, None without one. Raises ConfigError."""
    path = layout_file(name)
    if not path.is_file():
        return None
    try:
        layout = msgspec.json.decode(path.read_bytes(), type=GamepadLayout)
    except msgspec.DecodeError as error:
        raise ConfigError(f"{path} is no layout of a gamepad", found=str(error),
                          remedy="dart-hal drive --gamepad --map") from error
    return _check(layout)


def open_gamepad(path: str = JOYSTICK) -> Gamepad:
    """Open the gamepad with the best layout that is known. Raises PortMissing, ConfigError."""
    if Path(path).exists():
        fd = open_joystick(path)
        layout = load_layout(_joystick_name(fd))
        os.close(fd)
        if layout is not None:
            return Gamepad(path, layout)
    sdl = load_sdl()
    index = find_controller(sdl) if sdl is not None else None
    return Gamepad(path) if index is None else SdlGamepad(sdl, index)


def ask_layout(path: str, show: Callable[[str], None]) -> tuple[GamepadLayout, str]:
    """Ask for each control of a pad; return the layout and the name of the pad.

    Raises PortMissing without a pad, UsageError if a control does not move.
    """
    fd = open_joystick(path)
    try:
        name = _joystick_name(fd)
        watch = JoystickWatch(fd)
        # Some triggers claim the middle of their travel before they have moved once.
        first = "move each stick and press each trigger once, then release all"
        show(f"{name}: {first}")
        watch.wait(lambda: watch.reported and watch.quiet_s > QUIET_S, first)
        rest = dict(watch.values)
        travels = {field: _ask_axis(watch, rest, question, show)
                   for field, question in AXES.items()}
        pressed = {field: _ask_button(watch, question, show)
                   for field, question in BUTTONS.items()}
    finally:
        os.close(fd)
    return _check(GamepadLayout(
        left=travels["left"], forward=travels["forward"], backward=travels["backward"],
        dead_man=pressed["dead_man"], stop=pressed["stop"])), name


class JoystickWatch:
    """What a joystick has reported: values of its axes now, and since ``clear`` their extremes and
    the pressed buttons."""

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self.values: dict[int, float] = {}
        self.low: dict[int, float] = {}
        self.high: dict[int, float] = {}
        self.pressed: list[int] = []
        self.released: list[int] = []
        # Whether the pad itself has reported, and when it did last.
        self.reported = False
        self._reported_at = time.monotonic()

    @property
    def quiet_s(self) -> float:
        """Time since the last report [s]."""
        return time.monotonic() - self._reported_at

    def clear(self) -> None:
        self.low = dict(self.values)
        self.high = dict(self.values)
        self.pressed = []
        self.released = []

    def wait(self, is_answered: Callable[[], bool], question: str) -> None:
        """Read events until the answer. Raises UsageError after MAX_ANSWER_S, PortMissing."""
        deadline = time.monotonic() + MAX_ANSWER_S
        while not is_answered():
            if time.monotonic() > deadline:
                raise UsageError("the gamepad gave no answer",
                                 found=f"nothing that fits in {MAX_ANSWER_S:.0f} s",
                                 expected=question, remedy="dart-hal drive --gamepad --map")
            for data in read_joystick(self._fd):
                for _, value, kind, number in EVENT.iter_unpack(data):
                    self._take(value, kind, number)
            time.sleep(POLL_S)

    def _take(self, value: int, kind: int, number: int) -> None:
        if kind & ~INIT == AXIS:
            self.values[number] = x = max(-1.0, value / FULL_SCALE)
            self.low[number] = min(x, self.low.get(number, x))
            self.high[number] = max(x, self.high.get(number, x))
        elif kind == BUTTON:
            (self.pressed if value else self.released).append(number)
        if not kind & INIT:
            self.reported = True
            self._reported_at = time.monotonic()


def _ask_axis(watch: JoystickWatch, rest: dict[int, float], question: str,
              show: Callable[[str], None]) -> AxisTravel:
    """Return the axis that moved most and came back, and in which direction it moved."""
    show(f"{question}, then release it")
    watch.clear()

    def travel(number: int) -> float:
        """Return the larger of both distances from rest, with its sign."""
        middle = rest.get(number, 0.0)
        up = watch.high[number] - middle
        down = watch.low[number] - middle
        return up if up > -down else down

    def largest() -> int:
        return max(watch.values, key=lambda number: abs(travel(number)))

    def is_answered() -> bool:
        if not watch.values or abs(travel(largest())) < MIN_ANSWER_TRAVEL:
            return False
        number = largest()
        return abs(watch.values[number] - rest.get(number, 0.0)) < MAX_REST_ERROR

    watch.wait(is_answered, question)
    number = largest()
    return AxisTravel(number, float(round(rest.get(number, 0.0))),
                      1.0 if travel(number) > 0.0 else -1.0)


def _ask_button(watch: JoystickWatch, question: str, show: Callable[[str], None]) -> int:
    """Return the first button that is pressed and released."""
    show(f"{question}, then release it")
    watch.clear()
    watch.wait(lambda: any(number in watch.released for number in watch.pressed), question)
    return next(number for number in watch.pressed if number in watch.released)


def _joystick_name(fd: int) -> str:
    """Return the name of a joystick as its driver states it; "gamepad" without one."""
    if sys.platform != "linux":
        return "gamepad"
    import fcntl

    buffer = bytearray(NAME_BYTES)
    try:
        fcntl.ioctl(fd, NAME_REQUEST, buffer)
    except OSError:
        return "gamepad"
    return buffer.split(b"\0")[0].decode(errors="replace") or "gamepad"


def _check(layout: GamepadLayout) -> GamepadLayout:
    """Return a layout whose controls differ. Raises UsageError."""
    used = [(t.number, t.rest, t.end) for t in (layout.left, layout.forward, layout.backward)]
    steers = layout.left.number in (layout.forward.number, layout.backward.number)
    flat = any(t.rest == t.end for t in (layout.left, layout.forward, layout.backward))
    if steers or flat or len(set(used)) < len(used) or layout.dead_man == layout.stop:
        raise UsageError("two controls of the gamepad are the same", found=str(asdict(layout)),
                         expected="an axis to steer, others to drive and brake, two buttons",
                         remedy="dart-hal drive --gamepad --map")
    return layout
