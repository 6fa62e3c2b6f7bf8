"""Detection of wheels that spin or lock: their speed compared with the integrated acceleration.

1. The ground speed is integrated from the acceleration and pulled to the wheel speed, so that a
   bias of the accelerometer stays small.
2. The lever arm of the IMU from the axle is learnt in bends (scalar Kalman filter).
3. Where both speeds differ, the integral replaces the wheel speed for as long as it is accurate.
"""

from __future__ import annotations

from collections import deque

# Steps over which speeds are compared: edges of the ring come unevenly.
AVERAGED_STEPS = 4
# m/s of difference that count as spin: a bias of 0.1 m/s2 and a pitch of 1.5 deg make 0.09 within
# ``PULL_TIME``.
MIN_SPIN_SPEED = 0.15
# m, one sigma of the distance of the IMU from the axle along the car: 0.1 m adds 0.9 m/s2 in a
# bend at 3 rad/s.
LEVER_STD = 0.1
# m/s, one sigma of all other differences of both speeds, independent every ``PULL_TIME``.
SPEED_DIFFERENCE_STD = 0.1
# s: time constant of the pull to the wheel speed.
PULL_TIME = 0.25
# m/s, one sigma of the ground speed during a spin: half a second of a bias of 0.1 m/s2, and 0.1
# for its begin.
SPIN_SPEED_STD = 0.15
# s for which the integral is used; a bias of 0.1 m/s2 makes 0.1 m/s of it.
MAX_SPIN_TIME = 1.0


class SpinDetector:
    """Estimates the ground speed along the nose while the wheels spin or lock."""

    def __init__(self) -> None:
        self._ground_speed: float | None = None
        self._spin_time = self._lever_input = self._lever = 0.0
        self._variance = LEVER_STD**2
        self._steps: deque[tuple[float, float]] = deque(maxlen=AVERAGED_STEPS)

    def update(self, distance: float, dt: float, accel: float | None, turn: float = 0.0
               ) -> float | None:
        """Add one step; return the ground speed [m/s] during a spin, else None.

        distance [m] by the wheels and turn [rad] in dt [s]; accel [m/s2] along the nose, None while
        it is not known.
        """
        self._steps.append((distance, dt))
        total, time = map(sum, zip(*self._steps, strict=True))
        wheel_speed = total / max(time, 1e-9)
        if accel is None or self._ground_speed is None or self._spin_time > MAX_SPIN_TIME:
            self._ground_speed = wheel_speed
            self._spin_time = 0.0
            return None
        yaw_rate2 = (turn / dt)**2 if dt > 0.0 else 0.0
        self._lever_input += (yaw_rate2 - self._lever_input / PULL_TIME) * dt
        accel += self._lever * yaw_rate2
        self._ground_speed += accel * dt
        difference = wheel_speed - (self._ground_speed - accel * 0.5 * time)
        if abs(difference) > MIN_SPIN_SPEED + 2.0 * self._variance**0.5 * self._lever_input:
            self._spin_time += dt
            return self._ground_speed
        self._spin_time = 0.0
        self._learn_lever(difference, dt)
        self._ground_speed += difference * min(dt / PULL_TIME, 1.0)
        return None

    def _learn_lever(self, difference: float, dt: float) -> None:
        """Update the lever arm by the speed ``difference`` [m/s]: its effect plus noise."""
        noise = SPEED_DIFFERENCE_STD**2 * PULL_TIME / max(dt, 1e-9)
        gain = self._variance * self._lever_input / (self._variance * self._lever_input**2 + noise)
        self._lever += gain * difference
        self._variance *= 1.0 - gain * self._lever_input
