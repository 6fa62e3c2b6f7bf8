"""Whether what a predecessor tells of its acceleration is what it does.

    vr <- (vr + dt (a_i - a_told)) (1 - K) + K (v_i - v_p),    K = 0.05

A told acceleration that is not driven lets the observed relative speed part from the measured one.
Source: Lorenzo-Lyons/Distributed-Attack-Resilient-Platooning (anomaly detector of the cars).
"""

from __future__ import annotations

# -, m/s and samples at 10 Hz: a lie of 1 m/s2 ends at 1.9 m/s and is found within 1.2 s.
GAIN = 0.05
THRESHOLD = 0.5
IN_A_ROW = 5
# s for which these are.
STEP = 0.1


class Detector:
    """One per follower; ``attacked`` once it was found, for good."""

    def __init__(self, dt: float) -> None:
        self._dt = dt
        self._gain = GAIN * dt / STEP
        self._row = IN_A_ROW * STEP / dt
        self.attacked = False
        self._estimate: float | None = None
        self._count = 0

    def look(self, speed: float, ahead: float, own: float, told: float) -> bool:
        """speed, ahead [m/s]: own and predecessor's; own, told [m/s2]: accelerations."""
        relative = speed - ahead
        if self._estimate is None:
            self._estimate = relative
        k = self._gain
        self._estimate = ((self._estimate + self._dt * (own - told)) * (1.0 - k) + k * relative)
        beyond = abs(relative - self._estimate) > THRESHOLD
        self._count = self._count + 1 if beyond else 0
        self.attacked = self.attacked or self._count > self._row
        return self.attacked

    def forget(self) -> None:
        """Nothing was heard for a while: begin anew, though an attack stays one."""
        self._estimate = None
        self._count = 0
