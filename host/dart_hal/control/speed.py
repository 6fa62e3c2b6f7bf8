"""Speed control: feed-forward from the model, PI for what it gets wrong.

The feed-forward solves F_m(tau, v) + F_f(v) = m dv/dt for the throttle, corrected by
the pulses that were measured to hold a speed; the PI part removes what is left
(battery, floor, load). A forward speed is never held back by reverse throttle: an ESC
may take it for "reverse".
"""

from __future__ import annotations

import math

from dart_hal.config import CarFiles
from dart_hal.control.measured import (
    Correction,
    correction,
    end_of_throttle,
    rest_before_reverse,
    vehicle_for,
)
from dart_hal.control.reversal import Reversal
from dart_hal.types import Limit, State
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.parameters import Vehicle

K_P = 0.6
"""1/(m/s): the motor gives 17 m/s2 for all of the throttle, so an error is halved within 0.07 s;
and 0.04 s late, the loop keeps 60 degrees of phase, 30 on a car whose force lags by 0.084 s more.
0.4 follows a sine of 0.5 Hz less closely, 0.8 keeps 20 on that car."""
K_I = 0.6
"""1/(m/s)/s: removes a wrong feed-forward with K_P / K_I = 1 s."""
INTEGRAL_MAX = 0.12
"""Throttle that the integral may add: the dead band of one ESC to the next."""
ANSWERS = 0.04
"""s from a throttle to the speed that is read of it: half a PWM frame, ESC and motor, the edges of
the encoder. At 0.03 the measured step overshoots by 6 % in the median of eight hidden cars and a
sine of 0.5 Hz is followed to 0.026 m/s, here 3 % and 0.033."""
RAMP = 2.5
"""m/s2 at which the reference goes to a new speed: what the motor can do on top of friction up to
1 m/s, so that the integral has nothing to learn from a step."""
RESERVE = 0.2
"""Share of the motor's force at v below which no more throttle is asked for."""


class SpeedLaw:
    """Throttle for a reference speed; call once per control period.

    ``correct``: throttle to add at a speed, as it was measured (``measured.correction``).
    Source of the model part: paper's motor and friction curves.
    """

    def __init__(self, vehicle: Vehicle, *, k_p: float = K_P, k_i: float = K_I,
                 max_throttle: float = 1.0) -> None:
        self._motor = vehicle.motor
        self._mass = vehicle.body.mass
        self._friction = make_friction(vehicle.friction)
        self._k_p, self._k_i = k_p, k_i
        self.correct: Correction | None = None
        self._max = max_throttle
        self.reset()

    def reset(self) -> None:
        """Forget the integral: after a stop or an expired command."""
        self.integral = self._expected = 0.0

    def feed_forward(self, speed: float, acceleration: float = 0.0) -> float:
        """Throttle that holds ``speed`` [m/s] under ``acceleration`` [m/s2].

        The model's, and what was measured beside it. In reverse the motor pulls ``reverse``
        times as hard behind the same dead band.
        """
        if speed == 0.0 and acceleration == 0.0:
            return 0.0
        if speed < 0.0:
            ahead = self.feed_forward(-speed, -acceleration)
            pull = max(ahead + self._motor.g, 0.0) / self._motor.reverse
            return -(pull - self._motor.g) if ahead else 0.0
        wanted = self._mass * acceleration - self._friction(speed)
        motor = max(self._motor.d - self._motor.e * speed, RESERVE * self._motor.d)
        if wanted <= 0.0:
            return 0.0
        more = self.correct(speed) if self.correct is not None else 0.0
        holds: float = wanted / motor - self._motor.g + more
        return max(0.0, holds)

    def throttle(self, reference: float, measured: float, dt: float,
                 acceleration: float = 0.0) -> float:
        """Throttle -1..1 for a reference speed [m/s], ``dt`` s after the last call.

        The PI part holds the measured speed against what the car should show of the reference by
        now: it answers late, and late is not slow.
        """
        if reference == 0.0:
            self.reset()
            return 0.0
        follows = reference * self._expected > 0.0
        self._expected = self._expected if follows else measured
        self._expected += (reference - self._expected) * dt / (ANSWERS + dt)
        error = self._expected - measured
        base = self.feed_forward(reference, acceleration)
        wanted = base + self._k_p * error + self.integral
        low, high = (0.0, self._max) if reference > 0.0 else (-self._max, 0.0)
        tau = min(max(wanted, low), high)
        if tau == wanted or (wanted - tau) * error < 0.0:  # no wind-up at the limits
            self.integral += self._k_i * error * dt
            self.integral = min(max(self.integral, -INTEGRAL_MAX), INTEGRAL_MAX)
        return tau


class SpeedLoop:
    """The law of one open car, for ``drive_speed``; called once per State that is answered.

    ``open_loop``: the last throttle was made without the measured speed; ``clipped``: the speed
    asked for is beyond [limits] max_speed.
    """

    def __init__(self, files: CarFiles) -> None:
        self._limits = files.config.limits
        self._law = SpeedLaw(vehicle_for(files), max_throttle=end_of_throttle(files))
        self._law.correct = correction(files, self._law.feed_forward)
        self._reversal = Reversal(rest_before_reverse(files))
        self._reference = 0.0
        self._t: float | None = None
        self.open_loop = self.clipped = False

    @property
    def limited(self) -> tuple[str, ...]:
        """Names of ``Limit``: why the throttle is not what the speed alone asks for."""
        why = ((Limit.RANGE, self.clipped), (Limit.ENCODER_DOUBTED, self.open_loop),
               (Limit.REVERSING, self._reversal.holding))
        return tuple(limit.value for limit, holds in why if holds)

    def reset(self) -> None:
        """Forget the integral: at a stop, and when nobody drove for a while."""
        self._law.reset()
        self._reversal.reset()

    def throttle(self, speed: float, state: State | None, *, armed: bool, window: float) -> float:
        """Throttle for a speed [m/s]; ``window`` [s]: a longer pause forgets the integral.

        A doubted speed is not fed back: the feed-forward alone drives, at most
        with [limits] encoder_lost_throttle.
        """
        limits = self._limits
        measured, t = (state.speed, state.t) if state else (0.0, 0.0)
        before = self._t if self._t is not None else t
        dt, self._t = t - before, t
        wanted = min(max(speed, -limits.max_speed), limits.max_speed)
        self.clipped = wanted != speed
        self.open_loop = state is not None and state.health.speed_doubted
        if self.open_loop or dt > window or not armed:
            self.reset()
            dt = 0.0
        if self.open_loop:
            cap = limits.encoder_lost_throttle
            blind = min(max(self._law.feed_forward(wanted), -cap), cap)
            return max(self._reversal.throttle(blind, measured, t - before), -cap)
        reference, acceleration = self._ramped(wanted, measured, dt)
        throttle = self._law.throttle(reference, measured, dt, acceleration)
        held = self._reversal.throttle(throttle, measured, dt)
        if self._reversal.holding:
            self._law.reset()
            self._reference = 0.0
        return held

    def _ramped(self, wanted: float, measured: float, dt: float) -> tuple[float, float]:
        """(reference [m/s], its acceleration [m/s2]): no further from the car than it can follow,
        and never across 0."""
        if wanted == 0.0:
            self._reference = 0.0
            return 0.0, 0.0
        start = self._reference if self._reference * wanted > 0.0 else 0.0
        if start == 0.0 and measured * wanted > 0.0:
            start = measured
        step = min(max(wanted - start, -RAMP * dt), RAMP * dt)
        self._reference = start + step
        if self._reference == 0.0:  # a first call has no time behind it
            return math.copysign(1e-3, wanted), math.copysign(RAMP, wanted)
        return self._reference, step / dt if dt > 0.0 else 0.0
