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
SILENT_PAGE_LIMIT_S = 0.250
"""s from the end of a hold to the end of the last driving pulse."""
REPORTED_END_S = 0.050
"""s where the end is reported: one State, one PWM frame and a pulse."""


def end_of_hold(how, seed=1):
    """(s until neutral, what happened) of a car that a page has driven for half a second."""
    seat = AtTheDesk(seed)
    seat.take_and_arm()
    seat.drive(0.5, lambda t: seat.hold())
    ended = seat.now()
    assert seat.driving(ended - 0.1), "it drove until then"
    how(seat)
    seat.drive(0.6)
    return seat.last_driving(ended), seat


ENDS_OF_DRIVING = {"hidden": lambda seat: seat.send_message("one", m.Release()),
                   "gone": lambda seat: seat.desk.close_page("one"),
                   "left": lambda seat: seat.send_message("one", m.Leave()),
                   "stopped by another": lambda seat: seat.send_message("two", m.Stop())}


@pytest.mark.parametrize("how", ENDS_OF_DRIVING)
@pytest.mark.slow
def test_an_end_that_is_reported_is_at_the_pin_at_once(how):
    last, seat = end_of_hold(ENDS_OF_DRIVING[how])
    assert last <= REPORTED_END_S
    assert seat.car.mode != "ARMED", "it is armed again by hand"


@pytest.mark.slow
def test_a_page_that_falls_silent_leaves_the_car_neutral():
    last, seat = end_of_hold(lambda seat: None)
    assert REPORTED_END_S < last <= SILENT_PAGE_LIMIT_S
    assert seat.car.mode != "ARMED"
    assert any("silent" in text for text in seat.list_texts())


@pytest.mark.slow
def test_control_a_longer_hold_shows_at_the_pin(monkeypatch):
    monkeypatch.setattr(operator, "MAX_COMMAND_AGE_S", 0.4)
    assert end_of_hold(lambda seat: None)[0] > SILENT_PAGE_LIMIT_S


@pytest.mark.slow
def test_control_a_release_that_is_not_received_shows_at_the_pin(monkeypatch):
    monkeypatch.setattr(Operator, "release", lambda *args: None)
    assert end_of_hold(ENDS_OF_DRIVING["hidden"])[0] > REPORTED_END_S
    assert release_and_wait(0.6)[0] > REPORTED_END_S


def release_and_wait(seconds):
    """Release the stick of a car that drives, and watch it; (s until neutral, what happened)."""
    seat = AtTheDesk()
    seat.take_and_arm()
    seat.drive(0.5, lambda t: seat.hold())
    ended = seat.now()
    assert seat.driving(ended - 0.1), "it drove until then"
    seat.drive(seconds, lambda t: seat.watch())
    return seat.last_driving(ended), seat


def test_a_released_stick_is_neutral_at_once_and_holding_it_drives_again():
    last, seat = release_and_wait(9.5)
    assert last <= REPORTED_END_S
    assert seat.car.mode == "ARMED"
    began = seat.now()
    seat.drive(0.3, lambda t: seat.hold())
    assert seat.driving(began)
    seat.drive(9.5, lambda t: seat.watch())
    assert seat.car.mode == "ARMED", "each hold starts the 10 s again"


@pytest.mark.slow
def test_a_stick_that_stays_released_disarms_after_ten_seconds():
    _, seat = release_and_wait(9.9)
    assert seat.car.mode == "ARMED"
    seat.drive(0.2, lambda t: seat.watch())
    assert seat.car.mode == "DISARMED"
    assert seat.list_texts()[-1] == "the stick was not held for 10 s: arm to drive again"
    began = seat.now()
    seat.drive(0.5, lambda t: seat.hold())
    assert seat.driving(began) == []


@pytest.mark.slow
def test_control_without_that_limit_it_stays_armed(monkeypatch):
    monkeypatch.setattr(operator, "MAX_RELEASED_S", 1e9)
    assert release_and_wait(11.0)[1].car.mode == "ARMED"


@pytest.mark.slow
def test_a_car_that_is_armed_and_never_driven_disarms_after_ten_seconds():
    with AtTheDesk() as seat:
        seat.take_and_arm()
        seat.drive(10.2, lambda t: seat.watch())
        assert seat.car.mode == "DISARMED"


ENDS_OF_WATCHING = {**ENDS_OF_DRIVING, "silent": lambda seat: None}


@pytest.mark.slow
@pytest.mark.parametrize("how", ENDS_OF_WATCHING)
def test_a_released_stick_ends_with_its_page(how):
    _, seat = release_and_wait(2.0)
    ENDS_OF_WATCHING[how](seat)
    seat.drive(SILENT_PAGE_LIMIT_S)
    assert seat.car.mode != "ARMED"
    began = seat.now()
    if how in ("hidden", "silent"):
        seat.drive(0.5, lambda t: seat.hold())
    assert seat.driving(began) == []


@pytest.mark.slow
def test_control_without_an_age_limit_a_silent_page_keeps_the_car_armed(monkeypatch):
    monkeypatch.setattr(operator, "MAX_COMMAND_AGE_S", 1e9)
    _, seat = release_and_wait(2.0)
    seat.drive(SILENT_PAGE_LIMIT_S)
    assert seat.car.mode == "ARMED"


@pytest.mark.slow
def test_a_page_that_is_hidden_while_the_car_arms_ends_the_arming():
    with AtTheDesk() as seat:
        seat.send_message("one", m.Take("right"))
        seat.send_message("one", m.Arm())
        begun = seat.now()
        seat.drive(2.0, lambda t: seat.send_message("one", m.Release())
                   if 0.4 < t - begun < 0.415 else None)
        assert "ARMED" not in [mode for _, mode in seat.modes]


@pytest.mark.slow
def test_a_stick_that_is_released_after_a_stop_arms_nothing():
    _, seat = release_and_wait(1.0)
    seat.send_message("two", m.Stop())
    texts = len(seat.list_texts())
    stopped = seat.now()
    seat.drive(1.0, lambda t: seat.watch())
    assert seat.car.mode != "ARMED"
    assert seat.driving(stopped + REPORTED_END_S) == []
    assert seat.list_texts()[texts:] == ["STOP was pressed at a page"], "and no other notice"


def still_hand(seconds=3.0):
    """Hold the stick, then let the page repeat its last state for so long; (last driving, desk)."""
    seat = AtTheDesk()
    seat.take_and_arm()
    seat.drive(0.3, lambda t: seat.hold())
    last_report = seat.now()
    seat.drive(seconds, lambda t: seat.hold(unchanged=t - last_report))
    return seat.last_driving(last_report), seat


@pytest.mark.slow
def test_a_page_whose_hand_reports_nothing_is_neutral_within_a_second():
    last, seat = still_hand()
    assert 0.8 < last <= 1.0
    assert seat.car.mode == "ARMED"
    assert len([text for text in seat.list_texts() if "did not change for 0.95 s" in text]) == 1
    began = seat.now()
    seat.drive(1.0, lambda t: seat.hold())
    assert seat.driving(began) == [], "a report alone is not enough: let go first"
    seat.send_message("one", m.Release())
    seat.take_and_arm()
    seat.drive(0.3, lambda t: seat.hold())
    assert seat.driving(seat.now() - 0.1)


@pytest.mark.slow
def test_control_without_the_age_limit_a_still_hand_drives_on(monkeypatch):
    monkeypatch.setattr(InputAge, "is_over", lambda self, now: False)
    assert still_hand()[0] > 2.9


@pytest.mark.slow
def test_the_age_of_a_command_is_taken_off_its_validity():
    with AtTheDesk() as seat:
        seat.take_and_arm()
        seat.drive(0.5, lambda t: seat.hold(old=0.15))
        ended = seat.now()
        seat.drive(0.4)
        assert 0.0 < seat.last_driving(ended) <= SILENT_PAGE_LIMIT_S - 0.15 + 0.01
        with pytest.raises(Refused, match="the limit is 200"):
            seat.hold(old=0.21)
        with pytest.raises(Refused):
            seat.hold(old=-0.1)  # of the future: another program's time


@pytest.mark.slow
@pytest.mark.parametrize(("old", "mode"), [(0.18, "ARMED"), (0.19, "DISARMED")])
def test_a_command_that_ends_within_a_pwm_frame_has_run_out(old, mode):
    """A page that is never silent, behind a slow network: the next command comes each 30 ms."""
    with AtTheDesk() as seat:
        seat.take_and_arm()
        count = iter(range(1000))
        seat.drive(2.0, lambda t: seat.hold(old=old) if next(count) % 3 == 0 else None)
        assert seat.car.mode == mode


@pytest.mark.slow
def test_a_stick_that_is_held_while_it_arms_moves_nothing():
    with AtTheDesk() as seat:
        seat.send_message("one", m.Take("right"))
        seat.send_message("one", m.Arm())
        seat.drive(2.0, lambda t: seat.hold())
        assert seat.car.mode == "ARMED"
        assert seat.driving(0.0) == []
        seat.watch()
        seat.drive(0.3, lambda t: seat.hold())
        assert seat.driving(0.0)


@pytest.mark.slow
def test_control_without_that_rule_it_drives_off(monkeypatch):
    monkeypatch.setattr(Operator, "require_release", lambda self: None)
    with AtTheDesk() as seat:
        seat.send_message("one", m.Take("right"))
        seat.send_message("one", m.Arm())
        seat.drive(2.0, lambda t: seat.hold())
        assert seat.driving(0.0)


def stop_while_arming(delay, within=2.0):
    """(modes from 20 ms behind the STOP on, until ``within`` s behind it, what happened)."""
    seat = AtTheDesk()
    seat.send_message("one", m.Take("right"))
    seat.send_message("one", m.Arm())
    begun = seat.now()
    stopped = []

    def each(t):
        if not stopped and t >= begun + delay:
            stopped.append(t)
            seat.send_message("two", m.Stop())

    seat.drive(delay + within, each)
    return [mode for t, mode in seat.modes if t > stopped[0] + 0.02], seat


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.05, 0.4])
def test_stop_while_it_arms_ends_the_arming(delay):
    modes, seat = stop_while_arming(delay, within=5.0)
    assert "ARMED" not in modes
    assert "ARMING" not in modes
    notice = "Not armed. STOP was pressed" if delay else "STOP was pressed"
    assert any(notice in text for text in seat.list_texts())


@pytest.mark.slow
def test_stop_at_a_hundred_moments_of_arming_and_driving():
    lasts = []
    for n in range(50):
        _, seat = stop_while_arming(0.05 + 0.01 * n, within=0.3)
        assert "ARMED" not in [mode for _, mode in seat.modes], n
        seat.drive(0.6)  # a STOP holds for half a second
        seat.take_and_arm()
        seat.drive(0.2 + 0.0137 * n, lambda t, seat=seat: seat.hold())
        pressed = seat.now()
        seat.send_message("two", m.Stop())
        seat.drive(0.3, lambda t, seat=seat: seat.hold())
        lasts.append(seat.last_driving(pressed))
        assert seat.driving(pressed - 0.1), "control: it drove"
    assert max(lasts) <= REPORTED_END_S


@pytest.mark.slow
def test_a_car_that_was_stopped_is_armed_again_by_hand_alone():
    with AtTheDesk() as seat:
        seat.take_and_arm()
        seat.drive(0.3, lambda t: seat.hold())
        seat.send_message("two", m.Stop())
        stopped = seat.now()
        seat.drive(1.0, lambda t: seat.hold())
        assert seat.last_driving(stopped) <= REPORTED_END_S
        seat.send_message("one", m.Release())
        seat.take_and_arm()
        seat.drive(0.3, lambda t: seat.hold())
        assert seat.driving(seat.now() - 0.1)


@pytest.mark.slow_except("0.0")
@pytest.mark.parametrize("seconds", [desk.STOP_DURATION_S, 0.0])
def test_stop_at_a_page_keeps_the_car_disarmed_for_half_a_second(monkeypatch, seconds):
    """Control: a stop that the next batch releases."""
    monkeypatch.setattr(desk, "STOP_DURATION_S", seconds)
    with AtTheDesk() as seat:
        seat.drive(0.1)
        seat.send_message("two", m.Stop())
        seat.drive(0.45)
        assert ("RUN_STOP" in seat.car.refusals()) == (seconds > 0.0)
        seat.drive(0.1)
        assert "RUN_STOP" not in seat.car.refusals()


@pytest.mark.slow_except("ended")
@pytest.mark.parametrize("how", ["ended", "closed"])
def test_run_ends_with_the_state_in_which_it_is_to_end(how):
    with AtTheDesk() as seat:
        end = seat.now() + 0.3
        if how == "ended":
            seat.desk.run(2.0, lambda: seat.now() >= end)
        else:
            seat.drive(2.0, lambda t: seat.desk.close() if t >= end else None)
        assert seat.now() == pytest.approx(end, abs=0.015)


@pytest.mark.slow
def test_who_drives_leaves_while_it_arms():
    with AtTheDesk() as seat:
        seat.send_message("one", m.Take("right"))
        seat.send_message("one", m.Arm())
        begun = seat.now()
        seat.drive(2.0, lambda t: seat.desk.close_page("one") if 0.4 < t - begun < 0.415 else None)
        assert "ARMED" not in [mode for _, mode in seat.modes]


@pytest.mark.slow
def test_the_driver_drives_on_under_any_message_of_another_page():
    junk = Junk(3)
    understood = []

    def each(seat):
        seat.hold()
        for page in ("two", "three"):
            with suppress(MalformedMessage, Refused):
                understood.append(seat.send_message(page, parse_message(junk.draw())))

    with AtTheDesk() as seat:
        seat.take_and_arm()
        seat.drive(2.0, lambda t: each(seat))
        assert len(understood) > 10, "among them are messages that are none of a driver's"
        assert seat.car.mode == "ARMED"
        assert seat.car.recorder.path is None
        pulses = seat.driving(seat.now() - 1.5)
        assert len(pulses) > 70, "no pulse was left out"
        assert len({round((fall - rise) * 1e6, -1) for rise, fall in pulses}) <= 2, "or changed"


def test_one_drives_and_the_others_are_refused():
    with AtTheDesk() as seat:
        seat.send_message("one", m.Take("right"))
        with pytest.raises(Refused, match="another page"):
            seat.send_message("two", m.Take("right"))
        for message in (m.Arm(), m.DriveRequest(0.0, 1.0, seat.now()), m.Record(True)):
            with pytest.raises(Refused, match="does not drive"):
                seat.send_message("two", message)
        seat.send_message("two", m.Leave())
        seat.send_message("two", m.Release())
        seat.send_message("one", m.Leave())
        assert seat.send_message("two", m.Take("right")) == desk.TAKEN_MESSAGE


@pytest.mark.slow
def test_a_page_that_only_watches_can_stop_and_nothing_else():
    with AtTheDesk(drives=False) as seat:
        with pytest.raises(Refused, match="driven by a program"):
            seat.send_message("one", m.Take("right"))
        seat.car.arm()
        for state in seat.car.states(duration=0.3):
            seat.car.drive(throttle=0.25)
        pressed = seat.now()
        seat.send_message("two", m.Stop())
        for state in seat.car.states(duration=0.3):
            seat.car.drive(throttle=0.25)
        assert seat.driving(pressed - 0.1)
        assert seat.last_driving(pressed) <= REPORTED_END_S


def leave_during(first, how, requests=1):
    """Return when the page has left, ``first`` s after it took the wheel, and what happened."""
    seat = AtTheDesk()
    seat.send_message("one", m.Take("right"))
    for _ in range(requests):
        seat.send_message("one", m.Arm())
    begun = seat.now()
    left = []

    def each(t):
        if not left and t >= begun + first:
            left.append(t)
            how(seat)

    seat.drive(first + 4.0, each)
    return left[0], seat


@pytest.mark.slow
@pytest.mark.parametrize("how", ["gone", "left"])
@pytest.mark.parametrize(("first", "requests"), [(0.5, 1), (0.5, 2), (0.5, 5), (2.6, 1)])
def test_a_car_whose_page_has_left_is_not_armed(first, requests, how):
    """A second click on Arm armed it again, and one that was just armed stayed so for ever."""
    left, seat = leave_during(first, ENDS_OF_DRIVING[how], requests)
    assert {mode for t, mode in seat.modes if t > left + REPORTED_END_S} == {"DISARMED"}
    assert ("ARMED" in {mode for t, mode in seat.modes if t < left}) == (first > 2.5)
    seat.send_message("two", m.Take("right"))
    seat.watch()
    seat.drive(1.0, lambda t: seat.hold("two"))
    assert seat.driving(0.0) == [], "the next page drives without arming"


@pytest.mark.slow
def test_a_page_that_sends_nothing_after_arming_loses_the_car():
    seat = AtTheDesk()
    seat.send_message("one", m.Take("right"))
    seat.send_message("one", m.Arm())
    modes = []
    seat.drive(6.0, lambda t: modes.append(seat.car.mode))
    assert "ARMED" in modes, "negative control"
    assert seat.car.mode == "DISARMED"
