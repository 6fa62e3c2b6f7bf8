"""Speed control of a car while it is measured: feed-forward and PI, without the brake.

The feed-forward solves F_m(tau, v) + F_f(v) = m dv/dt for the throttle; the
PI part removes the error of the model (battery, floor, load). ``drive_speed`` has its own loop
(``loop``), which is tuned by the measured response and brakes.
"""

from __future__ import annotations

from dart_hal.control.drivetrain import InverseDrive
from dart_hal.vehicle.parameters import Vehicle

# Proportional gain [1/(m/s)]: the motor supplies 17 m/s2 for the full throttle, so an error is
# halved within 0.07 s. With a delay of 0.04 s the loop has a phase margin of 60 degrees, 30 on a
# car with an additional lag of 0.084 s. 0.4 follows a sine of 0.5 Hz less closely, 0.8 has a margin
# of 20 degrees on that car.
DEFAULT_K_P = 0.6
# Integral gain [1/(m/s)/s]: removes a wrong feed-forward with K_P / K_I = 1 s.
DEFAULT_K_I = 0.6
# Largest throttle of the integral: the difference of the dead bands of two ESCs.
MAX_INTEGRAL = 0.12
# Time from a throttle to the measured speed [s]: half a PWM frame, ESC and motor, the edges of the
# encoder. With 0.03 the measured step overshoots by 6 % in the median of eight hidden cars and a
# sine of 0.5 Hz is followed to 0.026 m/s; with this value 3 % and 0.033.
RESPONSE_TIME = 0.04


class SpeedLaw:
    """Throttle for a reference speed; call once per control period.

    Source of the model part: paper's motor and friction curves.
    """

    def __init__(self, vehicle: Vehicle, *, k_p: float = DEFAULT_K_P, k_i: float = DEFAULT_K_I,
                 max_throttle: float = 1.0) -> None:
        self.feed_forward = InverseDrive(vehicle).throttle
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
        """Return the throttle -1..1 for a reference speed [m/s], ``dt`` s after the last call.

        The PI part compares the measured speed with the reference delayed by the response of the
        car, so that the known delay causes no error.
        """
        if reference == 0.0:
            self.reset()
            return 0.0
        same_direction = reference * self._expected > 0.0
        self._expected = self._expected if same_direction else measured
        self._expected += (reference - self._expected) * dt / (RESPONSE_TIME + dt)
        error = self._expected - measured
        base = self.feed_forward(reference, acceleration)
        unlimited = base + self._k_p * error + self.integral
        low, high = (0.0, self._max) if reference > 0.0 else (-self._max, 0.0)
        tau = min(max(unlimited, low), high)
        if tau == unlimited or (unlimited - tau) * error < 0.0:  # no wind-up at the limits
            self.integral += self._k_i * error * dt
            self.integral = min(max(self.integral, -MAX_INTEGRAL), MAX_INTEGRAL)
        return tau
