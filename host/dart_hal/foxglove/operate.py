"""Driving by what a client publishes: one operator at a time, stopped when it falls silent.

A message of Foxglove's has no stamp. But a client that has answered a ping of ours sent whatever
comes behind the answer later than we sent the ping: that time is taken off how long a command
holds, as the live page's is.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from math import atan2, copysign, inf, isfinite
from typing import Any, Protocol

from dart_hal.errors import DartHalError
from dart_hal.foxglove.protocol import Malformed
from dart_hal.types import Applied

TWIST, COMMAND = "/cmd_vel", "/drive_command"
"""Topics: geometry_msgs/Twist as of a Teleop panel, and {"steering": rad, "throttle": -1..1}."""
HOLD = 0.2
"""s from the ping that a client has answered to the end of its command: silence is neutral at the
pin within this and a PWM frame, below 0.25 s. A panel has to publish 10 times a second."""
SOURCE = "foxglove"


class Drives(Protocol):
    """What an operator needs of a ``Car``."""

    def drive(self, *, steering: float, throttle: float, valid_for: float, source: str
              ) -> Applied: ...
    def drive_speed(self, *, steering: float, speed: float, valid_for: float, source: str
                    ) -> Applied: ...
    def stop(self) -> Applied: ...


class Operator:
    """``wheelbase`` [m]: what turns a yaw rate into an angle; clock [s]: by which commands age.
    The car is stopped, and with that disarmed, when whoever operated it goes or falls silent."""

    def __init__(self, car: Drives, wheelbase: float,
                 clock: Callable[[], float] = time.monotonic) -> None:
        self._car, self._wheelbase, self._clock = car, wheelbase, clock
        self._who: object | None = None
        self._topics: dict[object, str] = {}
        self._until = inf
        self.over = ""
        """Why a drive ended, the last one: gone, silent; "": none did."""

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
            self._who = None
            self._topics.clear()
            self._end("gone")

    def publish(self, who: object, channel: object, value: object, heard: float) -> None:
        """A command of a client that had heard us say ``heard`` [s] before it sent this.

        Raises Malformed with what is wrong with it, or with the car.
        """
        now = self._clock()
        if who is not self._who or channel not in self._topics:
            raise Malformed("a command on a channel that was not advertised")
        if not 0.0 <= now - heard < HOLD:
            raise Malformed(f"a command that may be {1e3 * (now - heard):.0f} ms old, at most "
                            f"{1e3 * HOLD:.0f} are obeyed")
        fields = value if isinstance(value, dict) else {}
        try:
            applied = self._command(self._topics[channel], fields, heard + HOLD - now)
        except DartHalError as error:
            raise Malformed(str(error)) from error
        if "NOT_ARMED" in map(str, applied.limited):
            raise Malformed("the car is not armed; that is done by hand, where it was started")
        self._until = heard + HOLD

    def silent(self) -> object | None:
        """The client whose drive is over now because it published nothing more; None: none is."""
        if self._clock() < self._until:
            return None
        self._end("silent")
        return self._who

    def _end(self, why: str) -> None:
        self._until, self.over = inf, why
        self._car.stop()

    def _command(self, topic: str, fields: Mapping[str, Any], left: float) -> Applied:
        """Hold this for ``left`` s."""
        if topic == COMMAND:
            return self._car.drive(steering=_number(fields, "steering"),
                                   throttle=_number(fields, "throttle"), valid_for=left,
                                   source=SOURCE)
        speed = _number(fields.get("linear"), "x")
        steering = self._angle(speed, _number(fields.get("angular"), "z"))
        return self._car.drive_speed(steering=steering, speed=speed, valid_for=left,
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
