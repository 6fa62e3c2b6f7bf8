"""Where one PWM frame wants the pins: pure, nothing here touches a bus.

Order: expiry and priority, range, slew, steering map inverted, pulse in us.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dart_hal.actuation.limits import Arbiter, Command, clip, slew
from dart_hal.actuation.steering_map import SteeringMap, throttle_pulse
from dart_hal.config import CarConfig
from dart_hal.types import Limit

PIN_LOW_US, PIN_HIGH_US = 750.0, 2250.0
"""No pulse outside these leaves the house: ServoKit's own range."""

LONGEST_STEP = 0.1
"""s of slew that one frame may catch up after a pause."""


@dataclass(frozen=True, slots=True)
class Output:
    """What the supervisor lets the pins carry.

    throttle: "neutral", "command", "raw", "untouched"; steering: "centre",
    "held", "command", "raw", "untouched". ``why`` enters ``Applied.limited``.
    """

    throttle: str = "neutral"
    steering: str = "centre"
    why: tuple[str, ...] = (Limit.NOT_ARMED.value,)


LIVE = Output("command", "command", ())
RAW = Output("raw", "raw", ())


@dataclass(frozen=True, slots=True)
class Plan:
    """Pulses [us] before counts; ``moving`` False: the throttle stands at neutral."""

    steering_us: float
    throttle_us: float
    angle: float
    throttle: float
    moving: bool
    limited: tuple[str, ...]


class Planner:
    """Turns what sources want into what the next frame carries.

    ``angle``, ``throttle``: where the last frame was, the start of slew limits.
    ``latched``: tripped; neutral until the supervisor leaves "command".
    """

    def __init__(self, car: CarConfig, steering: SteeringMap, neutral_us: float,
                 frame: float) -> None:
        self.output = Output()
        self.arbiter = Arbiter(car.priorities.sources)
        self.raw: tuple[float, float] | None = None
        self.throttle_cap: float | None = None
        self.latched = False
        self.angle, self.throttle = 0.0, 0.0
        self.last = -math.inf
        self._car, self._map = car, steering
        self._neutral_us, self._frame = neutral_us, frame

    def set_output(self, output: Output) -> None:
        """What is allowed from now on; leaving a mode forgets what it was told."""
        if output.throttle != self.output.throttle:
            self.arbiter.clear()
            self.raw = None
        if output.throttle not in ("command", "raw"):
            self.latched = False
        self.output = output

    def latch(self) -> None:
        """Something tripped: every standing command is void."""
        self.latched = self.output.throttle in ("command", "raw")
        self.forget()

    def forget(self) -> None:
        """No source wants anything."""
        self.arbiter.clear()
        self.raw = None

    def plan(self, now: float, source: str | None = None) -> Plan:
        """The frame at ``now``, and why it is not what ``source`` asked for."""
        why = [*self.output.why]
        if self.latched:
            why.append(Limit.NOT_ARMED.value)
            return self.neutral(self.angle, tuple(why))
        if self.output.throttle == "raw":
            return self._raw_plan(tuple(why))
        winner = self.arbiter.winner(now)
        if winner and source and winner.source != source:
            why.append(f"OVERRIDDEN({winner.source})")
        if self.output.throttle == "command" and winner is None and self.arbiter.lapsed:
            why.append(Limit.EXPIRED.value)
        passed = now - self.last if math.isfinite(self.last) else self._frame
        return self._limited(winner, min(max(passed, self._frame), LONGEST_STEP), why)

    def neutral(self, angle: float, why: tuple[str, ...]) -> Plan:
        """Throttle neutral, steering at ``angle``, at once."""
        return self._as_plan(clip(angle, self._map.lowest, self._map.highest), 0.0, why)

    def stopped(self, why: tuple[str, ...]) -> Plan:
        """Throttle to neutral, by car.toml's stop_ramp if it has one; steering held."""
        return self._as_plan(self.angle, self._ramped(self._frame), why)

    def _limited(self, winner: Command | None, dt: float, why: list[str]) -> Plan:
        limits, live = self._car.limits, self.output.throttle == "command"
        wanted = winner.throttle if winner and live else 0.0
        cap = 1.0 if self.throttle_cap is None else self.throttle_cap
        throttle = clip(wanted, max(limits.min_throttle, -cap), min(limits.max_throttle, cap))
        angle = self._wanted_angle(winner)
        bounded = clip(angle, max(-limits.max_steering, self._map.lowest),
                       min(limits.max_steering, self._map.highest))
        turned = slew(bounded, self.angle, limits.steering_slew, dt)
        driven = (slew(throttle, self.throttle, limits.throttle_slew, dt) if winner and live
                  else self._ramped(dt))
        if (throttle, bounded) != (wanted, angle):
            why.append(Limit.RANGE.value)
        if (turned, driven) != (bounded, throttle):
            why.append(Limit.SLEW.value)
        return self._as_plan(turned, driven, tuple(why))

    def _wanted_angle(self, winner: Command | None) -> float:
        mode = self.output.steering
        if mode == "centre":
            return 0.0
        return winner.steering if winner and mode == "command" else self.angle

    def _ramped(self, dt: float) -> float:
        ramp = self._car.throttle.stop_ramp
        return slew(0.0, self.throttle, 1.0 / ramp if ramp > 0 else None, dt)

    def _raw_plan(self, why: tuple[str, ...]) -> Plan:
        if self.raw is None:
            return self.neutral(0.0, why)
        steering_us, throttle_us = self.raw
        throttle = (throttle_us - self._neutral_us) / self._car.throttle.span_us
        return Plan(steering_us, throttle_us, self._map.angle(steering_us), throttle, True, why)

    def _as_plan(self, angle: float, throttle: float, why: tuple[str, ...]) -> Plan:
        pulse = throttle_pulse(throttle, self._neutral_us, self._car.throttle.span_us)
        return Plan(clip(self._map.pulse(angle), PIN_LOW_US, PIN_HIGH_US),
                    clip(pulse, PIN_LOW_US, PIN_HIGH_US), angle, throttle, throttle != 0.0, why)
