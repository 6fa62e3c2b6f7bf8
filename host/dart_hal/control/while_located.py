"""Driving at one speed as long as somebody knows where the car is."""

from __future__ import annotations

from math import inf

from dart_hal.control.ending import PATIENCE, WAIT, Ending, Phase
from dart_hal.control.stopping import STUCK
from dart_hal.core.types import MotionEstimate


class WhileLocated(Ending):
    """One drive. ``answer`` once per State, until ``phase`` is ENDED; ``why`` then tells the end.

    The car stands until there is a pose; without one for ``PATIENCE`` s it slows down to rest.
    speed [m/s]; duration [s] from where it begins.
    """

    def __init__(self, speed: float, duration: float = inf) -> None:
        super().__init__()
        self._wanted = speed
        self._duration = duration
        self._begun = -inf

    def answer(self, motion: MotionEstimate, placed: float) -> float:
        """Speed to ask for [m/s]; placed [s]: when the newest pose came, -inf before the first."""
        t = motion.t
        if self._begun == -inf:
            self._begun = self._before = t
        if self.phase is Phase.WAITING:
            if t - placed > PATIENCE:
                if t - self._begun > WAIT:
                    self._end(f"no pose came within {WAIT:g} s", Phase.ENDED)
                return 0.0
            self.phase = Phase.FOLLOWING
            self._begun = t
        if self.phase is Phase.FOLLOWING:
            self._judge(motion, placed)
        if self.phase is Phase.ENDED:
            return 0.0
        if self.phase is Phase.STOPPING:
            return self._stops(motion)
        self._speed = self._wanted
        self._before = t
        return self._wanted

    def _judge(self, motion: MotionEstimate, placed: float) -> None:
        t = motion.t
        if t - placed > PATIENCE:
            self._end(f"the pose was lost for {t - placed:.1f} s")
        elif self._standing.stuck(t, motion.speed):
            self._end(f"the car does not move, though asked to for {STUCK:g} s")
        elif t - self._begun > self._duration:
            self._end(f"the time of {self._duration:g} s is over", good=True)
