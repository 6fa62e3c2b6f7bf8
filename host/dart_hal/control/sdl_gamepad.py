"""A gamepad read through SDL, whose database knows the layout of more than a thousand pads.

The names of SDL's game controller become fixed numbers of axes and buttons, the same for every
pad. Needs the packages of the extra ``gamepad``.
"""

from __future__ import annotations

import ctypes
import warnings
from typing import Any

from dart_hal.control.gamepad import (
    AXIS,
    BUTTON,
    EVENT,
    INIT,
    AxisTravel,
    Gamepad,
    GamepadLayout,
)
from dart_hal.core.errors import PortMissing

# Numbers of SDL_GameControllerAxis and SDL_GameControllerButton: left stick, right trigger, left
# trigger, right bumper, B.
STANDARD_LAYOUT = GamepadLayout(left=AxisTravel(0, 0.0, -1.0), forward=AxisTravel(5, 0.0, 1.0),
                                backward=AxisTravel(4, 0.0, 1.0), dead_man=10, stop=1)


def load_sdl() -> Any:
    """Return the module ``sdl2``, None without the packages or the library."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns of the library that it has found
        try:
            import sdl2
        except ImportError:  # of PySDL2 itself, or of the library that it loads
            return None
    return sdl2


def find_controller(sdl: Any) -> int | None:
    """Return the index of the first pad whose layout SDL knows, None without one."""
    # Signals and the focus of a window belong to the program.
    for hint in (b"SDL_NO_SIGNAL_HANDLERS", b"SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS"):
        sdl.SDL_SetHint(hint, b"1")
    if sdl.SDL_InitSubSystem(sdl.SDL_INIT_GAMECONTROLLER) != 0:
        return None
    return next((k for k in range(sdl.SDL_NumJoysticks()) if sdl.SDL_IsGameController(k)), None)


class SdlGamepad(Gamepad):
    """Reads a pad by the standard layout of SDL; the rules of the throttle are the same.

    Raises PortMissing.
    """

    def __init__(self, sdl: Any, index: int, **options: Any) -> None:
        self._sdl = sdl
        super().__init__(str(index), STANDARD_LAYOUT, **options)

    def _open(self, path: str) -> None:
        sdl = self._sdl
        self._controller = sdl.SDL_GameControllerOpen(int(path))
        if not self._controller:
            raise PortMissing("the gamepad cannot be opened",
                              found=sdl.SDL_GetError().decode(errors="replace"),
                              remedy="dart-hal drive --keyboard")
        self._instance = sdl.SDL_JoystickInstanceID(
            sdl.SDL_GameControllerGetJoystick(self._controller))
        # What is pressed now was pressed before the program could see it at rest.
        self._drain(INIT)
        for number in range(sdl.SDL_CONTROLLER_BUTTON_MAX):
            if sdl.SDL_GameControllerGetButton(self._controller, number):
                self.feed(EVENT.pack(0, 1, BUTTON | INIT, number))

    def _poll(self) -> None:
        self._drain(0)

    def _drain(self, flags: int) -> None:
        """Process the events of SDL so far. Raises PortMissing when the gamepad is unplugged."""
        sdl = self._sdl
        event = sdl.SDL_Event()
        while sdl.SDL_PollEvent(ctypes.byref(event)):
            if event.type == sdl.SDL_CONTROLLERAXISMOTION:
                moved = event.caxis
                if moved.which == self._instance:
                    self.feed(EVENT.pack(0, moved.value, AXIS | flags, moved.axis))
            elif event.type in (sdl.SDL_CONTROLLERBUTTONDOWN, sdl.SDL_CONTROLLERBUTTONUP):
                pressed = event.cbutton
                if pressed.which == self._instance:
                    self.feed(EVENT.pack(0, pressed.state, BUTTON | flags, pressed.button))
            elif (event.type == sdl.SDL_CONTROLLERDEVICEREMOVED
                  and event.cdevice.which == self._instance):
                raise PortMissing("the gamepad is gone", found="SDL reports its removal",
                                  likely="pulled out, or its battery is empty",
                                  remedy="plug it in again")

    def close(self) -> None:
        self._sdl.SDL_GameControllerClose(self._controller)
