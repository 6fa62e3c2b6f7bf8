"""Steering of a platoon's car by what its own lidar sees beside it: the middle between two boards.

The pose in the room then only says how far along the path the car is: an error of it across, which
a tracker on the path follows, is none here.
"""

from __future__ import annotations

from collections.abc import Sequence

from dart_hal.control.ending import PATIENCE, Phase
from dart_hal.control.lane_follow import LaneFollower
from dart_hal.control.on_path import OnPath
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.core.types import MotionEstimate, Scan


class Boards(LaneFollower):
    """A lane without a speed of its own: who follows in a platoon may stand, and may go on."""

    def _wanted(self, speed: float) -> float:
        return speed

    def _judge(self, t: float) -> None:
        if self.phase is Phase.FOLLOWING and t - self._whole > PATIENCE:
            self._end(f"{self._fault()} for {t - self._whole:.1f} s")


class ByLane(OnPath):
    """A tracker whose ``offset`` [m] is from the middle of the lane; ``look`` before ``steer``.
    ``why``: no lane is seen yet, or for 0.5 s; the latter for good."""

    def __init__(self, path: Path, plant: Plant) -> None:
        super().__init__(path, plant)
        self.lane = Boards(plant, cap=0.0)
        self._scans: Sequence[Scan] = ()

    def look(self, scans: Sequence[Scan]) -> None:
        """What came since the last."""
        self._scans = scans

    def steer(self, motion: MotionEstimate) -> float:
        """See ``Tracker``."""
        self._see(motion, 0.0)
        command = self.lane.answer(motion.t, motion.speed, self._scans)
        self._scans = ()
        self.offset = self.lane.offset
        waits = self.lane.phase is Phase.WAITING
        self.why = "no lane was seen yet" if waits else self.lane.why
        return command.steering
