"""Stop of a car by a speed ramp, and detection of a car that does not move though commanded to."""

from __future__ import annotations

from math import inf

from dart_hal.control.lap import CRAWL_SPEED
from dart_hal.core.types import MotionEstimate

# Deceleration of a stop, and of a car that rolls out from a crawl (1.0 on the car of the paper)
# [m/s2].
STOP_DECELERATION = 2.0
ROLL_DECELERATION = 0.8
# A car is at rest below this speed [m/s] for this time [s].
REST_SPEED = 0.03
REST_TIME = 0.2
# Time at neutral in which the car has to come to rest [s]: without a brake a car rolls out from 2
# m/s in 2.5 s. Beyond it the car is on a slope or pushed, and no command stops it.
MAX_ROLL_TIME = 3.0

# Time in which a car with a speed command has to move [s], and the largest time counted for one
# call: arming takes 2 s without commands. A blocked motor draws its largest current.
STUCK_TIME = 3.0
MAX_UPDATE_GAP = 0.1


class StuckDetector:
    """Time for which a car with a speed command has been at rest [s]; call once per State."""

    def __init__(self) -> None:
        self._t = inf
        self._rest_time = 0.0

    def is_stuck(self, t: float, speed: float) -> bool:
        """Return whether that is too long, at t [s] and a speed [m/s]."""
        dt = min(max(t - self._t, 0.0), MAX_UPDATE_GAP)
        self._t = t
        self._rest_time = self._rest_time + dt if abs(speed) < REST_SPEED else 0.0
        return self._rest_time > STUCK_TIME


class StopManoeuvre:
    """A stop from ``speed`` [m/s], begun at ``t`` [s]. ``is_over``: at rest, or given up."""

    def __init__(self, speed: float, t: float) -> None:
        self.is_over = False
        self.failure = ""
        """Why the stop was given up; empty if it was not."""
        self._speed = speed
        self._t = t
        self._rest_time = self._neutral_time = 0.0

    def speed(self, motion: MotionEstimate) -> float:
        """Return the target speed [m/s]; 0 is neutral. It falls with every call, so it ends."""
        dt = motion.t - self._t
        self._t = motion.t
        speed = max(min(self._speed, max(motion.speed, 0.0)) - STOP_DECELERATION * dt, 0.0)
        self._speed = speed if speed > CRAWL_SPEED else 0.0
        self._rest_time = self._rest_time + dt if abs(motion.speed) < REST_SPEED else 0.0
        self._neutral_time += 0.0 if self._speed else dt
        if self._rest_time > REST_TIME:
            self.is_over = True
        elif self._neutral_time > MAX_ROLL_TIME:
            self.is_over = True
            self.failure = (
                f"it still rolls at {motion.speed:.2f} m/s, {MAX_ROLL_TIME:g} s after neutral"
            )
        return self._speed
