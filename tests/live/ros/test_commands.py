"""What messages do to the car, as numbers."""

from __future__ import annotations

from math import inf, nan

import numpy as np
import pytest

from dart_hal.control.input_age import InputAge
from dart_lab.live.ros.commands import MAX_MESSAGE_AGE_S, Commands, RosCommand, steering_angle


@pytest.fixture
def commands():
    """Armed at 0 s, commanded to go and to drive at 1 s."""
    made = Commands()
    made.require_go()
    made.current_command(0.5)
    made.safety(1.0, 1.0)
    made.throttle(0.25, 1.0)
    return made


def test_go_and_a_throttle_drive(commands):
    assert commands.current_command(1.0) == RosCommand(0.0, 0.25)
    assert commands.upstream_inputs(1.0) == (1.0, 0.25, 0.0)
    assert commands.take_reports() == []


@pytest.mark.parametrize("silent", ["safety_value", "throttle"])
def test_silence_is_neutral_and_reported_once(commands, silent):
    spoken = {"safety_value": lambda t: commands.throttle(0.25, t),
              "throttle": lambda t: commands.safety(1.0, t)}[silent]
    for t in np.arange(1.005, 3.0, 0.01):
        spoken(t)
        assert (commands.current_command(t).throttle != 0.0) == (t < 1.0 + MAX_MESSAGE_AGE_S), t
    (text,) = commands.take_reports()
    assert text == (f"{silent} has been silent for 0.3 s: neutral; to drive again send "
                    "safety_value 0, then 1")
    release(commands, 3.0)
    assert commands.current_command(3.0).throttle == 0.25
    commands.current_command(4.0)
    assert len(commands.take_reports()) == 1, "it is another silence"


def release(commands, t):
    """The operator lets go and presses again."""
    for value in (0.0, 1.0):
        commands.safety(value, t)
        commands.current_command(t)
    commands.throttle(0.25, t)


@pytest.mark.parametrize("silent", ["safety_value", "throttle", "both"])
def test_messages_that_come_after_a_silence_do_not_drive(commands, silent):
    """The network may have held them back, or a node was restarted that publishes 1 at once."""
    for t in np.arange(1.0, 6.0, 0.01):
        frozen = 2.0 < t < 4.0
        if not (frozen and silent != "throttle"):
            commands.safety(1.0, t)
        if not (frozen and silent != "safety_value"):
            commands.throttle(0.25, t)
        throttle = commands.current_command(t).throttle
        if t > 2.0 + MAX_MESSAGE_AGE_S + 0.01:
            assert throttle == 0.0, t
            assert commands.upstream_inputs(t)[0] == 0.0
    release(commands, 6.0)
    assert commands.current_command(6.0).throttle == 0.25


def test_a_throttle_of_zero_may_fall_silent(commands):
    """A controller has ended, and the next one begins."""
    commands.throttle(0.0, 1.0)
    for t in np.arange(1.0, 3.0, 0.01):
        commands.safety(1.0, t)
        commands.current_command(t)
    commands.throttle(0.25, 3.0)
    assert commands.current_command(3.0).throttle == 0.25
    assert commands.take_reports() == []


def test_control_without_the_age_limit_silence_drives_on(commands, monkeypatch):
    monkeypatch.setattr(InputAge, "is_over", lambda self, now: False)
    assert commands.current_command(20.0).throttle == 0.25


@pytest.mark.parametrize("value", [nan, inf, -inf, 1.0001, -1.0001, 3e38])
@pytest.mark.parametrize("topic", ["throttle", "steering"])
def test_what_cannot_be_meant_is_neutral_until_it_can(commands, topic, value):
    for _ in range(5):
        getattr(commands, topic)(value, 1.1)
        assert commands.current_command(1.1).throttle == 0.0
    (report,) = commands.take_reports()
    assert report == f"{topic} was {value:g}, expected -1 to 1: neutral"
    getattr(commands, topic)(0.2, 1.2)
    assert commands.current_command(1.2).throttle == (0.2 if topic == "throttle" else 0.25)


@pytest.mark.parametrize("value", [0.0, 0.5, 0.999, 2.0, -1.0, nan, inf])
def test_nothing_but_one_is_go(commands, value):
    commands.safety(value, 1.1)
    assert commands.current_command(1.1).throttle == 0.0
    assert commands.upstream_inputs(1.1) == (0.0, 0.25,
                                             0.0), "the throttle is published as it was sent"
    assert len(commands.take_reports()) == (value != 0.0)


def test_the_gate_opens_before_a_throttle_comes():
    """A controller may wait for it."""
    commands = Commands()
    commands.require_go()
    commands.current_command(0.0)
    commands.safety(1.0, 0.1)
    assert commands.current_command(0.1).throttle == 0.0
    assert commands.upstream_inputs(0.1) == (1.0, 0.0, 0.0)


def test_steering_holds_and_a_wrong_one_changes_nothing(commands):
    commands.steering(0.5, 0.2)
    assert commands.current_command(1.1).steering == steering_angle(0.5)
    commands.steering(nan, 1.1)
    assert commands.current_command(1.1).steering == steering_angle(0.5)


def test_a_go_that_was_there_while_it_armed_moves_nothing():
    commands = Commands()
    for t in np.arange(0.0, 2.0, 0.1):
        commands.safety(1.0, t)
        commands.throttle(0.3, t)
        if t == 1.0:
            commands.require_go()
        assert commands.current_command(t).throttle == 0.0
        assert commands.upstream_inputs(t)[0] == 0.0
    assert commands.take_reports() == [
        "safety_value was 1 while the car was armed: send 0, or nothing for 0.3 s, then 1"]
    commands.safety(0.0, 2.0)
    assert commands.current_command(2.0).throttle == 0.0
    commands.safety(1.0, 2.1)
    assert commands.current_command(2.1).throttle == 0.3


def test_the_angle_that_upstreams_helper_requests_is_steered():
    """Its table inverts the curve of car 1 by a hundred points."""
    command = np.linspace(-1.0, 1.0, 100)
    table = [steering_angle(s) for s in command]
    for angle in (-0.3, -0.1, 0.0, 0.07, 0.25):
        assert steering_angle(float(np.interp(angle, table, command))) == pytest.approx(
            angle, abs=1e-3)
