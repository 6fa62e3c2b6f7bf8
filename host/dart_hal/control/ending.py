"""How a drive ends: why, whether it was asked for, and the stop by which it comes to rest."""

from __future__ import annotations

from enum import Enum

from dart_hal.control.stopping import Standing, Stopping
from dart_hal.core.types import MotionEstimate

# s without a believed pose, or without a lane, four scans; at 2 m/s dead reckoning is 2 cm off by
# then, and a car stops within the 2.5 m of a lane that it saw.
PATIENCE = 0.5
# s without a pose, where nothing speaks against the last but that the lidar is silent: a gap of a
# second, and the scan after it.
BRIDGED = 1.5
# s for the first pose, or the first lane; the motor of an X4 takes 1 to 2 s to its pace.
WAIT = 5.0


class Phase(str, Enum):
    """Where the drive is; JOINING only on a path: off the lane, before it was within."""

    WAITING = "WAITING"
    JOINING = "JOINING"
    FOLLOWING = "FOLLOWING"
    STOPPING = "STOPPING"
    ENDED = "ENDED"

    def __str__(self) -> str:
        return self.value


class Ending:
    """What drives that end have in common.

    ``phase``; ``why``: it ends, empty before; ``good``: whether that was asked for.
    """

    def __init__(self) -> None:
        self.phase = Phase.WAITING
        self.why = ""
        self.good = False
        self._speed = self._before = 0.0
        """m/s that was asked for last, and when [s]: where a stop begins."""
        self._standing = Standing()
        self._stopping: Stopping | None = None

    def stop(self, why: str, *, good: bool = True) -> None:
        """Slow down and end, at somebody's wish."""
        self._end(why, good=good)

    def _end(self, why: str, phase: Phase = Phase.STOPPING, *, good: bool = False) -> None:
        """The first reason counts."""
        if not self.why:
            self.why = why
            self.good = good
            self.phase = phase

    def _stops(self, motion: MotionEstimate) -> float:
        """Speed of a stop [m/s]; ends the drive at rest, or where the car does not come to it."""
        self._stopping = self._stopping or Stopping(self._speed, self._before)
        speed = self._stopping.speed(motion)
        if self._stopping.over:
            self.phase = Phase.ENDED
        if self._stopping.rolls:
            self.why = f"{self.why}, but {self._stopping.rolls}"
            self.good = False
        return speed
