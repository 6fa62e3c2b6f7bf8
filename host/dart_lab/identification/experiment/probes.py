"""Drives that no sub-model is fitted to: each shows what looks alike in ordinary driving.

They hold constant what the others change. All are short, and all fit where
the delay test fits.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from dart_hal.core.config import CarFiles

from .circles import MEAN, MOST_LATERAL, Make, home, plan_in_field
from .excitation import Chirp, Constant, Levels
from .floor import Floor
from .plans import Plan, Segment
from .straight import one_pull

SIDES = (1.0, -1.0)
STANDING = 10.0  # s
CRAWL, CRAWLED = 0.35, 12.0
"""m/s, s to each side: a revolution of the gear with the marks takes longer than 0.1 s."""
TIGHT = (0.45, 0.85)  # steering commands of the circles
ROUND = 5.0  # s on each
SMALL, LARGE = 0.12, 0.45  # steps of the steering command to both sides of MEAN
STEP_HOLD, STEPS = 0.7, 8
STAIRS = (0.25, 0.4, 0.55, 0.7, 0.85, 0.7, 0.55, 0.4)
STAIR_HOLD = 1.0
WOVEN = 10.0  # s to each side
PULL = 0.32
LAUNCHES = (0.30, 0.40, 0.50, 0.60)
LAUNCH_LANE = 5.0
LAP_LANE, LAPPED = 2.5, 30.0  # m, s
LEAST_LANE = 1.5  # m


def plan_probe(name: str, files: CarFiles, floor: Floor, speed: float | None) -> Plan:
    """The plan of one of PROBES on this floor, rehearsed; speed [m/s] at most.

    Errors: ExperimentFailed when the floor is too small, with what is needed.
    """
    make, usual = _PROBES[name]
    return plan_in_field(name, files, floor, speed, usual, make)


def _standstill(_top: float, _longest: float) -> tuple[list[Segment], float]:
    return [Segment("standing", STANDING, throttle=Constant(0.0), steering=Constant(0.0),
                    measured=True)], 0.0


def _crawl(top: float, _longest: float) -> tuple[list[Segment], float]:
    """Slow and steady: the ripple of the ring, and play and trim without any slip."""
    out: list[Segment] = []
    for side in SIDES:
        lock = Constant(side * MEAN)
        out += [Segment("starting", 1.5, speed=top, steering=lock),
                Segment("rolling slowly", CRAWLED, speed=top, steering=lock, measured=True),
                *home(side * MEAN, side)]
    return out, 0.0


def _circles(top: float, _longest: float) -> tuple[list[Segment], float]:
    """Two radii, slow without slip and fast with it, to the left and to the right."""
    out: list[Segment] = []
    for side in SIDES:
        for lock in TIGHT:
            for speed in (0.45 * top, top):
                out.append(Segment("circle", ROUND, speed=speed, steering=Constant(side * lock),
                                   top_lateral=MOST_LATERAL, measured=True))
        out += home(side * TIGHT[-1], side)
    return out, 0.0


def _steps(top: float, _longest: float) -> tuple[list[Segment], float]:
    """Small and large steps of the steering at two speeds."""
    out: list[Segment] = []
    for side in SIDES:
        mean = side * MEAN
        for speed in (0.5 * top, top):
            out.append(Segment("getting up to speed", 2.0, speed=speed, steering=Constant(mean)))
            for size in (SMALL, LARGE):
                levels = (mean - size, mean + size) * (STEPS // 2)
                out.append(Segment("steering steps", STEP_HOLD * STEPS, speed=speed,
                                   steering=Levels(levels, STEP_HOLD), measured=True))
        out += home(mean, side)
    return out, 0.0


def _staircase(top: float, _longest: float) -> tuple[list[Segment], float]:
    """Every level from below and from above: play makes two angles of one command."""
    out: list[Segment] = []
    for side in SIDES:
        levels = tuple(side * s for s in (*STAIRS, *STAIRS[:1]))
        out += [Segment("getting up to speed", 1.5, speed=top, steering=Constant(levels[0])),
                Segment("steering up and down", STAIR_HOLD * len(levels), speed=top,
                        steering=Levels(levels, STAIR_HOLD), measured=True),
                *home(side * MEAN, side)]
    return out, 0.0


def _weave(top: float, _longest: float) -> tuple[list[Segment], float]:
    """A chirp of the steering, fast: what the tyres and the inertia add to the servo."""
    out: list[Segment] = []
    for side in SIDES:
        mean = side * MEAN
        out += [Segment("getting up to speed", 2.5, speed=top, steering=Constant(mean)),
                Segment("chirp", WOVEN, speed=top, measured=True,
                        steering=Chirp(mean, 0.8 * LARGE, 0.4, 3.0, WOVEN)),
                *home(mean, side)]
    return out, 0.0


def _rollouts(top: float, _longest: float) -> tuple[list[Segment], float]:
    """Accelerating and coasting on one circle: only the force at the wheels differs."""
    out: list[Segment] = []
    for side in SIDES:
        for lock in (*TIGHT, TIGHT[0]):
            steering = Constant(side * lock)
            out += [Segment("pull", 2.0, throttle=Constant(PULL), steering=steering,
                            top_speed=top, top_lateral=MOST_LATERAL, measured=True),
                    Segment("rolling out", 6.0, steering=steering, until="standstill",
                            measured=True)]
        out += home(side * TIGHT[0], side)
    return out, 0.0


def _launch(top: float, longest: float) -> tuple[list[Segment], float]:
    """From standstill with rising throttle, up to more than any other drive asks for."""
    lane = max(min(LAUNCH_LANE, longest - 0.1), LEAST_LANE)
    out: list[Segment] = []
    for throttle in LAUNCHES:
        out += one_pull(throttle, top, 0.9 * lane)
    return out, lane


def _laps(top: float, longest: float) -> tuple[list[Segment], float]:
    lane = max(min(LAP_LANE, longest - 0.1), LEAST_LANE)
    return [Segment("laps", LAPPED, speed=top, measured=True),
            Segment("rolling out", 8.0, until="standstill")], lane


_PROBES: Mapping[str, tuple[Make, float]] = MappingProxyType({
    "standstill": (_standstill, 0.5), "crawl": (_crawl, CRAWL), "circles": (_circles, 1.2),
    "steps": (_steps, 1.1), "staircase": (_staircase, 0.6), "weave": (_weave, 1.1),
    "rollouts": (_rollouts, 1.6), "launch": (_launch, 2.0), "laps": (_laps, 1.1)})
