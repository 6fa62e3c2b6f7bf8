"""Driving at a constant speed while poses arrive."""

from __future__ import annotations

from math import inf

from dart_hal.control.ending import MAX_POSE_GAP, MAX_START_WAIT, Ending, Phase
from dart_hal.control.stopping import STUCK_TIME
from dart_hal.core.types import MotionEstimate


class WhileLocated(Ending):
    """One drive. Call ``answer`` once per State until ``phase`` is ENDED; ``why`` is then the
    reason.

    The car waits until there is a pose; without one for ``MAX_POSE_GAP`` s it slows down to rest.
    speed [m/s]; duration [s]: from the beginning.
    """

    def __init__(self, speed: float, duration: float = inf) -> None:
        super().__init__()
        self._target_speed = speed
        self._duration = duration
        self._start_t = -inf

    def answer(self, motion: MotionEstimate, pose_t: float) -> float:
        """Return the speed to command [m/s]; pose_t [s]: time of the newest pose, -inf without one.
        """
        t = motion.t
        if self._start_t == -inf:
            self._start_t = self._last_t = t
        if self.phase is Phase.WAITING:
            if t - pose_t > MAX_POSE_GAP:
                if t - self._start_t > MAX_START_WAIT:
                    self._end(f"no pose came within {MAX_START_WAIT:g} s", Phase.ENDED)
                return 0.0
            self.phase = Phase.FOLLOWING
            self._start_t = t
        if self.phase is Phase.FOLLOWING:
            self._check_end(motion, pose_t)
        if self.phase is Phase.ENDED:
            return 0.0
        if self.phase is Phase.STOPPING:
            return self._stop_speed(motion)
        self._speed = self._target_speed
        self._last_t = t
        return self._target_speed

    def _check_end(self, motion: MotionEstimate, pose_t: float) -> None:
        """End the drive if a condition requires it."""
        t = motion.t
        if t - pose_t > MAX_POSE_GAP:
            self._end(f"the pose was lost for {t - pose_t:.1f} s")
        elif self._stuck_detector.is_stuck(t, motion.speed):
            self._end(f"the car does not move, though commanded to for {STUCK_TIME:g} s")
        elif t - self._start_t > self._duration:
            self._end(f"the time of {self._duration:g} s is over", good=True)
