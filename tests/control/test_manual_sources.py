"""Keyboard and gamepad: bytes in, steering and throttle out; letting go stops the car."""

from __future__ import annotations

import os

import pytest

from dart_hal.control.gamepad import EVENT, FULL_SCALE, Gamepad, GamepadLayout
from dart_hal.control.input_age import MAX_REPORT_AGE_S, MAX_UNCHANGED_S, InputAge
from dart_hal.control.keyboard import STEERING_STEP, THROTTLE_STEP, Keyboard
from dart_hal.core.errors import PortMissing, UsageError

LEFT = b"\x1b[D"
RIGHT_KEY = b"\x1b[C"
UP = b"\x1b[A"
DOWN = b"\x1b[B"


class ManualClock:
    """A time that a test sets."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return ManualClock()


@pytest.fixture
def keys(clock):
    """A keyboard without a terminal: only what it makes of bytes."""
    keyboard = Keyboard.__new__(Keyboard)
    keyboard.begin(clock)
    return keyboard


def test_left_is_positive_and_up_is_forward(keys):
    assert keys.press(LEFT) == (STEERING_STEP, 0.0, False)
    assert keys.press(UP) == (STEERING_STEP, THROTTLE_STEP, False)
    assert keys.press(RIGHT_KEY + RIGHT_KEY)[0] == pytest.approx(-STEERING_STEP)
    assert keys.press(DOWN)[1] == pytest.approx(0.0)


def test_letters_do_the_same(keys):
    assert keys.press(b"aw") == (STEERING_STEP, THROTTLE_STEP, False)
    assert keys.press(b"ds")[:2] == pytest.approx((0.0, 0.0))


def test_it_saturates(keys, clock):
    for _ in range(60):
        clock.now += 0.03
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


def hold(keys, clock, seconds, key=UP, period=0.03):
    """Repeats of one key as a terminal sends them; returns throttles."""
    throttles = []
    for _ in range(round(seconds / period)):
        clock.now += period
        throttles.append(keys.press(key)[1])
    return throttles


def wait(keys, clock, seconds):
    """Reads without a key, 100 a second; returns (s since the start, throttle)."""
    start = clock.now
    found = []
    for _ in range(round(seconds * 100)):
        clock.now += 0.01
        found.append((clock.now - start, keys.press(b"")[1]))
    return found


def test_a_silent_keyboard_is_neutral_after_its_age_limit(keys, clock):
    hold(keys, clock, 0.5)
    keys.press(LEFT)
    found = wait(keys, clock, 3.0)
    assert all(throttle > 0.0 for t, throttle in found if t < MAX_REPORT_AGE_S)
    assert all(throttle == 0.0 for t, throttle in found if t > MAX_REPORT_AGE_S + 0.011)
    assert "no key for 0.45 s" in keys.notice
    assert abs(keys.press(b"")[0]) < 1e-3, "the wheels are straight again"
    keys.press(UP)
    assert (keys.throttle, keys.notice) == (THROTTLE_STEP, "")


def test_the_age_of_a_keyboard_does_not_depend_on_the_pace_of_the_loop(keys, clock):
    hold(keys, clock, 0.3)
    clock.now += 0.15
    assert keys.press(b"")[1] > 0.0
    clock.now += 0.31
    assert keys.press(b"")[1] == 0.0


@pytest.mark.parametrize("frozen", [0.46, 3.0, 60.0])
def test_keys_that_a_frozen_connection_delivers_late_do_not_drive(keys, clock, frozen):
    hold(keys, clock, 0.5)
    wait(keys, clock, frozen)
    late = UP * min(round(frozen / 0.03), 1365)
    clock.now += 0.01
    assert keys.press(late)[1] == 0.0
    assert "typed earlier" in keys.notice
    assert set(hold(keys, clock, 2.0)) == {0.0}, "the key is still held"
    wait(keys, clock, 0.2)
    assert hold(keys, clock, 0.5)[-1] > 0.0, "released and pressed again"


def test_keys_that_were_typed_while_the_program_did_not_read_do_not_drive(keys, clock):
    clock.now += 0.8
    assert keys.press(3 * UP)[1] == 0.0
    assert hold(keys, clock, 0.5)[-1] > 0.0, "the key is still held, and its reports are new"
    clock.now += 0.8
    assert keys.press(20 * UP)[1] == 0.0
    assert set(hold(keys, clock, 1.0)) == {0.0}, "old keys in a burst: the connection hangs"
    wait(keys, clock, 0.2)
    assert hold(keys, clock, 0.5)[-1] > 0.0
    clock.now += 0.3
    assert keys.press(b"q")[2], "the end of a drive is never old"


def test_keys_without_a_meaning_are_no_report(keys, clock):
    hold(keys, clock, 0.5)
    for _ in range(20):
        clock.now += 0.03
        throttle = keys.press(b"x")[1]
    assert throttle == 0.0


def test_control_without_the_age_limit_a_silent_keyboard_drives_on(keys, clock, monkeypatch):
    monkeypatch.setattr(InputAge, "is_over", lambda self, now: False)
    hold(keys, clock, 0.5)
    assert wait(keys, clock, 20.0)[-1][1] > 0.0


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


def test_a_terminal_that_is_closed_is_reported(monkeypatch):
    import sys

    master, slave = os.openpty()
    with os.fdopen(slave) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        keyboard = Keyboard()
        os.close(master)
        with pytest.raises(PortMissing, match="terminal is gone"):
            keyboard.read()


# -- gamepad ----------------------------------------------------------------------


def axis(number, value):
    return EVENT.pack(0, round(value * FULL_SCALE), 0x02, number)


def button(number, down=True):
    return EVENT.pack(0, int(down), 0x01, number)


@pytest.fixture
def pad(tmp_path, clock):
    """A gamepad over a named pipe; ``pad.send(events)``."""
    path = tmp_path / "js0"
    os.mkfifo(path)
    gamepad = Gamepad(str(path), clock=clock)
    writer = os.open(path, os.O_WRONLY)
    gamepad.send = lambda *events: os.write(writer, b"".join(events))
    yield gamepad
    gamepad.close()
    os.close(writer)


def test_without_the_dead_man_there_is_no_throttle(pad):
    layout = GamepadLayout()
    pad.send(axis(layout.forward.number, -1.0), axis(layout.left.number, -0.5))
    steering, throttle, ended = pad.read()
    assert steering == pytest.approx(0.5, abs=1e-3)
    assert (throttle, ended) == (0.0, False)
    pad.send(button(layout.dead_man))
    assert pad.read()[1] == pytest.approx(1.0)
    pad.send(button(layout.dead_man, down=False))
    assert pad.read()[1] == 0.0


def test_sticks_that_rest_off_the_centre_are_zero(pad):
    layout = GamepadLayout()
    pad.send(button(layout.dead_man), axis(layout.forward.number, 0.04), axis(0, -0.04))
    assert pad.read() == (0.0, 0.0, False)


def test_the_first_events_carry_the_init_bit(pad):
    layout = GamepadLayout()
    steering = EVENT.pack(0, FULL_SCALE, 0x82, layout.left.number)
    pad.send(steering, EVENT.pack(0, 1, 0x81, layout.stop))
    assert pad.read() == (-1.0, 0.0, True)


def test_the_stop_button_ends(pad):
    pad.send(button(GamepadLayout().stop))
    assert pad.read()[2] is True


def test_torn_and_unknown_events_do_no_harm(pad):
    pad.feed(EVENT.pack(0, 9, 0x40, 77) + axis(0, -1.0) + b"\x01\x02\x03")
    assert pad.read()[0] == 1.0
    pad.feed(EVENT.pack(0, -32768, 0x02, 0))
    assert pad.read()[0] == 1.0


def test_no_gamepad_names_what_to_type(tmp_path):
    with pytest.raises(PortMissing, match="no gamepad") as caught:
        Gamepad(str(tmp_path / "js7"))
    assert "--keyboard" in caught.value.remedy


BUMPER = button(GamepadLayout().dead_man)
STICK = axis(GamepadLayout().forward.number, -1.0)
RELEASED = button(GamepadLayout().dead_man, down=False)
OTHER_STICK = axis(2, 0.5)
ORDERS = {"bumper, stick": [BUMPER, STICK], "stick, bumper": [STICK, BUMPER],
          "together": [BUMPER + STICK], "pressed twice": [BUMPER, STICK, RELEASED, BUMPER],
          "stick moved back and forth": [BUMPER, STICK, axis(4, 0.5), STICK]}


def read_for(pad, clock, seconds, each=lambda t: None):
    """Reads, 100 a second; returns (s since the start, throttle)."""
    start = clock.now
    found = []
    for _ in range(round(seconds * 100)):
        clock.now += 0.01
        each(clock.now - start)
        found.append((clock.now - start, pad.read()[1]))
    return found


@pytest.mark.parametrize("events", ORDERS.values(), ids=ORDERS)
def test_a_silent_gamepad_is_neutral_within_a_second(pad, clock, events):
    for event in events:
        read_for(pad, clock, 0.1)
        pad.send(event)
    found = read_for(pad, clock, 20.0)
    assert all(throttle == 1.0 for t, throttle in found if t < MAX_UNCHANGED_S)
    assert all(throttle == 0.0 for t, throttle in found if t > MAX_UNCHANGED_S + 0.021)
    assert "no event from the gamepad for 0.95 s" in pad.notice
    pad.send(axis(GamepadLayout().forward.number, -0.5))
    assert pad.read()[1] == 0.0, "the stick alone is not enough"
    pad.send(RELEASED)
    assert (pad.read()[1], pad.notice) == (0.0, "")
    pad.send(BUMPER)
    assert pad.read()[1] == pytest.approx(0.5, abs=1e-3), "released and pressed again"


def test_control_without_the_age_limit_a_silent_gamepad_drives_on(pad, clock, monkeypatch):
    monkeypatch.setattr(InputAge, "is_over", lambda self, now: False)
    pad.send(BUMPER, STICK)
    assert read_for(pad, clock, 20.0)[-1][1] == 1.0


def test_a_gamepad_that_reports_another_axis_is_alive(pad, clock):
    pad.send(BUMPER, STICK)
    found = read_for(pad, clock, 5.0, lambda t: pad.send(OTHER_STICK))
    assert {throttle for _, throttle in found} == {1.0}
    assert read_for(pad, clock, 1.0)[-1][1] == 0.0


def test_states_that_the_kernel_reports_are_no_events_of_the_gamepad(pad, clock):
    initial = EVENT.pack(0, 1, 0x81, 5) + EVENT.pack(0, -FULL_SCALE, 0x82, 4)
    pad.send(BUMPER, STICK)
    found = read_for(pad, clock, 3.0, lambda t: pad.send(EVENT.pack(0, 9, 0x82, 2)))
    assert found[-1][1] == 0.0
    pad.send(RELEASED, initial)
    assert pad.read()[1] == 0.0
    assert "before the gamepad was opened" in pad.notice
    pad.send(RELEASED, BUMPER)
    assert pad.read()[1] == 0.0, "the kernel's value of the throttle is not used"
    pad.send(STICK)
    assert pad.read()[1] == 1.0


def test_events_of_an_unknown_type_are_no_report(pad, clock):
    pad.send(BUMPER, STICK)
    unknown = EVENT.pack(0, 9, 0x40, 77)
    assert read_for(pad, clock, 2.0, lambda t: pad.send(unknown))[-1][1] == 0.0


def test_a_bumper_that_was_pressed_while_the_program_did_not_read_must_be_released(pad, clock):
    pad.read()
    pad.send(BUMPER, STICK)
    clock.now += 0.3
    assert pad.read()[1] == 0.0
    assert "was not read for 0.3 s" in pad.notice
    pad.send(RELEASED, BUMPER)
    assert pad.read()[1] == 1.0


def test_a_pipe_whose_writer_has_ended_is_silent(tmp_path, clock):
    path = tmp_path / "js0"
    os.mkfifo(path)
    gamepad = Gamepad(str(path), clock=clock)
    writer = os.open(path, os.O_WRONLY)
    os.write(writer, BUMPER + STICK)
    assert gamepad.read()[1] == 1.0
    os.close(writer)
    assert read_for(gamepad, clock, 2.0)[-1][1] == 0.0
    gamepad.close()


def test_a_gamepad_that_is_pulled_out_is_reported(pad, monkeypatch):
    def raise_no_device(fd, n):
        raise OSError(19, "No such device")

    monkeypatch.setattr("dart_hal.control.gamepad.os.read", raise_no_device)
    with pytest.raises(PortMissing, match="gone"):
        pad.read()
