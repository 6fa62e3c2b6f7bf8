"""The speed loop of ``drive_speed``: two degrees of freedom, tuned by the measured response.

    target -> profile --+--------------------> (+) -> inverse of -> lead -> brake, then -> throttle
                        |   a_ff                |a    the drive            reverse
                        +-> delayed profile ----(-)-> PI
                                                 ^
                                                 speed of the State

The feed-forward alone drives the car along the profile. The PI part corrects the rest and
compensates battery, floor and load. It compares the measured speed with the profile delayed by the
response of the car, so that the known delay causes no error.
"""

from __future__ import annotations

import math

from dart_hal.control.drivetrain import COAST_THROTTLE, MIN_BRAKING_SPEED, LagCompensator
from dart_hal.control.measured import (
    make_inverse_drive,
    max_effective_throttle,
    rest_before_reverse,
)
from dart_hal.control.profile import Profile
from dart_hal.control.reversal import Reversal
from dart_hal.control.tuning import make_speed_response
from dart_hal.core.config import CarFiles
from dart_hal.core.types import Limit, State

# Largest acceleration of the integral [m/s2]: a slope of 11 degrees, or a dead band that is 0.12 of
# throttle off, the difference between two ESCs.
MAX_INTEGRAL = 2.0
# Throttle by which counts may round a command: two counts of the PCA9685, 0.011 each.
MAX_THROTTLE_ROUNDING = 0.02
# Throttle that counts as driving forward; a count of the PCA9685 is 0.011.
MIN_PULL = 0.8 * COAST_THROTTLE
# Decelerations that a car does not exceed [m/s2]: with the brake that of rubber tyres, 1.2 g;
# without it friction (1), the drag of the front tyres in a bend (2) and a slope (1). A speed that
# falls faster, as that of an encoder that fails, is fed back no faster: the throttle stays until
# the speed is doubted.
MAX_DECELERATION = 12.0
MAX_COASTING_DECELERATION = 4.0
# Start of the profile from rest [m/s]; its first value has no time step.
START_SPEED = 1e-3


class SpeedLoop:
    """Speed loop of one open car; called once per State.

    ``open_loop``: the last throttle was made without the measured speed; ``clipped``: the target is
    beyond [limits] max_speed; ``saturated``: the loop requires more throttle than available.
    """

    def __init__(self, files: CarFiles) -> None:
        self._limits = files.config.limits
        end = max_effective_throttle(files)
        self._low = max(self._limits.min_throttle, -end)
        self._high = min(self._limits.max_throttle, end)
        self._inverse = make_inverse_drive(files)
        self._response = make_speed_response(files)
        self._lead = LagCompensator(self._response.lag if self._response.is_lag_known else 0.0)
        self._profile = Profile(self._response.ramp, self._response.ease)
        self._reversal = Reversal(rest_before_reverse(files))
        self._integral = 0.0
        self._direction = 0.0
        self._pulled = False
        self._t: float | None = None
        self._trusted = self._sent = 0.0
        self.open_loop = self.clipped = self.saturated = False

    @property
    def active_limits(self) -> tuple[str, ...]:
        """Names of ``Limit``: why the throttle is not what the speed alone requires."""
        flags = ((Limit.RANGE, self.clipped or self.saturated),
                 (Limit.ENCODER_DOUBTED, self.open_loop),
                 (Limit.REVERSING, self._reversal.holding))
        return tuple(limit.value for limit, is_set in flags if is_set)

    def reset(self) -> None:
        """Forget integral and profile: at a stop, and after a pause of the commands."""
        self._rest()
        self._reversal.reset()

    def throttle(self, speed: float, state: State | None, *, armed: bool, window: float) -> float:
        """Return the throttle for a speed [m/s]; ``window`` [s]: a longer pause resets the
        integral.

        A doubted speed is not fed back: the feed-forward alone drives, at most with [limits]
        encoder_lost_throttle, and never brakes.
        """
        limits = self._limits
        measured, t = (state.speed, state.t) if state else (0.0, 0.0)
        last_t = self._t if self._t is not None else t
        dt = t - last_t
        self._t = t
        target = min(max(speed, -limits.max_speed), limits.max_speed)
        self.clipped = target != speed
        self.saturated = False
        self.open_loop = state is not None and state.health.speed_doubted
        if self.open_loop or dt > window or not armed:
            self.reset()
            dt = 0.0
        if self.open_loop:
            self._trusted = measured
            cap = limits.encoder_lost_throttle
            blind = min(max(self._inverse.throttle(target), -cap), cap)
            return max(self._reversal.throttle(blind, measured, t - last_t), -cap)
        applied = state.applied.throttle if state else 0.0
        fall = (t - last_t) * (MAX_DECELERATION if applied * self._trusted < 0.0
                               else MAX_COASTING_DECELERATION)
        if abs(measured) < abs(self._trusted) - fall:
            measured = math.copysign(abs(self._trusted) - fall, self._trusted)
        self._trusted = measured
        self._record_throttle(applied, dt)
        if state is not None and self._is_withheld(state):
            # Begin at the measured speed: the car must not leap when the throttle passes again.
            self._rest()
        throttle = self._law(target, measured, dt)
        result = (throttle if target > 0.0 and throttle < 0.0  # the brake, while driving forward
                  else self._reversal.throttle(throttle, measured, dt))
        if self._reversal.holding:
            self._rest()
        self._sent = result
        return result

    def _is_withheld(self, state: State) -> bool:
        """Return whether obstacle or battery keep the throttle below what this loop has sent."""
        limited = state.applied.limited
        return Limit.OBSTACLE.value in limited or (
            Limit.BATTERY.value in limited
            and state.applied.throttle < self._sent - MAX_THROTTLE_ROUNDING)

    def _rest(self) -> None:
        self._profile.reset()
        self._integral = self._direction = 0.0

    def _record_throttle(self, applied: float, dt: float) -> None:
        """Record the throttle at the pin. The ESC brakes after driving forward, and not after
        neutral.
        """
        backward = self._direction < 0.0 and not self._reversal.holding
        self._lead.record(applied if applied > 0.0 or backward else 0.0, dt)
        self._pulled = applied > MIN_PULL or (self._pulled and applied != 0.0)

    def _law(self, target: float, measured: float, dt: float) -> float:
        """Return the throttle for a target of either sign [m/s]; 0 is neutral at any speed.

        1. Advance the profile by the response time.
        2. a = a_ff + k_a e + integral, with e of ``_error``.
        3. Inverse drive and limits. The integral is frozen while saturated (anti-windup).
        """
        if target == 0.0:
            self._rest()
            return 0.0
        if self._direction * target <= 0.0:
            self._rest()
            is_rolling = target > 0.0 or measured < 0.0  # no reversal needed
            self._profile.reset(measured if is_rolling and measured != 0.0
                                else math.copysign(START_SPEED, target))
        self._direction = target
        profile = self._profile
        remaining_lag = self._lead.remaining_lag(dt)
        to_force = self._response.to_force(dt)
        profile.advance(target, dt, to_force + remaining_lag)
        error = self._error(measured, to_force + remaining_lag)
        k_a, tau_i = self._response.gains(dt, remaining_lag)
        acceleration = profile.acceleration + k_a * error + self._integral
        throttle = self._limit_throttle(acceleration, measured, dt)
        if not self.saturated and (self._response.is_lag_known or not profile.on_ramp):
            self._integral += k_a / tau_i * error * dt
            self._integral = min(max(self._integral, -MAX_INTEGRAL), MAX_INTEGRAL)
        return throttle

    def _error(self, measured: float, to_force: float) -> float:
        """Return the delayed profile minus the measured speed [m/s].

        From rest the wheels have to turn by two more edges until a speed can be measured.
        """
        response = self._response
        profile = self._profile
        expected = profile.value_before(
            to_force + response.measurement_delay(profile.value_before(to_force))
        )
        if (
            abs(expected) < response.min_measurable_speed
            and abs(measured) < response.min_measurable_speed
        ):
            return 0.0
        return expected - measured

    def _limit_throttle(self, acceleration: float, measured: float, dt: float) -> float:
        """Return the throttle for the speed of the profile and an acceleration, within the limits.
        """
        speed = self._profile.speed
        if self._direction > 0.0:
            unlimited = self._inverse.throttle_or_brake(speed, acceleration)
            if unlimited < 0.0 and (not self._pulled or measured < MIN_BRAKING_SPEED):
                unlimited = COAST_THROTTLE
        else:
            unlimited = self._inverse.throttle(min(speed, 0.0), acceleration)
        bounded = min(max(unlimited, self._low), self._high)
        self.saturated = bounded != unlimited
        if bounded < 0.0 < self._direction:
            return bounded
        compensated = self._lead.throttle(bounded, dt)
        return min(max(compensated, self._low), self._high)
