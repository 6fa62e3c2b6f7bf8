"""Drives for the diagnosis: each separates causes that are confounded in ordinary driving.

They keep constant what other drives change. All are short, and need no more floor than the delay
test.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from dart_hal.core.config import CarFiles

from .circles import MAX_RAMP_LATERAL, MEAN_STEERING, MakeSegments, home, plan_in_field
from .excitation import Chirp, Constant, Levels
from .floor import Floor
from .plans import ExperimentPlan, Segment
from .straight import one_pull

SIDES = (1.0, -1.0)
# [s]
STANDSTILL_TIME = 10.0
# [m/s], [s to each side] A revolution of the gear with the marks takes longer than 0.1 s.
CRAWL_SPEED = 0.35
CRAWL_TIME = 12.0
# Steering commands of the circles, and time [s] on each.
CIRCLE_STEERING = (0.45, 0.85)
CIRCLE_TIME = 5.0
# Steps of the steering command to both sides of MEAN_STEERING.
SMALL_STEP = 0.12
LARGE_STEP = 0.45
STEP_HOLD = 0.7
STEP_COUNT = 8
STAIR_LEVELS = (0.25, 0.4, 0.55, 0.7, 0.85, 0.7, 0.55, 0.4)
STAIR_HOLD = 1.0
# [s] To each side.
WEAVE_TIME = 10.0
PULL_THROTTLE = 0.32
LAUNCH_THROTTLES = (0.30, 0.40, 0.50, 0.60)
LAUNCH_LANE = 5.0
# Length of a lane [m], and time on the laps [s].
LAP_LANE = 2.5
LAP_TIME = 30.0
# [m]
MIN_LANE = 1.5


def plan_probe(name: str, files: CarFiles, floor: Floor, speed: float | None) -> ExperimentPlan:
    """Plan one of PROBES for this floor, with a rehearsal; speed [m/s] at most.

    Raises ExperimentFailed if the floor is too small, with the size that is needed.
    """
    make, usual = _PROBES[name]
    return plan_in_field(name, files, floor, speed, usual, make)


def _standstill(_top: float, _longest: float) -> tuple[list[Segment], float]:
    return [Segment("at rest", STANDSTILL_TIME, throttle=Constant(0.0), steering=Constant(0.0),
                    measured=True)], 0.0


def _crawl(top: float, _longest: float) -> tuple[list[Segment], float]:
    """Drive slowly and steadily: shows the ripple of the ring, and play and trim without slip."""
    out: list[Segment] = []
    for side in SIDES:
        lock = Constant(side * MEAN_STEERING)
        out += [Segment("starting", 1.5, speed=top, steering=lock),
                Segment("rolling slowly", CRAWL_TIME, speed=top, steering=lock, measured=True),
                *home(side * MEAN_STEERING, side)]
    return out, 0.0


def _circles(top: float, _longest: float) -> tuple[list[Segment], float]:
    """Drive two radii to both sides, slowly without slip and fast with it."""
    out: list[Segment] = []
    for side in SIDES:
        for lock in CIRCLE_STEERING:
            for speed in (0.45 * top, top):
                out.append(Segment("circle", CIRCLE_TIME, speed=speed,
                                   steering=Constant(side * lock),
                                   top_lateral=MAX_RAMP_LATERAL, measured=True))
        out += home(side * CIRCLE_STEERING[-1], side)
    return out, 0.0


def _steps(top: float, _longest: float) -> tuple[list[Segment], float]:
    """Drive small and large steps of the steering at two speeds."""
    out: list[Segment] = []
    for side in SIDES:
        mean = side * MEAN_STEERING
        for speed in (0.5 * top, top):
            out.append(Segment("getting up to speed", 2.0, speed=speed, steering=Constant(mean)))
            for size in (SMALL_STEP, LARGE_STEP):
                levels = (mean - size, mean + size) * (STEP_COUNT // 2)
                out.append(Segment("steering steps", STEP_HOLD * STEP_COUNT, speed=speed,
                                   steering=Levels(levels, STEP_HOLD), measured=True))
        out += home(mean, side)
    return out, 0.0


def _staircase(top: float, _longest: float) -> tuple[list[Segment], float]:
    """Drive every level from below and from above: play gives two angles for one command."""
    out: list[Segment] = []
    for side in SIDES:
        levels = tuple(side * s for s in (*STAIR_LEVELS, *STAIR_LEVELS[:1]))
        out += [Segment("getting up to speed", 1.5, speed=top, steering=Constant(levels[0])),
                Segment("steering up and down", STAIR_HOLD * len(levels), speed=top,
                        steering=Levels(levels, STAIR_HOLD), measured=True),
                *home(side * MEAN_STEERING, side)]
    return out, 0.0


def _weave(top: float, _longest: float) -> tuple[list[Segment], float]:
    """Drive a fast chirp of the steering: tyres and inertia add to the lag of the servo."""
    out: list[Segment] = []
    for side in SIDES:
        mean = side * MEAN_STEERING
        out += [Segment("getting up to speed", 2.5, speed=top, steering=Constant(mean)),
                Segment("chirp", WEAVE_TIME, speed=top, measured=True,
                        steering=Chirp(mean, 0.8 * LARGE_STEP, 0.4, 3.0, WEAVE_TIME)),
                *home(mean, side)]
    return out, 0.0


def _rollouts(top: float, _longest: float) -> tuple[list[Segment], float]:
    """Accelerate and coast on one circle: only the force at the wheels differs."""
    out: list[Segment] = []
    for side in SIDES:
        for lock in (*CIRCLE_STEERING, CIRCLE_STEERING[0]):
            steering = Constant(side * lock)
            out += [Segment("pull", 2.0, throttle=Constant(PULL_THROTTLE), steering=steering,
                            top_speed=top, top_lateral=MAX_RAMP_LATERAL, measured=True),
                    Segment("rolling out", 6.0, steering=steering, until="standstill",
                            measured=True)]
        out += home(side * CIRCLE_STEERING[0], side)
    return out, 0.0


def _launch(top: float, longest: float) -> tuple[list[Segment], float]:
    """Launch from standstill with increasing throttle, above that of any other drive."""
    lane = max(min(LAUNCH_LANE, longest - 0.1), MIN_LANE)
    out: list[Segment] = []
    for throttle in LAUNCH_THROTTLES:
        out += one_pull(throttle, top, 0.9 * lane)
    return out, lane


def _laps(top: float, longest: float) -> tuple[list[Segment], float]:
    lane = max(min(LAP_LANE, longest - 0.1), MIN_LANE)
    return [Segment("laps", LAP_TIME, speed=top, measured=True),
            Segment("rolling out", 8.0, until="standstill")], lane


_PROBES: Mapping[str, tuple[MakeSegments, float]] = MappingProxyType({
    "standstill": (_standstill, 0.5), "crawl": (_crawl, CRAWL_SPEED), "circles": (_circles, 1.2),
    "steps": (_steps, 1.1), "staircase": (_staircase, 0.6), "weave": (_weave, 1.1),
    "rollouts": (_rollouts, 1.6), "launch": (_launch, 2.0), "laps": (_laps, 1.1)})
