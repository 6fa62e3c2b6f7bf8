"""The pulses of one PWM frame, computed without access to a bus.

1. Drop expired commands and take the one of highest priority.
2. Clip steering and throttle to the car's limits.
3. Limit the slew rates.
4. Invert the steering map, with the play of the steering where it is known.
5. Clip both pulses [us] to the range of the pins.
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
    RawPulses,
    SourceCommand,
    clip,
    limit_slew,
)
from dart_hal.devices.actuation.play import Play
from dart_hal.devices.actuation.steering_map import SteeringMap, throttle_pulse

# Range of the pulses at the pins: that of ServoKit.
PIN_LOW_US = 750.0
PIN_HIGH_US = 2250.0

# s of slew that one frame may apply after a pause.
MAX_SLEW_INTERVAL = 0.1


@dataclass(frozen=True, slots=True)
class PinDemand:
    """Demand of the supervisor's state on the pins.

    throttle: "neutral", "command", "raw", "untouched", "off"; steering: "centre", "held",
    "command", "raw", "untouched". "off" applies to both: an ESC on the steering's channel must get
    no pulse either. ``why`` is reported in ``Applied.limited``. ``full_range``: raw pulses of
    1000 to 2000 us, for wheels off the ground.
    """

    throttle: str = "neutral"
    steering: str = "centre"
    why: tuple[str, ...] = (Limit.NOT_ARMED.value,)
    full_range: bool = False

    @property
    def live(self) -> bool:
        """Whether a source may move the throttle."""
        return self.throttle in ("command", "raw")


LIVE_DEMAND = PinDemand("command", "command", ())
OFF_DEMAND = PinDemand("off", "held", (Limit.PULSES_OFF.value, Limit.NOT_ARMED.value))
RAW_DEMAND = PinDemand("raw", "raw", ())


@dataclass(frozen=True, slots=True)
class FramePlan:
    """Pulses [us] of a frame; ``moving`` False: the throttle is at neutral."""

    steering_us: float
    throttle_us: float
    angle: float
    throttle: float
    moving: bool
    limited: tuple[str, ...]


class Planner:
    """Turns the requests of all sources into the pulses of the next frame.

    ``demand``: of the supervisor's state; ``angle`` [rad], ``throttle``: of the last frame, from
    which the slew limits start; ``latched``: tripped, neutral until the state is no longer live;
    ``obstacle``: no forward throttle; ``battery_cap``: largest throttle of a low battery;
    ``override``: command of the driver of an RC transmitter, which the sources do not change.
    """

    def __init__(self, car: CarConfig, steering: SteeringMap, neutral_us: float,
                 frame: float, play: Play | None = None) -> None:
        self.demand = PinDemand()
        self.arbiter = Arbiter(car.priorities.sources)
        self.raw: RawPulses | None = None
        self.throttle_cap: float | None = None
        self.battery_cap: float | None = None
        self.obstacle = False
        self.override: SourceCommand | None = None
        self.latched = False
        self.angle = self.throttle = 0.0
        self.last = -math.inf
        self._car = car
        self._map = steering
        self._play = play
        self._neutral_us = neutral_us
        self._frame = frame

    def note_written(self, plan: FramePlan, steering_us: float) -> None:
        """Note that ``plan`` was written, the steering with this pulse [us]."""
        self.angle = plan.angle
        self.throttle = plan.throttle
        if self._play is not None:
            self._play.update(steering_us, self._frame)

    def wheel_angle(self, steering_us: float) -> float:
        """Return the road-wheel angle [rad] of a pulse, with the play of the steering if known."""
        return self._play.wheel_angle(steering_us) if self._play else self._map.angle(steering_us)

    def set_demand(self, demand: PinDemand) -> None:
        """Set the demand of the state; a change of mode drops all requests."""
        if demand.throttle != self.demand.throttle:
            self.clear_requests()
        if not demand.live:
            self.latched = False
        self.demand = demand

    def latch(self) -> None:
        """Trip: drop all requests, neutral until the state has changed."""
        self.latched = self.demand.live
        self.clear_requests()

    def clear_requests(self) -> None:
        """Drop the requests of all sources."""
        self.arbiter.clear()
        self.raw = None

    def expired_request(self, now: float) -> SourceCommand | RawPulses | None:
        """Return the request that was in effect until it expired; None while one is valid."""
        if self.demand.throttle == "raw":
            return self.raw if self.raw is not None and self.raw.until < now else None
        if self.override is not None:
            return None
        self.arbiter.winner(now)
        return self.arbiter.last_expired if self.demand.throttle == "command" else None

    def plan(self, now: float, source: str | None = None) -> FramePlan:
        """Plan the frame at ``now``; ``limited``: why it differs from the request of ``source``."""
        why = [*self.demand.why]
        if self.latched:
            why.append(Limit.NOT_ARMED.value)
            return self.plan_neutral(self.angle, tuple(why))
        since_last = now - self.last if math.isfinite(self.last) else self._frame
        dt = min(max(since_last, self._frame), MAX_SLEW_INTERVAL)
        if self.expired_request(now) is not None:
            why.append(Limit.EXPIRED.value)
        if self.demand.throttle == "raw":
            return self._plan_raw(now, dt, why)
        winner = self.override or self.arbiter.winner(now)
        if self.override is not None:
            why.append(Limit.RC_OVERRIDE.value)
        if winner and source and winner.source != source:
            why.append(f"OVERRIDDEN({winner.source})")
        return self._plan_limited(winner, dt, why)

    def plan_neutral(self, angle: float, why: tuple[str, ...]) -> FramePlan:
        """Plan neutral throttle, and steering at ``angle`` without a slew limit."""
        return self._to_pulses(clip(angle, self._map.lowest, self._map.highest), 0.0, why)

    def plan_stop(self, why: tuple[str, ...]) -> FramePlan:
        """Plan throttle to neutral, by car.toml's stop_ramp if it has one; steering unchanged."""
        return self._to_pulses(self.angle, self._ramp_throttle(self._frame), why)

    def _plan_limited(self, winner: SourceCommand | None, dt: float, why: list[str]) -> FramePlan:
        """Apply range and slew limits to the winning command, and note each limit that acts."""
        limits = self._car.limits
        live = self.demand.throttle == "command"
        if winner and winner.shortened:
            why.append(Limit.VALIDITY.value)
        if winner and live:
            why += winner.reasons
        target = winner.throttle if winner and live else 0.0
        throttle = clip(target, *self._throttle_range())
        angle = self._target_angle(winner)
        bounded = clip(angle, max(-limits.max_steering, self._map.lowest),
                       min(limits.max_steering, self._map.highest))
        turned = limit_slew(bounded, self.angle, limits.steering_slew, dt)
        driven = (limit_slew(throttle, self.throttle, limits.throttle_slew, dt) if winner and live
                  else self._ramp_throttle(dt))
        if self.obstacle and max(target, driven) > 0.0:
            # At once, without a slew limit.
            driven = min(driven, 0.0)
            why.append(Limit.OBSTACLE.value)
        if self._exceeds_battery(target):
            why.append(Limit.BATTERY.value)
        if (throttle, bounded) != (target, angle):
            why.append(Limit.RANGE.value)
        if (turned, driven) != (bounded, throttle):
            why.append(Limit.SLEW.value)
        return self._to_pulses(turned, driven, tuple(dict.fromkeys(why)))

    def _target_angle(self, winner: SourceCommand | None) -> float:
        """Return the steering setpoint [rad] of the mode: centre, command, or the last angle."""
        mode = self.demand.steering
        if mode == "centre":
            return 0.0
        return winner.steering if winner and mode == "command" else self.angle

    def _ramp_throttle(self, dt: float) -> float:
        """Return the throttle on its way to neutral, dt [s] later: at once without a stop_ramp."""
        ramp = self._car.throttle.stop_ramp
        return limit_slew(0.0, self.throttle, 1.0 / ramp if ramp > 0 else None, dt)

    def _exceeds_battery(self, throttle: float) -> bool:
        """Return whether a low battery does not allow a throttle."""
        return self.battery_cap is not None and throttle > self.battery_cap

    def _throttle_range(self) -> tuple[float, float]:
        """Return the limits of the throttle, also of encoder, battery and obstacle."""
        limits = self._car.limits
        cap = 1.0 if self.throttle_cap is None else self.throttle_cap
        # A low battery does not limit throttle backward: it may be the brake.
        forward = 1.0 if self.battery_cap is None else self.battery_cap
        return (max(limits.min_throttle, -cap),
                min(limits.max_throttle, cap, forward, 0.0 if self.obstacle else 1.0))

    def _raw_range(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the ranges [us] of servo and ESC in RAW: the car's limits, as in ARMED."""
        if self.demand.full_range:
            return (RAW_LOW_US, RAW_HIGH_US), (RAW_LOW_US, RAW_HIGH_US)
        servo = self._car.steering
        span = self._car.throttle.span_us
        low, high = self._throttle_range()
        return ((servo.center_us - servo.span_us, servo.center_us + servo.span_us),
                (self._neutral_us + low * span, self._neutral_us + high * span))

    def _plan_raw(self, now: float, dt: float, why: list[str]) -> FramePlan:
        """Plan raw pulses within the limits; neutral once they have expired."""
        if self.raw is None or self.raw.until < now:
            return self.plan_neutral(self.angle, tuple(why))
        if self.raw.shortened:
            why.append(Limit.VALIDITY.value)
        servo, esc = self._raw_range()
        steering_us = clip(self.raw.steering_us, *servo)
        if self.raw.throttle_us == 0.0:
            return FramePlan(steering_us, 0.0, self._map.angle(steering_us), 0.0, True, tuple(why))
        bounded = clip(self.raw.throttle_us, *esc)
        if (steering_us, bounded) != (self.raw.steering_us, self.raw.throttle_us):
            why.append(Limit.RANGE.value)
        span = self._car.throttle.span_us
        if not self.demand.full_range and self._exceeds_battery(
                (self.raw.throttle_us - self._neutral_us) / span):
            why.append(Limit.BATTERY.value)
        target = (bounded - self._neutral_us) / span
        throttle = limit_slew(target, self.throttle, self._car.limits.throttle_slew, dt)
        if self.obstacle and not self.demand.full_range and (
                self.raw.throttle_us > self._neutral_us or throttle > 0.0):
            throttle = min(throttle, 0.0)
            why.append(Limit.OBSTACLE.value)
        if throttle != target:
            why.append(Limit.SLEW.value)
            bounded = self._neutral_us + throttle * span
        return FramePlan(steering_us, bounded, self._map.angle(steering_us), throttle,
                         bounded != self._neutral_us, tuple(why))

    def _to_pulses(self, angle: float, throttle: float, why: tuple[str, ...]) -> FramePlan:
        """Convert angle [rad] and throttle to pulses [us] in the range of the pins."""
        pulse = throttle_pulse(throttle, self._neutral_us, self._car.throttle.span_us)
        middle = self._play.aim(angle) if self._play else angle
        return FramePlan(clip(self._map.pulse(middle), PIN_LOW_US, PIN_HIGH_US),
                         clip(pulse, PIN_LOW_US, PIN_HIGH_US), angle, throttle,
                         throttle != 0.0, why)
