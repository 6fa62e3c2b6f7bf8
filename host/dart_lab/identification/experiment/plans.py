"""What an experiment drives: segments as plain data, and the floor and time they take."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from dart_hal.calibration.schedule import SteeringPlan as Sweep

from .excitation import Signal
from .floor import Fence, Floor, Place, fence_of
from .track import Track

NAMES = ("friction", "motor", "steering", "delay", "tyres")
"""Tests of a sub-model, fitted once they are driven."""
PROBES = ("standstill", "crawl", "circles", "steps", "staircase", "weave", "rollouts", "launch",
          "laps")
"""Drives that tell causes apart which look alike in others; ``diagnose`` reads them."""


@dataclass(frozen=True, slots=True)
class Segment:
    """One stretch with one kind of command; it ends by the first of its conditions.

    seconds: at most. throttle: signal -1..1 (``relative``: on top of the mean
    that the speed loop held before), or None: ``speed`` [m/s] is held, 0 = roll
    out. steering: signal of the command -1..1, or "path" and "lane" (the
    track's). ``until``: "time"; "standstill"; "room" (``room`` m of lane are
    ahead); "heading" (yaw is a whole turn). top_speed [m/s], top_lateral [m/s2]
    end it, and so does, with ``rolls_out``, a lane that ends where the car would
    come to rest. ``measured``: what the
    experiment is about, not the way to it.
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
class Plan:
    """One experiment: name of the sub-model, segments in order, where and how fast.

    lane [m] and ``oval``: the track (0: none is needed). speed m/s at most;
    seconds and path [m] are those of the paper's car; ``reached`` m/s its top
    speed. sweep: the calibration's drive in place of segments. notes: what the
    reader must know before and after.
    """

    name: str
    segments: tuple[Segment, ...]
    floor: Floor
    place: Place
    speed: float
    lane: float = 0.0
    oval: bool = False
    seconds: float = 0.0
    path: float = 0.0
    reached: float = 0.0
    sweep: Sweep | None = None
    notes: tuple[str, ...] = field(default=())

    def track(self) -> Track | None:
        """A fresh track; it remembers how far the car is."""
        return Track(self.lane, oval=self.oval) if self.lane else None

    @property
    def fence(self) -> Fence:
        """Where the car is stopped."""
        return fence_of(self.floor, self.place)

    def __str__(self) -> str:
        return (f"drives about {self.path:.0f} m in about {self.seconds:.0f} s at up to "
                f"{self.reached:.1f} m/s on a free floor of {self.floor}; the car stands with "
                f"{self.place}")
