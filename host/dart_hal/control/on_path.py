"""What every tracker is and knows: where the car is and will be, beside its path."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from math import inf
from typing import Protocol

from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant, Prediction, Where
from dart_hal.core.types import FloatArray, MotionEstimate


class Tracker(Protocol):
    """s [m]: arc length of the closest point, grows over laps; offset [m]: to the left of it.

    speed [m/s]: no faster, for this tracker's sake; why: it can go on no longer, and steers until
    the car stands; told: what is new of its plan, for ``car.log``. To be set:
    pace, the speed [m/s] that is wanted at an arc length; clock [s], which goes on while a tracker
    thinks (in virtual time it does not).
    """

    s: float
    offset: float
    speed: float
    why: str
    told: dict[str, FloatArray]
    pace: Callable[[float], float]
    clock: Callable[[], float]

    def begin(self, s: float) -> None:
        """The car is near arc length s [m]; nothing is known of commands before."""

    def steer(self, motion: MotionEstimate) -> float:
        """Angle [rad] of the road wheels to command at ``motion.t``."""


class OnPath(ABC):
    """What trackers share."""

    def __init__(self, path: Path, plant: Plant) -> None:
        self.path = path
        self.plant = plant
        self.s = self.offset = 0.0
        self.speed = inf
        self.why = ""
        self.told: dict[str, FloatArray] = {}
        self.pace: Callable[[float], float] = lambda s: 1.0
        self.clock: Callable[[], float] = lambda: 0.0
        self._prediction = Prediction(plant)

    def begin(self, s: float) -> None:
        self.s = s
        self._prediction.reset()

    @abstractmethod
    def steer(self, motion: MotionEstimate) -> float:
        """See ``Tracker``."""

    def _see(self, motion: MotionEstimate, ahead: float) -> tuple[Where, float]:
        """Motion ``ahead`` s later, and the arc length of its closest point."""
        pose = motion.pose
        self.s = self.path.closest(pose.x, pose.y, self.s)
        self.offset = self.path.offset(pose.x, pose.y, self.s)
        where = self._prediction.at(motion, motion.t + ahead)
        return where, self.path.closest(where.x, where.y, self.s)

    def _command(self, motion: MotionEstimate, angle: float) -> float:
        low, high = self.plant.lock
        angle = min(max(self._prediction.asked(angle), low), high)
        self._prediction.sent(motion.t, angle)
        return angle
