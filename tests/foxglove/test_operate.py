"""Driving by publishing: what reaches the car, who may, and the pin when the operator is gone."""

from __future__ import annotations

import socket
import time
from math import atan, inf, nan

import pytest

from dart_hal.errors import BadCommand
from dart_hal.foxglove.operate import COMMAND, HOLD, TWIST, Operator
from dart_hal.foxglove.protocol import Malformed
from dart_hal.sim.truth import world_of
from dart_hal.types import Applied

NEAR_US = 5.0


class Toy:
    """Notes what it was told."""

    def __init__(self):
        self.told, self.limited = [], ()

    def drive(self, **command):
        self.told.append(command)
        return Applied(0.0, 0.0, 1500.0, 1500.0, self.limited)

    drive_speed = drive

    def stop(self):
        self.told.append("stop")


@pytest.fixture
def car():
    return Toy()


@pytest.fixture
def operated(car):
    """Somebody's, who has just answered; channel 1 is COMMAND, 2 TWIST."""
    operator = Operator(car, wheelbase=0.175, clock=lambda: 5.0)
    operator.advertise("me", 1, COMMAND)
    operator.advertise("me", 2, TWIST)
    return operator


def twist(speed, yaw_rate):
    return {"linear": {"x": speed, "y": 0, "z": 0}, "angular": {"x": 0, "y": 0, "z": yaw_rate}}


def test_commands_reach_the_car_for_what_their_age_leaves_of_a_fifth_of_a_second(car, operated):
    operated.publish("me", 1, {"steering": 0.1, "throttle": 0.2}, 4.95)
    operated.publish("me", 2, twist(1, 2.0), 4.95)
    operated.publish("me", 2, twist(-1.0, 2.0), 4.95)
    kept = {"valid_for": pytest.approx(HOLD - 0.05), "source": "foxglove"}
    assert car.told == [
        {"steering": 0.1, "throttle": 0.2, **kept},
        {"steering": pytest.approx(atan(0.35)), "speed": 1.0, **kept},
        {"steering": pytest.approx(-atan(0.35)), "speed": -1.0, **kept}]


@pytest.mark.parametrize("value", [
    None, [], "x", {}, {"steering": 0.1}, {"steering": "0.1", "throttle": 0},
    {"steering": nan, "throttle": 0}, {"steering": 0, "throttle": inf},
    {"steering": True, "throttle": 0}, {"steering": 10**400, "throttle": 0}])
def test_what_is_no_command_moves_nothing(car, operated, value):
    with pytest.raises(Malformed):
        operated.publish("me", 1, value, 5.0)
    assert car.told == []


@pytest.mark.parametrize("heard", [-inf, 5.0 - HOLD, 5.1])
def test_a_command_that_may_be_too_old_moves_nothing(car, operated, heard):
    with pytest.raises(Malformed, match="ms old"):
        operated.publish("me", 1, {"steering": 0.0, "throttle": 0.2}, heard)
    assert car.told == []


@pytest.mark.parametrize("value", [{"linear": 1, "angular": {"z": 0}}, {"linear": {"x": 1}},
                                   twist(nan, 0.0), twist(1.0, None)])
def test_a_twist_that_lacks_something_moves_nothing(car, operated, value):
    with pytest.raises(Malformed):
        operated.publish("me", 2, value, 5.0)
    assert car.told == []


def test_one_operates_at_a_time_and_the_car_stops_when_he_goes(car):
    operator = Operator(car, 0.175)
    operator.advertise("me", 1, COMMAND)
    with pytest.raises(Malformed, match="another client"):
        operator.advertise("you", 1, COMMAND)
    with pytest.raises(Malformed, match="not advertised"):
        operator.publish("you", 1, {"steering": 0.0, "throttle": 0.3}, time.monotonic())
    operator.leave("you")
    assert car.told == []
    assert operator.over == ""
    operator.unadvertise("me", 1)
    assert car.told == ["stop"]
    assert operator.over == "gone"
    operator.advertise("you", 1, COMMAND)


def test_what_nobody_listens_to_is_refused(car):
    with pytest.raises(Malformed, match="/cmd_vel and /drive_command drive"):
        Operator(car, 0.175).advertise("me", 1, "/brake")


def test_why_the_car_does_not_take_it_is_told(car, operated, monkeypatch):
    def refuse(**_):
        raise BadCommand("the throttle is no number", found="x")

    monkeypatch.setattr(car, "drive", refuse)
    with pytest.raises(Malformed, match="no number"):
        operated.publish("me", 1, {"steering": 0.0, "throttle": 0.3}, 5.0)


def test_that_the_car_is_not_armed_is_told(car, operated):
    car.limited = ("NOT_ARMED",)
    with pytest.raises(Malformed, match="not armed"):
        operated.publish("me", 1, {"steering": 0.0, "throttle": 0.3}, 5.0)


class Pin:
    """When the ESC's pin last carried anything but neutral, on the car's clock."""

    def __init__(self, car):
        self.driving = -inf
        self.world = world_of(car._engine.backend)
        self.world.watchers.append(self)

    def __call__(self, channel, pulse):
        rise, fall = pulse
        if channel == 1 and abs((fall - rise) * 1e6 - 1500.0) > NEAR_US:
            self.driving = fall


def driven_by(client, pin, seconds):
    client.advertise(c1=COMMAND)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        client.publish(1, {"steering": 0.1, "throttle": 0.2})
        client.hear(0.05)
    assert pin.world.t - pin.driving < 0.1, "it drives"


@pytest.mark.realtime
@pytest.mark.more
@pytest.mark.parametrize("way", ["silent", "killed", "left"])
def test_the_pin_is_neutral_a_quarter_of_a_second_after_the_operator(serving, way):
    with serving(operate=True, arm=True) as driven:
        pin = Pin(driven.car)
        with driven.client() as client:
            assert client.info["capabilities"] == ["clientPublish"]
            driven_by(client, pin, 0.5)
            last = pin.world.t
            if way == "killed":
                client.socket.socket.shutdown(socket.SHUT_RDWR)
            elif way == "left":
                client.send(op="unadvertise", channelIds=[1])
            time.sleep(0.5)
            assert pin.driving - last < 0.25 + 0.02
            assert driven.car.mode != "ARMED"
            assert driven.server.operator.over == ("silent" if way == "silent" else "gone")
            if way == "silent":
                assert "no command came for 0.2 s" in client.last_said()
        with driven.client() as again:
            again.advertise(c1=COMMAND)
            again.publish(1, {"steering": 0.0, "throttle": 0.3})
            assert "not armed" in again.last_said()
            time.sleep(0.2)
        assert pin.driving - last < 0.25 + 0.02, "it is armed by hand alone"
