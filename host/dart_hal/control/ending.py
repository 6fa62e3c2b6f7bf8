"""End of a drive: its reason, whether that was intended, and the stop."""

from __future__ import annotations

from math import inf

from dart_hal.control.stopping import StopManoeuvre, StuckDetector
from dart_hal.core.errors import UsageError
from dart_hal.core.numbers import is_number
from dart_hal.core.types import START_FRAME, MotionEstimate, TextEnum, Tracking

# Longest time without an accepted pose or lane [s], four scans; at 2 m/s dead reckoning is 2 cm off
# by then, and a car stops within the observed 2.5 m of a lane.
MAX_POSE_GAP = 0.5
# The same if the only cause is a silent lidar [s]: a gap of a second, and the next scan.
MAX_BRIDGED_GAP = 1.5
# Time for the first pose or the first lane [s]; the motor of an X4 needs 1 to 2 s to its speed.
MAX_START_WAIT = 5.0


def is_located(motion: MotionEstimate) -> bool:
    """Return whether a motion has a place in the room, by a fresh pose."""
    return motion.tracking is Tracking.TRACKING and motion.frame != START_FRAME


class Phase(TextEnum):
    """Phase of a drive; JOINING only on a path: outside the lane, before the car was inside."""

    WAITING = "WAITING"
    JOINING = "JOINING"
    FOLLOWING = "FOLLOWING"
    STOPPING = "STOPPING"
    ENDED = "ENDED"


class Ending:
    """Base class of drives that end.

    ``phase``; ``why``: reason of the end, empty before; ``good``: whether the end was intended;
    ``free`` [m/s]: limit by other cars.
    """

    def __init__(self) -> None:
        self._cap = self.free = inf
        self.phase = Phase.WAITING
        self.why = ""
        self.good = False
        self._speed = self._last_t = 0.0
        """Last target speed [m/s] and its time [s]: where a stop begins."""
        self._stuck_detector = StuckDetector()
        self._stop_manoeuvre: StopManoeuvre | None = None

    @property
    def cap(self) -> float:
        """Largest speed [m/s], 0 or more. Raises UsageError for what is none, such as NaN."""
        return self._cap

    @cap.setter
    def cap(self, speed: float) -> None:
        if not is_number(speed) or speed < 0.0:
            raise UsageError("cap is no speed limit", found=repr(speed),
                             expected="m/s, 0 or more", remedy="cap=0.5; 0 makes the car wait")
        self._cap = float(speed)

    def stop(self, why: str, *, good: bool = True) -> None:
        """Stop and end on request."""
        self._end(why, good=good)

    def _end(self, why: str, phase: Phase = Phase.STOPPING, *, good: bool = False) -> None:
        """Store the reason; the first one counts."""
        if not self.why:
            self.why = why
            self.good = good
            self.phase = phase

    def _stop_speed(self, motion: MotionEstimate) -> float:
        """Return the speed of the stop [m/s]; end the drive at rest, or if the car does not stop.
        """
        self._stop_manoeuvre = self._stop_manoeuvre or StopManoeuvre(self._speed, self._last_t)
        speed = self._stop_manoeuvre.speed(motion)
        if self._stop_manoeuvre.is_over:
            self.phase = Phase.ENDED
        if self._stop_manoeuvre.failure:
            self.why = f"{self.why}, but {self._stop_manoeuvre.failure}"
            self.good = False
        return speed
