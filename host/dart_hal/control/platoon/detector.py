"""Detection of reported accelerations that the predecessor does not drive.

    vr <- (vr + dt (a_i - a_reported)) (1 - K) + K (v_i - v_p),    K = 0.05

A reported acceleration that is not driven makes the observed relative speed vr differ from the
measured one.
Source: Lorenzo-Lyons/Distributed-Attack-Resilient-Platooning (anomaly detector of the cars).
"""

from __future__ import annotations

# Observer gain K, threshold [m/s] and number of samples at 10 Hz: a false report of 1 m/s2 ends at
# 1.9 m/s and is found within 1.2 s.
OBSERVER_GAIN = 0.05
SPEED_THRESHOLD = 0.5
MIN_EXCEEDANCES = 5
# Sample time of these values [s].
REFERENCE_STEP = 0.1


class AttackDetector:
    """One per follower; ``attacked`` is permanent once set."""

    def __init__(self, dt: float) -> None:
        self._dt = dt
        self._gain = OBSERVER_GAIN * dt / REFERENCE_STEP
        self._max_count = MIN_EXCEEDANCES * REFERENCE_STEP / dt
        self.attacked = False
        self._estimate: float | None = None
        self._count = 0

    def update(
        self, speed: float, predecessor_speed: float, own_acceleration: float, reported: float
    ) -> bool:
        """Update with the own and the predecessor's speed [m/s], and the own and the reported
        acceleration.
        """
        relative = speed - predecessor_speed
        if self._estimate is None:
            self._estimate = relative
        k = self._gain
        self._estimate = (self._estimate + self._dt * (own_acceleration - reported)) * (
            1.0 - k
        ) + k * relative
        beyond = abs(relative - self._estimate) > SPEED_THRESHOLD
        self._count = self._count + 1 if beyond else 0
        self.attacked = self.attacked or self._count > self._max_count
        return self.attacked

    def restart(self) -> None:
        """Restart after a pause of the messages; ``attacked`` is kept."""
        self._estimate = None
        self._count = 0
