"""Layouts of gamepads: questions, files, and SDL's database with a virtual pad of SDL."""

from __future__ import annotations

import json
import os

import pytest

from dart_hal.control import gamepad_map
from dart_hal.control.gamepad import EVENT, FULL_SCALE, AxisTravel, Gamepad, GamepadLayout
from dart_hal.control.gamepad_map import (
    ask_layout,
    layout_file,
    load_layout,
    open_gamepad,
    save_layout,
)
from dart_hal.control.sdl_gamepad import SdlGamepad, find_controller, load_sdl
from dart_hal.core.errors import ConfigError, PortMissing, UsageError

# A pad that numbers its controls unlike an Xbox pad: raw triggers 2 and 5, stick 0, buttons 3, 8.
ODD = GamepadLayout(AxisTravel(0, 0.0, -1.0), AxisTravel(5, -1.0, 1.0), AxisTravel(2, -1.0, 1.0),
                    dead_man=3, stop=8)


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(gamepad_map, "QUIET_S", 0.1)
    monkeypatch.setattr(gamepad_map, "MAX_ANSWER_S", 3.0)


@pytest.fixture
def device(tmp_path):
    """A joystick device: (path, descriptor to write to)."""
    path = tmp_path / "js0"
    os.mkfifo(path)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)  # so that the writer can be opened
    writer = os.open(path, os.O_WRONLY)
    yield path, writer
    os.close(writer)
    os.close(reader)


def axis(number, value):
    return EVENT.pack(0, round(value * FULL_SCALE), 0x02, number)


def button(number, down):
    return EVENT.pack(0, int(down), 0x01, number)


def answers(layout):
    """What a hand does to each question, in their order."""
    yield [axis(n, 0.3) for n in (0, 1)] + [axis(0, 0.0), axis(1, 0.02)] + [
        e for t in (layout.forward, layout.backward)
        for e in (axis(t.number, t.end), axis(t.number, t.rest))]
    for travel in (layout.left, layout.forward, layout.backward):
        # The other axis of the stick moves a little, too.
        yield [axis(1, 0.2), axis(travel.number, 0.8 * travel.end), axis(1, 0.02),
               axis(travel.number, travel.rest)]
    for number in (layout.dead_man, layout.stop):
        yield [button(number, True), button(number, False)]


def ask(device, layout):
    """Answer the questions by a hand that plays the layout."""
    path, writer = device
    hand = answers(layout)

    def move(_text):
        for event in next(hand):
            os.write(writer, event)

    return ask_layout(str(path), move)


@pytest.mark.slow_except("odd")
@pytest.mark.parametrize("layout", [ODD, GamepadLayout()], ids=["odd", "default"])
def test_the_questions_find_the_layout(device, layout):
    found, name = ask(device, layout)
    assert (found, name) == (layout, "gamepad")
    path = save_layout(found, name)
    assert path.is_relative_to(os.environ["XDG_DATA_HOME"])
    assert load_layout(name) == layout


def test_a_saved_layout_is_used(device):
    path, writer = device
    save_layout(ODD, "gamepad")
    pad = open_gamepad(str(path))
    os.write(writer, button(3, True) + axis(0, -0.5) + axis(5, -1.0) + axis(5, 0.0))
    assert pad.read() == pytest.approx((0.5, 0.5, False), abs=1e-3)
    os.write(writer, axis(5, -1.0) + axis(2, 1.0) + button(8, True))
    assert pad.read() == pytest.approx((0.5, -1.0, True), abs=1e-3)
    pad.close()
    # Negative control: with the default layout the same buttons do not drive.
    other = Gamepad(str(path))
    os.write(writer, button(3, True) + axis(5, 0.0))
    assert other.read()[1] == 0.0
    other.close()


@pytest.mark.slow
def test_a_pad_that_does_not_answer_is_reported(device, monkeypatch):
    monkeypatch.setattr(gamepad_map, "MAX_ANSWER_S", 0.2)
    with pytest.raises(UsageError, match="no answer"):
        ask_layout(str(device[0]), lambda text: None)


def test_one_control_for_two_purposes_is_refused(device):
    with pytest.raises(UsageError, match="are the same"):
        ask(device, GamepadLayout(dead_man=1, stop=1))


@pytest.mark.parametrize("text", ["{", "{}", '{"left": 3}'])
def test_a_bad_file_names_the_remedy(text):
    layout_file("pad").parent.mkdir(parents=True)
    layout_file("pad").write_text(text, encoding="utf-8")
    if text == "{}":
        assert load_layout("pad") == GamepadLayout(), "what is missing has its default"
        return
    with pytest.raises(ConfigError) as caught:
        load_layout("pad")
    assert "--map" in caught.value.remedy


def test_the_verb_saves_the_layout(device, monkeypatch, capsys):
    from dart_hal.cli import drive

    path, writer = device
    hand = answers(ODD)
    monkeypatch.setattr(drive, "JOYSTICK", str(path))
    monkeypatch.setattr(drive.console, "print",
                        lambda *_, **__: [os.write(writer, event) for event in next(hand)])
    drive.map_gamepad(True, True)
    answer = json.loads(capsys.readouterr().out)
    assert answer["gamepad"] == "gamepad"
    assert load_layout("gamepad") == ODD
    with pytest.raises(UsageError):
        drive.map_gamepad(False, True)


# -- SDL ---------------------------------------------------------------------------


class VirtualPad:
    """A pad of SDL without hardware."""

    def __init__(self, sdl):
        self._sdl = sdl
        sdl.SDL_InitSubSystem(sdl.SDL_INIT_GAMECONTROLLER)
        self.index = sdl.SDL_JoystickAttachVirtual(sdl.SDL_JOYSTICK_TYPE_GAMECONTROLLER, 6, 15, 0)
        assert self.index >= 0, sdl.SDL_GetError()
        self._joystick = sdl.SDL_JoystickOpen(self.index)

    def axis(self, number, value):
        self._sdl.SDL_JoystickSetVirtualAxis(self._joystick, number, round(value * FULL_SCALE))

    def button(self, number, down):
        self._sdl.SDL_JoystickSetVirtualButton(self._joystick, number, int(down))

    def detach(self):
        self._sdl.SDL_JoystickDetachVirtual(self.index)


@pytest.fixture
def sdl():
    found = load_sdl()
    if found is None:
        pytest.skip("SDL is not installed")
    yield found
    found.SDL_QuitSubSystem(found.SDL_INIT_GAMECONTROLLER)


@pytest.fixture
def virtual(sdl):
    pad = VirtualPad(sdl)
    yield pad
    pad.detach()


@pytest.mark.slow
def test_a_pad_of_the_database_drives(sdl, virtual, tmp_path):
    pad = open_gamepad(str(tmp_path / "no-joystick"))
    assert isinstance(pad, SdlGamepad)
    assert pad.read() == (0.0, 0.0, False)
    # Numbers of the virtual pad: sticks 0 to 3, triggers 4 and 5, right bumper 10, B 1.
    virtual.axis(0, -0.5)
    virtual.axis(5, 1.0)
    assert pad.read() == pytest.approx((0.5, 0.0, False), abs=1e-3), "control: no bumper"
    virtual.button(10, True)
    assert pad.read() == pytest.approx((0.5, 1.0, False), abs=1e-3)
    virtual.axis(5, -1.0)
    virtual.axis(4, 1.0)
    virtual.button(1, True)
    assert pad.read() == pytest.approx((0.5, -1.0, True), abs=1e-3)
    virtual.button(10, False)
    assert pad.read()[1] == 0.0
    pad.close()


def test_a_bumper_that_was_pressed_before_has_to_be_released(sdl, virtual):
    virtual.button(10, True)
    sdl.SDL_JoystickUpdate()
    pad = SdlGamepad(sdl, find_controller(sdl))
    virtual.axis(5, 1.0)
    assert pad.read()[1] == 0.0
    assert "before the gamepad was opened" in pad.notice
    virtual.button(10, False)
    pad.read()
    virtual.button(10, True)
    assert pad.read()[1] == pytest.approx(1.0)
    pad.close()


def test_a_silent_pad_of_the_database_is_neutral(sdl, virtual):
    now = [100.0]
    pad = SdlGamepad(sdl, find_controller(sdl), clock=lambda: now[0])
    virtual.button(10, True)
    virtual.axis(5, 1.0)
    found = []
    for _ in range(200):
        now[0] += 0.01
        found.append(pad.read()[1])
    assert found[:90] == [pytest.approx(1.0)] * 90
    assert found[98:] == [0.0] * 102
    pad.close()


def test_a_pad_of_the_database_that_is_pulled_out_is_reported(sdl):
    virtual = VirtualPad(sdl)
    pad = SdlGamepad(sdl, find_controller(sdl))
    virtual.detach()
    with pytest.raises(PortMissing, match="gone"):
        pad.read()
    pad.close()


def test_without_sdl_the_joystick_is_read(device, monkeypatch):
    monkeypatch.setattr(gamepad_map, "load_sdl", lambda: None)
    pad = open_gamepad(str(device[0]))
    assert type(pad) is Gamepad
    pad.close()
    with pytest.raises(PortMissing):
        open_gamepad(str(device[0]) + "-none")
