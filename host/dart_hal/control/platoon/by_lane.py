"""Steering of a platoon's car by its lidar: in the middle between two boards.

The external pose then only supplies the arc length, so its lateral error does not matter.
"""

from __future__ import annotations

from collections.abc import Sequence

from dart_hal.control.ending import MAX_POSE_GAP, Phase
from dart_hal.control.lane_follow import LaneFollower
from dart_hal.control.on_path import PathTracker
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.core.types import MotionEstimate, Scan


class BoardFollower(LaneFollower):
    """A lane follower without a speed of its own: in a platoon a car may stop and continue."""

    def _target_speed(self, speed: float) -> float:
        return speed

    def _check_end(self, t: float) -> None:
        if self.phase is Phase.FOLLOWING and t - self._lane_t > MAX_POSE_GAP:
            self._end(f"{self._describe_fault()} for {t - self._lane_t:.1f} s")


class LaneTracker(PathTracker):
    """A tracker whose ``offset`` [m] is from the middle of the lane; call ``add_scans`` before
    ``steer``.

    ``why``: no lane was found yet, or none for 0.5 s; the latter is permanent.
    """

    def __init__(self, path: Path, plant: Plant) -> None:
        super().__init__(path, plant)
        self.lane = BoardFollower(plant, cap=0.0)
        self._scans: Sequence[Scan] = ()

    def add_scans(self, scans: Sequence[Scan]) -> None:
        """Set the scans since the last call."""
        self._scans = scans

    def steer(self, motion: MotionEstimate) -> float:
        """See ``Tracker``."""
        self._predict_motion(motion, 0.0)
        command = self.lane.answer(motion.t, motion.speed, self._scans)
        self._scans = ()
        self.offset = self.lane.offset
        is_waiting = self.lane.phase is Phase.WAITING
        self.why = "no lane was found yet" if is_waiting else self.lane.why
        return command.steering
