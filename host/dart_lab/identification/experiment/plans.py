"""Plan of an experiment: segments as plain data, and the floor and time that they need."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from dart_hal.calibration.schedule import SteeringPlan as Sweep

from .excitation import Signal
from .floor import Fence, Floor, StartPlace, make_fence
from .track import DriveTrack

# Tests of a sub-model, which is fitted after the drive.
EXPERIMENTS = ("friction", "motor", "steering", "delay", "tyres")
# Drives that separate causes which are confounded in other drives; ``diagnose`` reads them.
PROBES = ("standstill", "crawl", "circles", "steps", "staircase", "weave", "rollouts", "launch",
          "laps")


@dataclass(frozen=True, slots=True)
class Segment:
    """One part of a drive with one kind of command; it ends by the first of its conditions.

    seconds: largest duration. throttle: signal -1..1 (relative: added to the mean of the speed
    loop before), or None: ``speed`` [m/s] is controlled, 0 = roll out. steering: signal of the
    command -1..1, or "path" or "lane" of the track. until: "time"; "standstill"; "room" (``room``
    [m] of lane are ahead); "heading" (yaw is a whole turn). top_speed [m/s], top_lateral [m/s2]:
    limits that end it. rolls_out: it also ends where the car would come to rest at the end of the
    lane. measured: part of the test, not of a transfer.
    """

    name: str
    seconds: float
    throttle: Signal | None = None
    speed: float = 0.0
    steering: Signal | str = "path"
    until: str = "time"
    room: float = 0.0
    top_speed: float = math.inf
    top_lateral: float = math.inf
    relative: bool = False
    rolls_out: bool = False
    measured: bool = False


@dataclass(frozen=True, slots=True)
class ExperimentPlan:
    """One experiment: name of the sub-model, segments in order, floor and top speed.

    lane [m], oval: the track (0: none). speed [m/s]: limit; seconds, path [m], reached [m/s]:
    duration, distance and top speed of the rehearsal. sweep: the calibration's drive in place of
    segments. notes: sentences for the user.
    """

    name: str
    segments: tuple[Segment, ...]
    floor: Floor
    place: StartPlace
    speed: float
    lane: float = 0.0
    oval: bool = False
    seconds: float = 0.0
    path: float = 0.0
    reached: float = 0.0
    sweep: Sweep | None = None
    notes: tuple[str, ...] = field(default=())

    def track(self) -> DriveTrack | None:
        """Make a new track, which has the progress of the car as its state."""
        return DriveTrack(self.lane, oval=self.oval) if self.lane else None

    @property
    def fence(self) -> Fence:
        """Limits of the car's position, beyond which it is stopped."""
        return make_fence(self.floor, self.place)

    def __str__(self) -> str:
        return (f"drives about {self.path:.0f} m in about {self.seconds:.0f} s at up to "
                f"{self.reached:.1f} m/s on a free floor of {self.floor}; the car starts with "
                f"{self.place}")
