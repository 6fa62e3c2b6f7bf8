"""Where one PWM frame wants the pins: pure, nothing here touches a bus.

Order: expiry and priority, range, slew, steering map inverted, pulse in us.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dart_hal.core.config import CarConfig
from dart_hal.core.types import Limit
from dart_hal.devices.actuation.limits import (
    RAW_HIGH_US,
    RAW_LOW_US,
    Arbiter,
    Command,
    Pulses,
    clip,
    slew,
)
from dart_hal.devices.actuation.play import Play
from dart_hal.devices.actuation.steering_map import SteeringMap, throttle_pulse

PIN_LOW_US, PIN_HIGH_US = 750.0, 2250.0
"""No pulse outside these leaves the house: ServoKit's own range."""

LONGEST_STEP = 0.1
"""s of slew that one frame may catch up after a pause."""


@dataclass(frozen=True, slots=True)
class Output:
    """What the supervisor's state demands of the pins.

    throttle: "neutral", "command", "raw", "untouched", "off"; steering: "centre",
    "held", "command", "raw", "untouched". ``why`` enters ``Applied.limited``.
    "off" holds for both: an ESC on the steering's channel must get no pulse either.
    ``full_range``: raw pulses up to 1000 and 2000 us, for wheels off the ground.
    """

    throttle: str = "neutral"
    steering: str = "centre"
    why: tuple[str, ...] = (Limit.NOT_ARMED.value,)
    full_range: bool = False

    @property
    def live(self) -> bool:
        """Whether a source may move the throttle."""
        return self.throttle in ("command", "raw")


LIVE = Output("command", "command", ())
OFF = Output("off", "held", (Limit.PULSES_OFF.value, Limit.NOT_ARMED.value))
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

    ``output``: what the state demanded when it was last asked. ``angle``,
    ``throttle``: where the last frame was, the start of slew limits.
    ``latched``: tripped; neutral until the state is no longer live.
    """

    def __init__(self, car: CarConfig, steering: SteeringMap, neutral_us: float,
                 frame: float, play: Play | None = None) -> None:
        self.output = Output()
        self.arbiter = Arbiter(car.priorities.sources)
        self.raw: Pulses | None = None
        self.throttle_cap: float | None = None
        self.latched = False
        self.angle, self.throttle = 0.0, 0.0
        self.last = -math.inf
        self._car, self._map, self._play = car, steering, play
        self._neutral_us, self._frame = neutral_us, frame

    def wrote(self, plan: Plan, steering_us: float) -> None:
        """A frame carries ``plan``, the steering with this pulse [us]."""
        self.angle, self.throttle = plan.angle, plan.throttle
        if self._play is not None:
            self._play.passed(steering_us, self._frame)

    def meant(self, steering_us: float) -> float:
        """Road-wheel angle [rad] of a pulse, with the play of the steering where it is known."""
        return self._play.meant(steering_us) if self._play else self._map.angle(steering_us)

    def obey(self, output: Output) -> None:
        """What the state demands now; leaving a mode forgets what it was told."""
        if output.throttle != self.output.throttle:
            self.forget()
        if not output.live:
            self.latched = False
        self.output = output

    def latch(self) -> None:
        """Something tripped: every standing command is void."""
        self.latched = self.output.live
        self.forget()

    def forget(self) -> None:
        """No source wants anything."""
        self.arbiter.clear()
        self.raw = None

    def lapsed(self, now: float) -> Command | Pulses | None:
        """What moved the car, or held it, until it ran out; None while something stands."""
        if self.output.throttle == "raw":
            return self.raw if self.raw is not None and self.raw.until < now else None
        self.arbiter.winner(now)
        return self.arbiter.lapsed if self.output.throttle == "command" else None

    def plan(self, now: float, source: str | None = None) -> Plan:
        """The frame at ``now``, and why it is not what ``source`` asked for."""
        why = [*self.output.why]
        if self.latched:
            why.append(Limit.NOT_ARMED.value)
            return self.neutral(self.angle, tuple(why))
        passed = now - self.last if math.isfinite(self.last) else self._frame
        dt = min(max(passed, self._frame), LONGEST_STEP)
        if self.lapsed(now) is not None:
            why.append(Limit.EXPIRED.value)
        if self.output.throttle == "raw":
            return self._raw_plan(now, dt, why)
        winner = self.arbiter.winner(now)
        if winner and source and winner.source != source:
            why.append(f"OVERRIDDEN({winner.source})")
        return self._limited(winner, dt, why)

    def neutral(self, angle: float, why: tuple[str, ...]) -> Plan:
        """Throttle neutral, steering at ``angle``, at once."""
        return self._as_plan(clip(angle, self._map.lowest, self._map.highest), 0.0, why)

    def stopped(self, why: tuple[str, ...]) -> Plan:
        """Throttle to neutral, by car.toml's stop_ramp if it has one; steering held."""
        return self._as_plan(self.angle, self._ramped(self._frame), why)

    def _limited(self, winner: Command | None, dt: float, why: list[str]) -> Plan:
        limits, live = self._car.limits, self.output.throttle == "command"
        if winner and winner.shortened:
            why.append(Limit.VALIDITY.value)
        wanted = winner.throttle if winner and live else 0.0
        throttle = clip(wanted, *self._throttle_range())
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

    def _throttle_range(self) -> tuple[float, float]:
        """Limits of the throttle, and the cap of a lost encoder."""
        limits, cap = self._car.limits, self.throttle_cap
        cap = 1.0 if cap is None else cap
        return max(limits.min_throttle, -cap), min(limits.max_throttle, cap)

    def _raw_range(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Pulses [us] that servo and ESC may get in RAW: the car's limits, as in ARMED."""
        if self.output.full_range:
            return (RAW_LOW_US, RAW_HIGH_US), (RAW_LOW_US, RAW_HIGH_US)
        servo, span = self._car.steering, self._car.throttle.span_us
        low, high = self._throttle_range()
        return ((servo.center_us - servo.span_us, servo.center_us + servo.span_us),
                (self._neutral_us + low * span, self._neutral_us + high * span))

    def _raw_plan(self, now: float, dt: float, why: list[str]) -> Plan:
        """Pulses as they were asked for within the limits; neutral once they ran out."""
        if self.raw is None or self.raw.until < now:
            return self.neutral(self.angle, tuple(why))
        if self.raw.shortened:
            why.append(Limit.VALIDITY.value)
        servo, esc = self._raw_range()
        if self.raw.throttle_us == 0.0:
            held = clip(self.raw.steering_us, *servo)
            return Plan(held, 0.0, self._map.angle(held), 0.0, True, tuple(why))
        steering_us, bounded = clip(self.raw.steering_us, *servo), clip(self.raw.throttle_us, *esc)
        if (steering_us, bounded) != (self.raw.steering_us, self.raw.throttle_us):
            why.append(Limit.RANGE.value)
        span = self._car.throttle.span_us
        wanted = (bounded - self._neutral_us) / span
        throttle = slew(wanted, self.throttle, self._car.limits.throttle_slew, dt)
        if throttle != wanted:
            why.append(Limit.SLEW.value)
            bounded = self._neutral_us + throttle * span
        return Plan(steering_us, bounded, self._map.angle(steering_us), throttle,
                    bounded != self._neutral_us, tuple(why))

    def _as_plan(self, angle: float, throttle: float, why: tuple[str, ...]) -> Plan:
        pulse = throttle_pulse(throttle, self._neutral_us, self._car.throttle.span_us)
        middle = self._play.aim(angle) if self._play else angle
        return Plan(clip(self._map.pulse(middle), PIN_LOW_US, PIN_HIGH_US),
                    clip(pulse, PIN_LOW_US, PIN_HIGH_US), angle, throttle, throttle != 0.0, why)
