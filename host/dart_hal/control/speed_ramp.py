"""Slower bends while the model of the car is not confirmed: a share of the lateral acceleration.

A car whose tyres are 20 to 30 % worse than its model leaves the lane at the speed that the model
allows, and a car with weak rear tyres spins without an offset before. Both show earlier in the
error of the steering angle that the prediction learns from the yaw rate.

    target speed = sqrt(share) * speed of the profile * (1 - slowdown by the present offset)

The share of the lateral acceleration starts low. It grows after each stretch in which the car used
it with a small offset and a small error of the angle, and it falls otherwise.
"""

from __future__ import annotations

from math import sqrt

# First share of the lateral acceleration, the least one, and its change after a stretch.
FIRST_SHARE = 0.5
MIN_SHARE = 0.4
SHARE_STEP = 0.1
# Length of a stretch [m]: a bend of 0.75 m radius by 150 deg.
STRETCH = 2.0
# A stretch confirms the model if the acceleration was used to this part of the share, the offset
# stayed below this part of the lane, and the error of the angle below this one [rad]. Of 20 models
# 20 to 30 % off, those that held the lane had errors up to 0.026 rad at a share of 0.8, those that
# left it 0.046 and more.
MIN_USE = 0.8
MAX_GOOD_OFFSET = 0.3
MAX_GOOD_ERROR = 0.02
# Beyond these the share falls after the stretch.
BAD_OFFSET = 0.4
BAD_ERROR = 0.03
# Beyond these it falls at once, by this time constant [s].
ALARM_OFFSET = 0.5
ALARM_ERROR = 0.045
FALL_TIME = 0.5
# The present offset slows the car down from this part of the lane on, to half at most.
FREE_OFFSET = 0.25
MIN_SLOWDOWN_FACTOR = 0.5


class SpeedRamp:
    """Factor of the profile's speed in bends, learnt during a drive; ``share`` of the acceleration.
    """

    def __init__(self) -> None:
        self.share = FIRST_SHARE
        self._offset = 0.0
        self._start_s: float | None = None
        self._last_t = 0.0
        self._use = self._max_offset = self._max_error = 0.0

    @property
    def factor(self) -> float:
        """Factor of the speed."""
        excess = max(self._offset - FREE_OFFSET, 0.0)
        return sqrt(self.share) * max(1.0 - excess, MIN_SLOWDOWN_FACTOR)

    def update(self, t: float, s: float, speed_ratio: float, offset: float, error: float) -> None:
        """Learn from the motion at t [s].

        s [m]: arc length; speed_ratio: speed relative to the profile; offset: relative to the half
        width of the lane; error [rad]: of the steering angle.

        1. Fall at once if offset or error are beyond the alarm.
        2. Keep the largest use, offset and error of the stretch.
        3. At its end, raise or lower the share.
        """
        if self._start_s is None:
            self._start_stretch(s)
            self._last_t = t
        dt = t - self._last_t
        self._last_t = t
        self._offset = abs(offset)
        if self._offset > ALARM_OFFSET or abs(error) > ALARM_ERROR:
            self.share = max(MIN_SHARE, self.share * (1.0 - min(dt / FALL_TIME, 1.0)))
        self._use = max(self._use, speed_ratio * speed_ratio)
        self._max_offset = max(self._max_offset, self._offset)
        self._max_error = max(self._max_error, abs(error))
        if self._start_s is None or s - self._start_s < STRETCH:
            return
        is_good = self._max_offset < MAX_GOOD_OFFSET and self._max_error < MAX_GOOD_ERROR
        if is_good and self._use > MIN_USE * self.share:
            self.share = min(1.0, self.share + SHARE_STEP)
        elif self._max_offset > BAD_OFFSET or self._max_error > BAD_ERROR:
            self.share = max(MIN_SHARE, self.share - SHARE_STEP)
        self._start_stretch(s)

    def _start_stretch(self, s: float) -> None:
        self._start_s = s
        self._use = self._max_offset = self._max_error = 0.0
