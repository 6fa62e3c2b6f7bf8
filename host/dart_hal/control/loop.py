"""The speed loop of ``drive_speed``: two degrees of freedom, tuned from the car's own answer.

    wanted -> profile --+--------------------> (+) -> inverse of -> lead -> brake, then -> throttle
                        |   a_ff                |a    the drive            reverse
                        +-> as the car should --(-)-> PI
                            show it by now       ^
                                                 speed of the State

The feed-forward alone drives the car along the profile; the PI part sees what is left, and takes
battery, floor and load out. It holds the measured speed against the profile as the car should show
it by now: late is not slow.
"""

from __future__ import annotations

import math

from dart_hal.control.drivetrain import BRAKE_ABOVE, COAST, Lead
from dart_hal.control.measured import end_of_throttle, inverse_of, rest_before_reverse
from dart_hal.control.profile import Profile
from dart_hal.control.reversal import Reversal
from dart_hal.control.tuning import answer_of
from dart_hal.core.config import CarFiles
from dart_hal.core.types import Limit, State

# m/s2 that the integral may add: a slope of 11 degrees, or a dead band that is 0.12 of throttle
# off, which is that of one ESC to the next.
INTEGRAL_MAX = 2.0
# Throttle that counts as a pull forward; a count of the PCA9685 is 0.011.
LEAST_PULL = 0.8 * COAST
# m/s; the profile's first value has no time behind it.
STARTS = 1e-3


class SpeedLoop:
    """The loop of one open car; called once per State that is answered.

    ``open_loop``: the last throttle was made without the measured speed; ``clipped``: the speed
    asked for is beyond [limits] max_speed; ``saturated``: the loop wants more throttle than there
    is.
    """

    def __init__(self, files: CarFiles) -> None:
        self._limits = files.config.limits
        end = end_of_throttle(files)
        self._low = max(self._limits.min_throttle, -end)
        self._high = min(self._limits.max_throttle, end)
        self._inverse = inverse_of(files)
        self._answer = answer_of(files)
        self._lead = Lead(self._answer.lag if self._answer.known else 0.0)
        self._profile = Profile(self._answer.ramp, self._answer.ease)
        self._reversal = Reversal(rest_before_reverse(files))
        self._integral = 0.0
        self._driving = 0.0
        self._pulled = False
        self._t: float | None = None
        self.open_loop = self.clipped = self.saturated = False

    @property
    def limited(self) -> tuple[str, ...]:
        """Names of ``Limit``: why the throttle is not what the speed alone asks for."""
        why = ((Limit.RANGE, self.clipped or self.saturated),
               (Limit.ENCODER_DOUBTED, self.open_loop),
               (Limit.REVERSING, self._reversal.holding))
        return tuple(limit.value for limit, holds in why if holds)

    def reset(self) -> None:
        """Forget integral and profile: at a stop, and when nobody drove for a while."""
        self._rest()
        self._reversal.reset()

    def throttle(self, speed: float, state: State | None, *, armed: bool, window: float) -> float:
        """Throttle for a speed [m/s]; ``window`` [s]: a longer pause forgets the integral.

        A doubted speed is not fed back: the feed-forward alone drives, at most
        with [limits] encoder_lost_throttle, and never brakes.
        """
        limits = self._limits
        measured, t = (state.speed, state.t) if state else (0.0, 0.0)
        before = self._t if self._t is not None else t
        dt = t - before
        self._t = t
        wanted = min(max(speed, -limits.max_speed), limits.max_speed)
        self.clipped = wanted != speed
        self.saturated = False
        self.open_loop = state is not None and state.health.speed_doubted
        if self.open_loop or dt > window or not armed:
            self.reset()
            dt = 0.0
        if self.open_loop:
            cap = limits.encoder_lost_throttle
            blind = min(max(self._inverse.throttle(wanted), -cap), cap)
            return max(self._reversal.throttle(blind, measured, t - before), -cap)
        self._see(state.applied.throttle if state else 0.0, dt)
        throttle = self._law(wanted, measured, dt)
        held = (throttle if wanted > 0.0 and throttle < 0.0  # the brake, on the way forward
                else self._reversal.throttle(throttle, measured, dt))
        if self._reversal.holding:
            self._rest()
        return held

    def _rest(self) -> None:
        self._profile.reset()
        self._integral = self._driving = 0.0

    def _see(self, applied: float, dt: float) -> None:
        """What the pin carried. The ESC brakes after a pull forward, and not after neutral."""
        backward = self._driving < 0.0 and not self._reversal.holding
        self._lead.passed(applied if applied > 0.0 or backward else 0.0, dt)
        self._pulled = applied > LEAST_PULL or (self._pulled and applied != 0.0)

    def _law(self, wanted: float, measured: float, dt: float) -> float:
        """Throttle for a wanted speed of either sign [m/s]; 0 is neutral, whatever the car does."""
        if wanted == 0.0:
            self._rest()
            return 0.0
        if self._driving * wanted <= 0.0:
            self._rest()
            starts = wanted > 0.0 or measured < 0.0  # it rolls, and may be pulled right away
            self._profile.reset(measured if starts and measured != 0.0
                                else math.copysign(STARTS, wanted))
        self._driving = wanted
        profile = self._profile
        left = self._lead.left(dt)
        to_force = self._answer.to_force(dt)
        profile.go(wanted, dt, to_force + left)
        error = self._error(measured, to_force + left)
        k_a, tau_i = self._answer.gains(dt, left)
        asked = profile.acceleration + k_a * error + self._integral
        throttle = self._bounded(asked, measured, dt)
        if not self.saturated and (self._answer.known or not profile.jumping):
            self._integral += k_a / tau_i * error * dt
            self._integral = min(max(self._integral, -INTEGRAL_MAX), INTEGRAL_MAX)
        return throttle

    def _error(self, measured: float, to_force: float) -> float:
        """What the profile is ahead of the measured speed [m/s], as a State should show it now.

        From rest the wheels have to turn on by two edges until there is a speed to be seen.
        """
        answer = self._answer
        profile = self._profile
        shown = profile.before(to_force + answer.shows(profile.before(to_force)))
        if abs(shown) < answer.unseen and abs(measured) < answer.unseen:
            return 0.0
        return shown - measured

    def _bounded(self, acceleration: float, measured: float, dt: float) -> float:
        """Throttle for the profile's speed and an acceleration, within what car and ESC allow."""
        speed = self._profile.speed
        if self._driving > 0.0:
            pull = self._inverse.braked(speed, acceleration)
            if pull < 0.0 and (not self._pulled or measured < BRAKE_ABOVE):
                pull = COAST
        else:
            pull = self._inverse.throttle(min(speed, 0.0), acceleration)
        bounded = min(max(pull, self._low), self._high)
        self.saturated = bounded != pull
        if bounded < 0.0 < self._driving:
            return bounded
        led = self._lead.throttle(bounded, dt)
        return min(max(led, self._low), self._high)
