"""Turn the messages of three topics into commands: values may be missing, old or invalid.

The throttle is neutral unless

1. ``safety_value`` is 1,
2. throttle and steering are numbers from -1 to 1,
3. safety and throttle are younger than MAX_MESSAGE_AGE_S.

The reason for neutral is reported once, until the car has driven again.

A drive that ended because a publisher fell silent does not continue by itself when messages arrive
again: they may be old ones that the network delayed (Float32 has no time stamp). ``safety_value``
must be 0 once, then 1.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf

from dart_hal.control.input_age import InputAge
from dart_hal.vehicle.sets import PAPER
from dart_hal.vehicle.steering import make_steering

# Age up to which ``safety_value`` and a throttle are valid: the time-out of the former in DART's
# software. Its controllers send a throttle at 10 Hz, so two may be lost.
MAX_MESSAGE_AGE_S = 0.3
SAFETY_GO = 1.0
# Reasons for neutral for which no throttle value would drive the car.
SAFETY_REASONS = ("safety", "disarmed", "held", "stale")
RELEASE = "send safety_value 0, then 1"

# Steering command to angle [rad] of DART's car 1: the curve that ``steering_angle_2_command`` of
# DART's software inverts. So this car steers by the angle that the controller computed.
steering_angle: Callable[[float], float] = make_steering(PAPER.steering)


@dataclass(frozen=True, slots=True)
class RosCommand:
    """Command for the car: steering [rad], throttle -1..1."""

    steering: float
    throttle: float


@dataclass(slots=True)
class _TopicValue:
    """The newest value of a topic and its age; None: the value was invalid."""

    value: float | None = 0.0
    age: InputAge = field(default_factory=lambda: InputAge(MAX_MESSAGE_AGE_S))

    @property
    def is_received(self) -> bool:
        """Whether any message was received."""
        return self.age.reported_at > -inf


class Commands:
    """Messages arrive in any thread; ``current_command`` is called in the thread that drives."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._safety = _TopicValue()
        self._throttle = _TopicValue()
        self._steering = _TopicValue()
        self._armed = False
        # safety_value was 1 when the car was armed: it must be 0 once.
        self._needs_release = False
        # A publisher fell silent during a drive: safety_value must be 0 once.
        self._stale = False
        self._angle = 0.0
        self._was_driving = False
        self._was_go = False
        self._reports: deque[str] = deque(maxlen=100)
        self._reported: set[str] = set()

    def safety(self, value: float, now: float) -> None:
        """Receive ``safety_value``, common to all cars: 1 go, 0 stop."""
        self._receive("safety_value", self._safety, value, now, value in (0.0, SAFETY_GO), "0 or 1")
        if value == 0.0:
            with self._lock:
                self._needs_release = self._stale = False

    def throttle(self, value: float, now: float) -> None:
        """Receive ``throttle_N``: -1..1."""
        self._receive("throttle", self._throttle, value, now, -1.0 <= value <= 1.0, "-1 to 1")

    def steering(self, value: float, now: float) -> None:
        """Receive ``steering_N``: -1..1, +1 full left; valid until the next one."""
        self._receive("steering", self._steering, value, now, -1.0 <= value <= 1.0, "-1 to 1")

    def require_go(self) -> None:
        """Require a new go after arming: a ``safety_value`` of 1 that was sent before has no effect
        until it was 0 once."""
        with self._lock:
            self._armed = self._needs_release = True

    def current_command(self, now: float) -> RosCommand:
        """Return the command for the car now."""
        with self._lock:
            if self._steering.value is not None and self._steering.is_received:
                self._angle = steering_angle(self._steering.value)
            why = self._neutral_reason(now)
            self._update_drive(why, now)
            return RosCommand(self._angle, 0.0 if why else self._throttle.value or 0.0)

    def upstream_inputs(self, now: float) -> tuple[float, float, float]:
        """Return safety, throttle, steering as in DART's recordings: whether a throttle would act,
        and the values that were sent."""
        with self._lock:
            shut = self._neutral_reason(now) in SAFETY_REASONS
            return (0.0 if shut else SAFETY_GO, self._throttle.value or 0.0,
                    self._steering.value or 0.0)

    def take_reports(self) -> list[str]:
        """Return the notices since the last call."""
        with self._lock:
            reports = list(self._reports)
            self._reports.clear()
            return reports

    def _receive(self, topic: str, heard: _TopicValue, value: float, now: float, good: bool,
                 expected: str) -> None:
        with self._lock:
            heard.value = value if good else None
            heard.age.report(now)
            if not good:
                self._report(topic, f"{topic} was {value:g}, expected {expected}: neutral")

    def _neutral_reason(self, now: float) -> str:
        """Return why the throttle is neutral, "" if the car drives."""
        if self._safety.value != SAFETY_GO or self._safety.age.is_over(now):
            return "safety"
        if not self._armed:
            return "disarmed"
        if self._needs_release:
            return "held"
        if self._stale:
            return "stale"
        if self._throttle.value is None or self._steering.value is None:
            return "no number"
        return "throttle" if self._throttle.age.is_over(now) else ""

    def _update_drive(self, why: str, now: float) -> None:
        """Report a silence that ended a drive, and a go that was sent before arming."""
        if why == "safety":
            self._needs_release = False
        if not why:
            self._reported.clear()
        elif why == "held":
            self._report(why, "safety_value was 1 while the car was armed: send 0, or nothing for "
                              f"{MAX_MESSAGE_AGE_S} s, then 1")
        elif self._was_go and self._safety.value == SAFETY_GO and self._safety.age.is_over(now):
            self._refuse("safety_value")
        elif self._was_driving and self._throttle.value and self._throttle.age.is_over(now):
            self._refuse("throttle")
        self._was_driving = not why
        self._was_go = why in ("", "no number", "throttle")

    def _refuse(self, topic: str) -> None:
        """Keep the throttle neutral until safety_value was 0."""
        self._stale = True
        self._report(topic, f"{topic} has been silent for {MAX_MESSAGE_AGE_S} s: neutral; to "
                            f"drive again {RELEASE}")

    def _report(self, what: str, text: str) -> None:
        if what not in self._reported:
            self._reported.add(what)
            self._reports.append(text)
