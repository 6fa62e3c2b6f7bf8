"""Stop all cars of a room: measured at the pins of their ESCs, with loss on the way."""

from __future__ import annotations

import pytest

from dart_hal.car import Car, Member
from dart_hal.car.driver import Driver
from dart_hal.core.errors import Disarmed, NotArmed, UsageError
from dart_hal.fleet import messages as m
from dart_hal.fleet.codec import encode
from dart_hal.fleet.station import Station
from dart_hal.fleet.stopping import MAX_STOP_TIME, STOP_HOLD_TIME, StopCall, StopRule
from tests.fleet.rooms import FleetPins, pose_frame

pytestmark = pytest.mark.usefixtures("armed_esc")

HALF_LOST = "local://stop?loss=0.5&seed={}"
PIN_DELAY_S = 0.15
"""s: ten STOPs in a row are lost one time in a thousand, 100 ms; and as without loss."""
BEAT_PERIOD_S = 0.050
"""s without loss: the States of two cars differ by up to 10 ms, one State, one PWM frame."""


def stop_one_by_another(room):
    """s from the stop, called by the first car, to the last driving pulse of each."""
    with FleetPins(room) as pins:
        pins.fleet.arm()
        pins.drive(0.5)
        called = pins.now()
        assert all(pins.driving(n, t - 0.1) for n, t in enumerate(called)), "both drive"
        call = pins.fleet.members[0].stop_all("test")
        refused = pins.drive(0.6, only=[1])
        return [pins.last_driving(n, t) for n, t in enumerate(called)], call, refused, pins


def test_all_stop_at_once():
    lasts, call, refused, pins = stop_one_by_another("local://stop")
    assert max(lasts) <= BEAT_PERIOD_S
    assert call.silent == set()
    assert refused > 50, "the program that drives on gets errors"
    assert pins.fleet.cars[1].causes == ("RUN_STOP",)


@pytest.mark.slow
def test_all_stop_at_a_loss_of_one_half():
    lasts = [stop_one_by_another(HALF_LOST.format(seed))[0][1] for seed in range(24)]
    assert max(lasts) <= PIN_DELAY_S, lasts
    assert max(lasts) > BEAT_PERIOD_S, "control: some were lost on the way"


@pytest.mark.slow
def test_stop_at_a_loss_of_one_half_once():
    lasts, call, _, _ = stop_one_by_another(HALF_LOST.format(5))
    assert 0.0 < max(lasts) <= PIN_DELAY_S
    assert call.silent == set()


def test_a_car_that_does_not_hear_drives_on(monkeypatch):
    """Control: without the rule the stop changes nothing."""
    monkeypatch.setattr(StopRule, "stop", lambda self, number, who, why, now: None)
    assert stop_one_by_another("local://stop")[0][1] > 0.5


@pytest.mark.slow
def test_a_trip_that_is_not_carried_out_is_detected(monkeypatch):
    """Control: the car knows that it is stopped, and the pin does not."""
    monkeypatch.setattr(Driver, "set_run_stop", lambda self, *given: None)
    assert stop_one_by_another("local://stop")[0][1] > 0.5


@pytest.mark.slow
def test_a_stop_that_is_sent_once_is_not_enough_at_half_loss(monkeypatch):
    """Control: it is the repeating that reaches everybody."""
    monkeypatch.setattr(Member, "_repeat", lambda self, now: None)
    pulses = []

    def once(self, why=""):
        self.car.stop()
        self._call = StopCall(1, why, [], self.car.now)
        self._send(m.STOP, (1, why), self.car.now)
        return self._call

    monkeypatch.setattr(Member, "stop_all", once)
    for seed in range(6):
        pulses.append(stop_one_by_another(HALF_LOST.format(seed))[0][1])
    assert max(pulses) > 0.5


@pytest.mark.slow
def test_a_program_may_arm_again_when_the_stop_is_over():
    with FleetPins("local://again") as pins:
        pins.fleet.arm()
        pins.drive(0.2)
        pins.fleet.stop("lunch")
        with pytest.raises(NotArmed) as caught:
            pins.fleet.arm()
        assert "RUN_STOP" in caught.value.reasons
        assert "lunch" in pins.fleet.members[1].held
        for _ in pins.fleet.states(duration=2.0 * STOP_HOLD_TIME + MAX_STOP_TIME):
            pass
        assert [member.held for member in pins.fleet.members] == ["", ""]
        pins.fleet.arm()
        begin = pins.now()
        pins.drive(0.3)
        assert all(pins.driving(n, t) for n, t in enumerate(begin)), "control: the pin is observed"


def drive_watched(beating, *, hears=True):
    """Pulses of two cars that may drive only while a station beats; at the times ``beating``(t)."""
    pins = FleetPins("local://watched", beat_within=0.3)
    clock = pins.fleet.cars[0]
    station = Station("local://watched", "base", now=lambda: clock.now)
    with pins, station:
        def each():
            if beating(clock.now - begin[0]):
                station.watch()
        begin = [clock.now]
        for _ in pins.fleet.states(duration=0.5):
            station.watch()
        begin = [clock.now]
        steps = [car.arming() for car in pins.fleet.cars]
        while steps:
            steps = [s for s in steps if next(s, None) is not None]
            station.watch()
        begin = [clock.now]
        begun = pins.now()
        pins.drive(1.2, each=each)
        return [pins.last_driving(n, t) for n, t in enumerate(begun)], pins


@pytest.mark.slow
def test_cars_stop_without_a_watcher():
    lasts, pins = drive_watched(lambda t: t < 0.5)
    assert all(0.5 < last <= 0.5 + 0.3 + 0.05 for last in lasts), lasts
    assert "watched" in pins.fleet.members[0].held


@pytest.mark.slow
def test_while_somebody_watches_they_drive():
    """Control: of the silence and of the pin."""
    lasts, _ = drive_watched(lambda t: True)
    assert min(lasts) > 1.1


@pytest.mark.parametrize("age", [float("nan"), 0.0, -1.0, "x", True, None])
def test_an_age_of_the_beat_that_is_none_is_refused(age):
    with pytest.raises(UsageError, match="beat_within is no time"):
        StopRule(age)


@pytest.mark.slow
def test_a_rule_that_forgets_the_silence_is_detected(monkeypatch):
    """Control: broken code."""
    held = StopRule.drive_block
    monkeypatch.setattr(StopRule, "drive_block", lambda self, now: held(self, min(now, self._beat)))
    lasts, _ = drive_watched(lambda t: t < 0.5)
    assert min(lasts) > 1.1


@pytest.mark.slow
def test_without_a_watcher_no_car_arms():
    with (FleetPins("local://alone", beat_within=0.3) as pins,
          pytest.raises(NotArmed) as caught):
        pins.fleet.arm()
    assert "RUN_STOP" in caught.value.reasons


def test_nothing_that_comes_from_the_room_arms_or_drives():
    """Every kind of message, in turn and in every state, at 100 Hz: the ESC sees neutral."""
    with FleetPins("local://quiet", seeds=(1,)) as pins:
        line = Station("local://quiet").transport
        caught = {m.PLAN: ("red", 0.0, "start", 0.05, ((1.0, 0.0, 0.0, 3.0),) * 9),
                  m.HEALTH: ("red", "ARMED", 0, "", ""), m.BEAT: ("red",),
                  m.STOPPED: ("red", 1), m.STOP: ("red", 1, "")}
        for k, _ in enumerate(pins.fleet.states(duration=1.5)):
            kind = list(caught)[k % (5 if k > 100 else 4)]
            line.send(encode(kind, 9, 2 * k, 0.0, caught[kind]), 0.0)
            line.send(pose_frame(2 * k + 1, boot=9, speed=3.0, name="red"), 0.0)
        assert pins.fleet.cars[0].mode == "DISARMED"
        assert "red" in pins.fleet.members[0].other_poses()
        assert pins.driving(0, 0.0) == []


@pytest.mark.slow
def test_a_car_whose_loop_goes_on_gets_an_error():
    with FleetPins("local://told", seeds=(1, 2)) as pins:
        pins.fleet.arm()
        pins.drive(0.2)
        pins.fleet.members[0].stop_all()
        pins.drive(0.1, only=[])
        with pytest.raises(Disarmed) as caught:
            pins.fleet.cars[1].drive(throttle=0.2)
        assert caught.value.causes == ("RUN_STOP",)


def test_a_run_stop_is_a_call_of_the_car():
    with Car.open("sim://?nano=mock&seed=1") as car:
        car.run_stop(True)
        with pytest.raises(NotArmed):
            car.arm()
        car.run_stop(False)
        car.arm()
        assert car.mode == "ARMED"


@pytest.mark.slow
def test_a_room_lets_go_of_its_own_stop_alone():
    """The program's is held on while a stop of the room comes and ends; and the other way round."""
    with FleetPins("local://both", seeds=(1, 2)) as pins:
        car = pins.fleet.cars[0]
        member = pins.fleet.members[0]
        car.run_stop(True)
        pins.fleet.members[1].stop_all("room")
        for _ in pins.fleet.states(duration=1.0 + STOP_HOLD_TIME):
            pass
        assert member.rule.number, "it has heard"
        assert member.held == ""
        with pytest.raises(NotArmed) as caught:
            pins.fleet.arm()
        assert "RUN_STOP" in caught.value.reasons
        assert pins.driving(0, 0.0) == []
        car.run_stop(False)
        for _ in pins.fleet.states(duration=2.0 * STOP_HOLD_TIME + MAX_STOP_TIME):
            pass  # what did not arm together was stopped
        pins.fleet.arm()
        assert car.mode == "ARMED"
