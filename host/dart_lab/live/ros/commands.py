"""What a message does to the car: three numbers that may be missing, old or none at all.

The throttle is neutral unless ``safety_value`` says 1, throttle and steering are numbers of -1 to
1, and safety and throttle are both younger than ``HOLD``. Why it is neutral is said once, until
it has driven again.

A drive that ended because a publisher fell silent does not go on by itself when messages come
again: they may be old ones that the network held back (Float32 has no stamp). ``safety_value`` must
be 0 once, then 1.
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

HOLD = 0.3
"""s that ``safety_value`` and a throttle hold: upstream's time-out of the former. Its controllers
send a throttle at 10 Hz: two may be lost."""
GO = 1.0
SHUT = ("safety", "disarmed", "held", "stale")
"""Why no throttle would drive."""
RELEASE = "send safety_value 0, then 1"

steering_angle: Callable[[float], float] = make_steering(PAPER.steering)
"""Command to angle [rad] of upstream's car 1: the curve that its ``steering_angle_2_command``
inverts. So the angle that a controller asks for is the one this car gets, by its own map."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """steering [rad], throttle -1..1."""

    steering: float
    throttle: float


@dataclass(slots=True)
class _Heard:
    """The newest of one topic and its age; value None: it was none that can be meant."""

    value: float | None = 0.0
    age: InputAge = field(default_factory=lambda: InputAge(HOLD))

    @property
    def came(self) -> bool:
        """Whether anything has come at all."""
        return self.age.reported_at > -inf


class Commands:
    """Messages come in any thread, ``wanted`` is asked by the one that drives."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._safety, self._throttle, self._steering = _Heard(), _Heard(), _Heard()
        self._armed, self._held, self._stale = False, False, False
        self._angle, self._going, self._open = 0.0, False, False
        self._said: deque[str] = deque(maxlen=100)
        self._told: set[str] = set()

    def safety(self, value: float, now: float) -> None:
        """``safety_value``, of all cars: 1 go, 0 stand."""
        self._hear("safety_value", self._safety, value, now, value in (0.0, GO), "0 or 1")
        if value == 0.0:
            with self._lock:
                self._held = self._stale = False

    def throttle(self, value: float, now: float) -> None:
        """``throttle_N``: -1..1."""
        self._hear("throttle", self._throttle, value, now, -1.0 <= value <= 1.0, "-1 to 1")

    def steering(self, value: float, now: float) -> None:
        """``steering_N``: -1..1, +1 full left; holds until the next, as upstream's."""
        self._hear("steering", self._steering, value, now, -1.0 <= value <= 1.0, "-1 to 1")

    def armed(self) -> None:
        """The car has just been armed: a go that was there all along moves nothing until it has
        been let go of once."""
        with self._lock:
            self._armed = self._held = True

    def wanted(self, now: float) -> Wanted:
        """What the car is to do now."""
        with self._lock:
            if self._steering.value is not None and self._steering.came:
                self._angle = steering_angle(self._steering.value)
            why = self._why_not(now)
            self._notice(why, now)
            return Wanted(self._angle, 0.0 if why else self._throttle.value or 0.0)

    def logged(self, now: float) -> tuple[float, float, float]:
        """Safety, throttle, steering as upstream reports them: whether a throttle is obeyed, and
        what was sent."""
        with self._lock:
            shut = self._why_not(now) in SHUT
            return (0.0 if shut else GO, self._throttle.value or 0.0, self._steering.value or 0.0)

    def said(self) -> list[str]:
        """Sentences since the last call."""
        with self._lock:
            told = list(self._said)
            self._said.clear()
            return told

    def _hear(self, topic: str, heard: _Heard, value: float, now: float, good: bool,
              expected: str) -> None:
        with self._lock:
            heard.value = value if good else None
            heard.age.report(now)
            if not good:
                self._say(topic, f"{topic} was {value:g}, expected {expected}: neutral")

    def _why_not(self, now: float) -> str:
        """Why the throttle is neutral; "": it drives."""
        if self._safety.value != GO or self._safety.age.is_over(now):
            return "safety"
        if not self._armed:
            return "disarmed"
        if self._held:
            return "held"
        if self._stale:
            return "stale"
        if self._throttle.value is None or self._steering.value is None:
            return "no number"
        return "throttle" if self._throttle.age.is_over(now) else ""

    def _notice(self, why: str, now: float) -> None:
        """Say a silence that ended a drive, and a go that was there before."""
        if why == "safety":
            self._held = False
        if not why:
            self._told.clear()
        elif why == "held":
            self._say(why, "safety_value was 1 while the car was armed: send 0, or nothing for "
                           f"{HOLD} s, then 1")
        elif self._open and self._safety.value == GO and self._safety.age.is_over(now):
            self._refuse("safety_value")
        elif self._going and self._throttle.value and self._throttle.age.is_over(now):
            self._refuse("throttle")
        self._going = not why
        self._open = why in ("", "no number", "throttle")

    def _refuse(self, topic: str) -> None:
        """Keep the throttle neutral until safety_value was 0."""
        self._stale = True
        self._say(topic, f"{topic} has been silent for {HOLD} s: neutral; to drive again {RELEASE}")

    def _say(self, what: str, text: str) -> None:
        if what not in self._told:
            self._told.add(what)
            self._said.append(text)
