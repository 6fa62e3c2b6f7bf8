"""Driving by what a client publishes: one operator at a time, neutral when it falls silent."""

from __future__ import annotations

from collections.abc import Mapping
from math import atan2, copysign, isfinite
from typing import Any, Protocol

from dart_hal.errors import DartHalError
from dart_hal.foxglove.protocol import Malformed
from dart_hal.types import Applied

TWIST, COMMAND = "/cmd_vel", "/drive_command"
"""Topics: geometry_msgs/Twist as of a Teleop panel, and {"steering": rad, "throttle": -1..1}."""
VALID_FOR = 0.2
"""s that a command holds: silence is neutral at the pin within this and a PWM frame, below 0.25 s.
A panel has to publish 10 times a second."""
SOURCE = "foxglove"


class Drives(Protocol):
    """What an operator needs of a ``Car``."""

    def drive(self, *, steering: float, throttle: float, valid_for: float, source: str
              ) -> Applied: ...
    def drive_speed(self, *, steering: float, speed: float, valid_for: float, source: str
                    ) -> Applied: ...
    def stop(self) -> Applied: ...


class Operator:
    """``wheelbase`` [m]: what turns a yaw rate into an angle. The car is stopped, and with that
    disarmed, when whoever operated it goes."""

    def __init__(self, car: Drives, wheelbase: float) -> None:
        self._car, self._wheelbase = car, wheelbase
        self._who: object | None = None
        self._topics: dict[object, str] = {}
        self.gone = False
        """Whether somebody has operated the car and has left it."""

    def advertise(self, who: object, channel: object, topic: object) -> None:
        """A client means to publish: it has the car from now on. Raises Malformed."""
        if topic not in (TWIST, COMMAND):
            raise Malformed(f"nobody listens to {topic}; {TWIST} and {COMMAND} drive")
        if self._who not in (None, who):
            raise Malformed("another client operates this car")
        self._who = who
        self._topics[channel] = str(topic)

    def unadvertise(self, who: object, channel: object) -> None:
        """The last channel that goes stops the car."""
        if who is self._who and channel in self._topics:
            del self._topics[channel]
            if not self._topics:
                self.leave(who)

    def leave(self, who: object) -> None:
        """A client has gone."""
        if who is self._who:
            self._who, self.gone = None, True
            self._topics.clear()
            self._car.stop()

    def publish(self, who: object, channel: object, value: object) -> None:
        """A command. Raises Malformed with what is wrong with it, or with the car."""
        if who is not self._who or channel not in self._topics:
            raise Malformed("a command on a channel that was not advertised")
        fields = value if isinstance(value, dict) else {}
        try:
            applied = self._command(self._topics[channel], fields)
        except DartHalError as error:
            raise Malformed(str(error)) from error
        if "NOT_ARMED" in map(str, applied.limited):
            raise Malformed("the car is not armed; that is done by hand, where it was started")

    def _command(self, topic: str, fields: Mapping[str, Any]) -> Applied:
        if topic == COMMAND:
            return self._car.drive(steering=_number(fields, "steering"),
                                   throttle=_number(fields, "throttle"), valid_for=VALID_FOR,
                                   source=SOURCE)
        speed = _number(fields.get("linear"), "x")
        steering = self._angle(speed, _number(fields.get("angular"), "z"))
        return self._car.drive_speed(steering=steering, speed=speed, valid_for=VALID_FOR,
                                     source=SOURCE)

    def _angle(self, speed: float, yaw_rate: float) -> float:
        """Of the front wheels [rad]; at rest those of a turn as tight as can be."""
        return copysign(1.0, speed) * atan2(self._wheelbase * yaw_rate, abs(speed))


def _number(fields: object, name: str) -> float:
    value = fields.get(name) if isinstance(fields, Mapping) else None
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise Malformed(f"{name} is no number: {value!r}"[:200])
    try:
        number = float(value)
    except OverflowError as error:
        raise Malformed(f"{name} is too large") from error
    if not isfinite(number):
        raise Malformed(f"{name} is {number}")
    return number
