"""Keyboard and gamepad: bytes in, steering and throttle out; letting go stops the car."""

from __future__ import annotations

import os

import pytest

from dart_hal.control.gamepad import EVENT, FULL, Gamepad, Layout
from dart_hal.control.keyboard import RELEASE, STEERING_STEP, THROTTLE_STEP, Keyboard
from dart_hal.errors import PortMissing, UsageError

LEFT, RIGHT, UP, DOWN = b"\x1b[D", b"\x1b[C", b"\x1b[A", b"\x1b[B"


@pytest.fixture
def keys():
    """A keyboard that was not opened: only what it makes of bytes."""
    keyboard = Keyboard.__new__(Keyboard)
    keyboard.steering = keyboard.throttle = 0.0
    keyboard._quiet = 0
    return keyboard


def test_left_is_positive_and_up_is_forward(keys):
    assert keys.press(LEFT) == (STEERING_STEP, 0.0, False)
    assert keys.press(UP) == (STEERING_STEP, THROTTLE_STEP, False)
    assert keys.press(RIGHT + RIGHT)[0] == pytest.approx(-STEERING_STEP)
    assert keys.press(DOWN)[1] == pytest.approx(0.0)


def test_letters_do_the_same(keys):
    assert keys.press(b"aw") == (STEERING_STEP, THROTTLE_STEP, False)
    assert keys.press(b"ds")[:2] == pytest.approx((0.0, 0.0))


def test_it_saturates(keys):
    for _ in range(60):
        steering, throttle, _ = keys.press(LEFT + UP)
    assert (steering, throttle) == (1.0, 1.0)


def test_space_stops_and_q_escape_and_ctrl_c_end(keys):
    keys.press(UP + LEFT)
    assert keys.press(b" ") == (0.0, 0.0, False)
    for end in (b"q", b"\x1b", b"\x03"):
        keys.press(UP)
        assert keys.press(end) == (0.0, 0.0, True)


def test_unknown_keys_are_ignored(keys):
    assert keys.press(b"xyz\xff") == (0.0, 0.0, False)


def test_letting_go_lets_the_throttle_go(keys):
    keys.press(UP + LEFT)
    for _ in range(RELEASE):
        assert keys.press(b"")[1] == THROTTLE_STEP
    assert keys.press(b"")[1] == 0.0
    for _ in range(200):
        steering = keys.press(b"")[0]
    assert steering < 1e-3


def test_a_keyboard_needs_a_terminal():
    with pytest.raises(UsageError, match="terminal"):
        Keyboard()


def test_a_terminal_is_left_as_it_was(monkeypatch):
    import sys
    import termios

    master, slave = os.openpty()
    before = termios.tcgetattr(slave)
    with os.fdopen(slave) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        keyboard = Keyboard()
        assert termios.tcgetattr(slave)[3] != before[3]
        os.write(master, b"w")
        assert keyboard.read() == (0.0, THROTTLE_STEP, False)
        assert keyboard.read()[1] == THROTTLE_STEP
        keyboard.close()
        assert termios.tcgetattr(slave) == before
    os.close(master)


# -- gamepad ----------------------------------------------------------------------


def axis(number, value):
    return EVENT.pack(0, round(value * FULL), 0x02, number)


def button(number, down=True):
    return EVENT.pack(0, int(down), 0x01, number)


@pytest.fixture
def pad(tmp_path):
    """A gamepad over a named pipe; ``pad.send(events)``."""
    path = tmp_path / "js0"
    os.mkfifo(path)
    gamepad = Gamepad(str(path))
    writer = os.open(path, os.O_WRONLY)
    gamepad.send = lambda *events: os.write(writer, b"".join(events))
    yield gamepad
    gamepad.close()
    os.close(writer)


def test_without_the_dead_man_there_is_no_throttle(pad):
    layout = Layout()
    pad.send(axis(layout.throttle, -1.0), axis(layout.steering, -0.5))
    steering, throttle, ended = pad.read()
    assert steering == pytest.approx(0.5, abs=1e-3)
    assert (throttle, ended) == (0.0, False)
    pad.send(button(layout.dead_man))
    assert pad.read()[1] == pytest.approx(1.0)
    pad.send(button(layout.dead_man, down=False))
    assert pad.read()[1] == 0.0


def test_sticks_that_rest_beside_the_centre_are_zero(pad):
    pad.send(button(Layout().dead_man), axis(Layout().throttle, 0.04), axis(0, -0.04))
    assert pad.read() == (0.0, 0.0, False)


def test_the_first_events_carry_the_init_bit(pad):
    layout = Layout()
    pad.send(EVENT.pack(0, FULL, 0x82, layout.steering), EVENT.pack(0, 1, 0x81, layout.stop))
    assert pad.read() == (-1.0, 0.0, True)


def test_the_stop_button_ends(pad):
    pad.send(button(Layout().stop))
    assert pad.read()[2] is True


def test_torn_and_unknown_events_do_no_harm(pad):
    pad.feed(EVENT.pack(0, 9, 0x40, 77) + axis(0, -1.0) + b"\x01\x02\x03")
    assert pad.read()[0] == 1.0
    pad.feed(EVENT.pack(0, -32768, 0x02, 0))
    assert pad.read()[0] == 1.0


def test_no_gamepad_says_what_to_type(tmp_path):
    with pytest.raises(PortMissing, match="no gamepad") as caught:
        Gamepad(str(tmp_path / "js7"))
    assert "--keyboard" in caught.value.remedy


def test_a_gamepad_that_is_pulled_out_is_said(pad, monkeypatch):
    def gone(fd, n):
        raise OSError(19, "No such device")

    monkeypatch.setattr("dart_hal.control.gamepad.os.read", gone)
    with pytest.raises(PortMissing, match="gone"):
        pad.read()
