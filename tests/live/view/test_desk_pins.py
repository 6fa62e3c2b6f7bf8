"""A page that drives: what the ESC gets when the hand, the page or the network lets go."""

from __future__ import annotations

from contextlib import suppress

import pytest

from dart_hal.control.input_age import InputAge
from dart_lab.live.view import desk, operator
from dart_lab.live.view import messages as m
from dart_lab.live.view.messages import MalformedMessage, parse_message
from dart_lab.live.view.operator import Operator, Refused
from tests.live.view.at_the_desk import AtTheDesk
from tests.live.view.junk import Junk

pytestmark = pytest.mark.usefixtures("armed_esc")
NEUTRAL = 0.250
"""s from the end of a hold to the end of the last driving pulse."""
AT_ONCE = 0.050
"""s where the end is told: one State, one PWM frame and a pulse."""


def end_of_hold(how, seed=1):
    """(s until neutral, what happened) of a car that a page has driven for half a second."""
    at = AtTheDesk(seed)
    at.take_and_arm()
    at.drive(0.5, lambda t: at.hold())
    ended = at.now()
    assert at.driving(ended - 0.1), "it drove until then"
    how(at)
    at.drive(0.6)
    return at.last_driving(ended), at


ENDS = {"released": lambda at: at.say("one", m.Release()),
        "gone": lambda at: at.desk.close_page("one"),
        "left": lambda at: at.say("one", m.Leave()),
        "stopped by another": lambda at: at.say("two", m.Stop())}


@pytest.mark.parametrize("how", ENDS)
@pytest.mark.slow_except("released", "gone")
def test_an_end_that_is_told_is_at_the_pin_at_once(how):
    last, at = end_of_hold(ENDS[how])
    assert last <= AT_ONCE
    assert at.car.mode != "ARMED", "it is armed again by hand"


def test_a_page_that_falls_silent_leaves_the_car_neutral():
    last, at = end_of_hold(lambda at: None)
    assert AT_ONCE < last <= NEUTRAL
    assert at.car.mode != "ARMED"
    assert any("silent" in text for text in at.said())


def test_control_a_longer_hold_is_seen_at_the_pin(monkeypatch):
    monkeypatch.setattr(operator, "MAX_COMMAND_AGE_S", 0.4)
    assert end_of_hold(lambda at: None)[0] > NEUTRAL


def test_control_a_release_that_nobody_hears_is_seen_at_the_pin(monkeypatch):
    monkeypatch.setattr(Operator, "release", lambda self, page: None)
    assert end_of_hold(ENDS["released"])[0] > AT_ONCE


def still_hand(seconds=3.0):
    """Hold the stick, then let the page repeat its last state for so long; (last driving, desk)."""
    at = AtTheDesk()
    at.take_and_arm()
    at.drive(0.3, lambda t: at.hold())
    last_report = at.now()
    at.drive(seconds, lambda t: at.hold(unchanged=t - last_report))
    return at.last_driving(last_report), at


def test_a_page_whose_hand_reports_nothing_is_neutral_within_a_second():
    last, at = still_hand()
    assert 0.8 < last <= 1.0
    assert at.car.mode == "ARMED"
    assert len([text for text in at.said() if "did not change for 0.95 s" in text]) == 1
    began = at.now()
    at.drive(1.0, lambda t: at.hold())
    assert at.driving(began) == [], "a report alone is not enough: let go first"
    at.say("one", m.Release())
    at.take_and_arm()
    at.drive(0.3, lambda t: at.hold())
    assert at.driving(at.now() - 0.1)


def test_control_without_the_age_limit_a_still_hand_drives_on(monkeypatch):
    monkeypatch.setattr(InputAge, "is_over", lambda self, now: False)
    assert still_hand()[0] > 2.9


def test_the_age_of_a_command_is_taken_off_its_validity():
    with AtTheDesk() as at:
        at.take_and_arm()
        at.drive(0.5, lambda t: at.hold(old=0.15))
        ended = at.now()
        at.drive(0.4)
        assert 0.0 < at.last_driving(ended) <= NEUTRAL - 0.15 + 0.01
        with pytest.raises(Refused, match="the limit is 200"):
            at.hold(old=0.21)
        with pytest.raises(Refused):
            at.hold(old=-0.1)  # of the future: another program's time


@pytest.mark.slow
@pytest.mark.parametrize(("old", "mode"), [(0.18, "ARMED"), (0.19, "DISARMED")])
def test_a_command_that_ends_within_a_pwm_frame_has_run_out(old, mode):
    """A page that is never silent, behind a slow network: the next command comes each 30 ms."""
    with AtTheDesk() as at:
        at.take_and_arm()
        count = iter(range(1000))
        at.drive(2.0, lambda t: at.hold(old=old) if next(count) % 3 == 0 else None)
        assert at.car.mode == mode


def test_a_stick_that_is_held_while_it_arms_moves_nothing():
    with AtTheDesk() as at:
        at.say("one", m.Take("right"))
        at.say("one", m.Arm())
        at.drive(2.0, lambda t: at.hold())
        assert at.car.mode == "ARMED"
        assert at.driving(0.0) == []
        at.say("one", m.Release())
        at.drive(0.3, lambda t: at.hold())
        assert at.driving(0.0)


def test_control_without_that_rule_it_drives_off(monkeypatch):
    monkeypatch.setattr(Operator, "require_release", lambda self: None)
    with AtTheDesk() as at:
        at.say("one", m.Take("right"))
        at.say("one", m.Arm())
        at.drive(2.0, lambda t: at.hold())
        assert at.driving(0.0)


def stop_while_arming(after, within=2.0):
    """(modes from 20 ms behind the STOP on, until ``within`` s behind it, what happened)."""
    at = AtTheDesk()
    at.say("one", m.Take("right"))
    at.say("one", m.Arm())
    begun = at.now()
    stopped = []

    def each(t):
        if not stopped and t >= begun + after:
            stopped.append(t)
            at.say("two", m.Stop())

    at.drive(after + within, each)
    return [mode for t, mode in at.modes if t > stopped[0] + 0.02], at


def test_stop_while_it_arms_ends_the_arming():
    modes, at = stop_while_arming(0.4)
    assert "ARMED" not in modes
    assert "ARMING" not in modes
    assert any("Not armed. STOP was pressed" in text for text in at.said())


@pytest.mark.slow
def test_stop_at_a_hundred_moments_of_arming_and_driving():
    lasts = []
    for n in range(50):
        _, at = stop_while_arming(0.05 + 0.01 * n, within=0.3)
        assert "ARMED" not in [mode for _, mode in at.modes], n
        at.drive(0.6)  # a STOP holds for half a second
        at.take_and_arm()
        at.drive(0.2 + 0.0137 * n, lambda t, at=at: at.hold())
        pressed = at.now()
        at.say("two", m.Stop())
        at.drive(0.3, lambda t, at=at: at.hold())
        lasts.append(at.last_driving(pressed))
        assert at.driving(pressed - 0.1), "control: it drove"
    assert max(lasts) <= AT_ONCE


def test_a_car_that_was_stopped_is_armed_again_by_hand_alone():
    with AtTheDesk() as at:
        at.take_and_arm()
        at.drive(0.3, lambda t: at.hold())
        at.say("two", m.Stop())
        stopped = at.now()
        at.drive(1.0, lambda t: at.hold())
        assert at.last_driving(stopped) <= AT_ONCE
        at.say("one", m.Release())
        at.take_and_arm()
        at.drive(0.3, lambda t: at.hold())
        assert at.driving(at.now() - 0.1)


@pytest.mark.parametrize("seconds", [desk.STOP_DURATION_S, 0.0])
def test_stop_at_a_page_keeps_the_car_disarmed_for_half_a_second(monkeypatch, seconds):
    """Control: a stop that the next batch releases."""
    monkeypatch.setattr(desk, "STOP_DURATION_S", seconds)
    with AtTheDesk() as at:
        at.drive(0.1)
        at.say("two", m.Stop())
        at.drive(0.45)
        assert ("RUN_STOP" in at.car.refusals()) == (seconds > 0.0)
        at.drive(0.1)
        assert "RUN_STOP" not in at.car.refusals()


@pytest.mark.parametrize("how", ["ended", "closed"])
def test_run_ends_with_the_state_in_which_it_is_to_end(how):
    with AtTheDesk() as at:
        end = at.now() + 0.3
        if how == "ended":
            at.desk.run(2.0, lambda: at.now() >= end)
        else:
            at.drive(2.0, lambda t: at.desk.close() if t >= end else None)
        assert at.now() == pytest.approx(end, abs=0.015)


def test_who_drives_leaves_while_it_arms():
    with AtTheDesk() as at:
        at.say("one", m.Take("right"))
        at.say("one", m.Arm())
        begun = at.now()
        at.drive(2.0, lambda t: at.desk.close_page("one") if 0.4 < t - begun < 0.415 else None)
        assert "ARMED" not in [mode for _, mode in at.modes]


def test_whatever_another_page_sends_who_drives_drives_on():
    junk = Junk(3)
    understood = []

    def each(at):
        at.hold()
        for page in ("two", "three"):
            with suppress(MalformedMessage, Refused):
                understood.append(at.say(page, parse_message(junk.draw())))

    with AtTheDesk() as at:
        at.take_and_arm()
        at.drive(2.0, lambda t: each(at))
        assert len(understood) > 10, "among them are messages that are none of a driver's"
        assert at.car.mode == "ARMED"
        assert at.car.recorder.path is None
        pulses = at.driving(at.now() - 1.5)
        assert len(pulses) > 70, "no pulse was left out"
        assert len({round((fall - rise) * 1e6, -1) for rise, fall in pulses}) <= 2, "or changed"


def test_one_drives_and_the_others_are_refused():
    with AtTheDesk() as at:
        at.say("one", m.Take("right"))
        with pytest.raises(Refused, match="another page"):
            at.say("two", m.Take("right"))
        for message in (m.Arm(), m.Drive(0.0, 1.0, at.now()), m.Record(True)):
            with pytest.raises(Refused, match="does not drive"):
                at.say("two", message)
        at.say("two", m.Leave())
        at.say("two", m.Release())
        at.say("one", m.Leave())
        assert at.say("two", m.Take("right")) == desk.TAKEN_MESSAGE


def test_a_page_that_only_watches_can_stop_and_nothing_else():
    with AtTheDesk(drives=False) as at:
        with pytest.raises(Refused, match="driven by a program"):
            at.say("one", m.Take("right"))
        at.car.arm()
        for state in at.car.states(duration=0.3):
            at.car.drive(throttle=0.25)
        pressed = at.now()
        at.say("two", m.Stop())
        for state in at.car.states(duration=0.3):
            at.car.drive(throttle=0.25)
        assert at.driving(pressed - 0.1)
        assert at.last_driving(pressed) <= AT_ONCE
