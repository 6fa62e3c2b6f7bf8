"""What the ESC gets while ROS drives, in virtual time: silence, numbers that are none, go and stop.
"""

from __future__ import annotations

from math import nan

import pytest
from toy_ros import BridgedCar

from dart_hal.core.errors import Disarmed
from dart_lab.live.ros import commands
from dart_lab.live.ros.commands import MAX_MESSAGE_AGE_S, Commands

LAST = 1.2
"""s since it was armed: the last message, or the first bad one."""
NEUTRAL_WITHIN_S = 0.5
"""s from then to the end of the last driving pulse."""
ONE_FRAME = 0.05


def drive(each, number=1, while_arming=lambda car: None):
    """A car that is commanded to go and to drive at 10 Hz from 0.2 s on; then ``each(car, t)``."""
    with BridgedCar(number=number) as car:
        def step(t):
            if 0.2 < t < LAST and round(100 * t) % 10 == 0:
                car.ros.publish_value("safety_value", 1.0)
                car.ros.publish_value(f"throttle_{number}", 0.25)
            each(car, t)

        car.run(LAST + 1.0, step, lambda: while_arming(car))
        assert car.driving(LAST - 0.2, LAST), "it drove until then"
    return car


def keeps(topic, value):
    """Somebody goes on saying that, behind the last of the other messages."""
    def each(car, t):
        if t >= LAST and round(100 * t) % 10 == 0:
            car.ros.publish_value(topic, value)
    return each


WITHOUT_SAFETY = keeps("throttle_1", 0.25)
WITHOUT_THROTTLE = keeps("safety_value", 1.0)


@pytest.mark.slow_except("safety")
@pytest.mark.parametrize("each", [WITHOUT_SAFETY, WITHOUT_THROTTLE], ids=["safety", "throttle"])
def test_silence_is_neutral_within_half_a_second(each):
    car = drive(each)
    assert 0.2 < car.last_driving() - LAST <= 0.4 < NEUTRAL_WITHIN_S
    assert len(car.warnings) == 1


@pytest.mark.slow
def test_a_bridge_that_hangs_just_before_the_silence_is_noticed():
    with BridgedCar() as car:
        def step(t):
            if 0.2 < t < LAST:
                car.ros.publish_value("safety_value", 1.0)
                car.ros.publish_value("throttle_1", 0.25)
            elif t > LAST + 0.28:
                for _ in car.car.states(duration=0.8):
                    pass

        with pytest.raises(Disarmed, match="trip"):
            car.run(LAST + 1.0, step)
        assert MAX_MESSAGE_AGE_S < car.last_driving() - LAST <= NEUTRAL_WITHIN_S


def test_control_a_longer_hold_shows_at_the_pin(monkeypatch):
    monkeypatch.setattr(commands, "MAX_MESSAGE_AGE_S", 0.7)
    assert drive(WITHOUT_SAFETY).last_driving() - LAST > NEUTRAL_WITHIN_S


def bad(topic, value):
    def each(car, t):
        if t < LAST:
            return
        for name, good in (("safety_value", 1.0), ("throttle_1", 0.25), (topic, value)):
            car.ros.publish_value(name, good)
    return each


BAD_VALUES = [("throttle_1", nan), ("throttle_1", 1.5), ("steering_1", nan), ("safety_value", 0.0),
              ("safety_value", 2.0)]


@pytest.mark.slow_except("throttle_1-nan")
@pytest.mark.parametrize("each", [bad(*case) for case in BAD_VALUES],
                         ids=[f"{topic}-{value}" for topic, value in BAD_VALUES])
def test_what_cannot_be_meant_is_neutral_at_once(each):
    car = drive(each)
    assert car.last_driving() - LAST <= ONE_FRAME
    assert len(car.warnings) <= 1


@pytest.mark.slow
def test_control_without_the_check_it_drives_on(monkeypatch):
    monkeypatch.setattr(Commands, "safety", lambda self, value, now: self._receive(
        "safety_value", self._safety, 1.0, now, True, ""))
    assert drive(bad("safety_value", 0.0)).last_driving() - LAST > NEUTRAL_WITHIN_S


def test_a_go_that_was_there_while_it_armed_moves_nothing():
    def go(car):
        car.ros.publish_value("safety_value", 1.0)
        car.ros.publish_value("throttle_1", 0.25)

    with BridgedCar() as car:
        car.run(0.6, lambda t: go(car), lambda: go(car))
        assert car.driving() == []
        assert len(car.warnings) == 1


@pytest.mark.slow
def test_control_without_that_rule_it_drives_off(monkeypatch):
    monkeypatch.setattr(Commands, "require_go", lambda self: setattr(self, "_armed", True))
    with pytest.raises(AssertionError):
        test_a_go_that_was_there_while_it_armed_moves_nothing()


@pytest.mark.slow
def test_a_trip_ends_the_bridge():
    """It is armed again by hand, where it was started."""
    with pytest.raises(Disarmed):
        drive(lambda car, t: car.car.run_stop(True) if t > LAST - 0.1 else None)


@pytest.mark.slow
def test_a_node_that_is_interrupted_leaves_the_car_stopped():
    def each(car, t):
        if t > LAST:
            car.ros.close()

    car = drive(each)
    assert car.last_driving() - LAST <= ONE_FRAME
    assert car.car.mode != "ARMED"
