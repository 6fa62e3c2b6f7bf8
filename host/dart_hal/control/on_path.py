"""Common parts of the trackers: where the car is and will be, relative to its path."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from math import inf
from typing import Protocol

from dart_hal.control.paths import Path
from dart_hal.control.plant import MotionPrediction, Plant, PredictedMotion
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray, MotionEstimate


class Tracker(Protocol):
    """A steering controller for a path.

    s [m]: arc length of the closest point, grows over laps; offset [m]: of the car to its left;
    speed [m/s]: limit of this tracker; angle_error [rad]: of the steering, learnt so far; why: set
    if it cannot continue, it then steers until the car is at rest; plan_log: new values of its
    plan, for ``car.log``.

    May be set: pace, the target speed [m/s] at an arc length; clock [s], which runs while a tracker
    computes (virtual time does not).
    """

    s: float
    offset: float
    speed: float
    why: str
    plan_log: dict[str, FloatArray]
    pace: Callable[[float], float]
    clock: Callable[[], float]

    @property
    def angle_error(self) -> float:
        """See the class."""

    def begin(self, s: float) -> None:
        """Start near arc length s [m] and forget earlier commands."""

    def steer(self, motion: MotionEstimate) -> float:
        """Return the angle [rad] of the road wheels to command at ``motion.t``."""


class PathTracker(ABC):
    """Base class of trackers. Raises UsageError for what is no path, and for what is no plant."""

    def __init__(self, path: Path, plant: Plant) -> None:
        if not isinstance(path, Path):
            raise UsageError("a tracker follows a path", found=type(path).__name__,
                             expected="a Path", remedy="figure_of_eight(0.75)")
        if not isinstance(plant, Plant):
            raise UsageError("a tracker needs the car as a plant", found=type(plant).__name__,
                             expected="a Plant", remedy="plant_of(car.files)")
        self.path = path
        self.plant = plant
        self.s = self.offset = 0.0
        self.speed = inf
        self.why = ""
        self.plan_log: dict[str, FloatArray] = {}
        self.pace: Callable[[float], float] = lambda s: 1.0
        self.clock: Callable[[], float] = lambda: 0.0
        self._prediction = MotionPrediction(plant)

    def begin(self, s: float) -> None:
        """See ``Tracker``."""
        self.s = s
        self._prediction.reset()

    @property
    def angle_error(self) -> float:
        """See ``Tracker``."""
        return self._prediction.angle_error

    @abstractmethod
    def steer(self, motion: MotionEstimate) -> float:
        """See ``Tracker``."""

    def _predict_motion(self, motion: MotionEstimate, horizon: float
                        ) -> tuple[PredictedMotion, float]:
        """Return the motion ``horizon`` s later and the arc length of its closest point."""
        pose = motion.pose
        self.s = self.path.closest(pose.x, pose.y, self.s)
        self.offset = self.path.offset(pose.x, pose.y, self.s)
        future = self._prediction.predict(motion, motion.t + horizon)
        return future, self.path.closest(future.x, future.y, self.s)

    def _send_steering(self, motion: MotionEstimate, angle: float) -> float:
        """Limit and record a command; return the angle [rad]."""
        low, high = self.plant.lock
        angle = min(max(self._prediction.compensate(angle), low), high)
        self._prediction.record_command(motion.t, angle)
        return angle
