"""Plans of delay and tyres: circles to the left and to the right, and lanes for the throttle."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from dart_hal.core.config import CarFiles
from dart_hal.core.errors import ExperimentFailed

from .excitation import Chirp, Constant, Levels, Ramp, Sine, random_steps
from .floor import MARGIN, Floor, Place
from .plans import Plan, Segment
from .rehearsal import rehearse
from .track import TURN

TOP = {"delay": 1.2, "tyres": 1.6}
"""m/s unless something else is asked for."""
OTHER_CARS = 1.25
"""By how much wider another car of this class may turn than the one of the rehearsal."""
SLOW = 0.5
"""m/s between two tests."""
MEAN, SWING = 0.5, 0.4
"""Steering command of the delay test: about a middle that leads round and round."""
DELAY_SPEED = 0.65
"""Share of the top speed at which the steering is tested."""
HOLD = 0.45
"""s between two steps: four times what delays and lags of these cars add up to."""
STEPS = (0.32, 0.16, 0.30, 0.20, 0.34, 0.18)
LANE, LANES = 3.0, 8
"""m and number of the lanes on which the throttle is stepped through these levels."""
TYRE_STEERING = 0.75
MOST_LATERAL = 2.4
"""m/s2 that end the ramp: the front tyres of the paper's car give 2.9 at most."""
RAMP, RAMP_SECONDS = 0.12, 40.0
"""Throttle that is added, and how slowly: every instant is a steady circle."""
TYRES_ON_BOARD = (
    "on board there is no lateral velocity: speed and yaw rate tell the understeer gradient, one "
    "combination of front and rear stiffness, and how it grows with lateral acceleration; front "
    "and rear each, and the yaw inertia, need motion capture",)


Make = Callable[[float, float], tuple[list[Segment], float]]
"""(top speed [m/s], longest lane [m] on the floor) -> (segments, lane [m], 0: needs none)."""


def plan_circles(name: str, files: CarFiles, floor: Floor, speed: float | None) -> Plan:
    """The plan of "delay" or "tyres" on this floor, rehearsed; speed [m/s] at most.

    Errors: ExperimentFailed when the floor is too small, with what is needed.
    """
    make, notes = (_delay, ()) if name == "delay" else (_tyres, TYRES_ON_BOARD)
    return plan_in_field(name, files, floor, speed, TOP[name], make, notes)


def plan_in_field(name: str, files: CarFiles, floor: Floor, speed: float | None, usual: float,
                  make: Make, notes: tuple[str, ...] = ()) -> Plan:
    """A plan that is rehearsed in an open field, and then put in the middle of the floor.

    usual [m/s]: without ``speed`` it is that, or less on a small floor. Errors:
    ExperimentFailed when the floor is too small, with what is needed.
    """
    top = speed if speed is not None else usual
    rehearsed, place, needed = _tried(name, files, floor, top, make, notes)
    if not _fits(needed, floor):
        slower = (0.1 * tenth for tenth in range(round(10.0 * top) - 2, 5, -2))
        tries = ((v, _tried(name, files, floor, v, make, notes)) for v in slower)
        found = next(((v, t) for v, t in tries if _fits(t[2], floor)), None)
        if found is None or speed is not None:
            raise ExperimentFailed(
                f"a floor of {floor} is too small for the {name} test at {top:.1f} m/s",
                found=f"{floor}", expected=f"{_up(needed.length)} m along the car and "
                f"{_up(needed.width)} m across",
                remedy="a larger floor" if found is None
                else f"--speed {found[0]:.1f} fits on this floor")
        rehearsed, place, needed = found[1]
    spare = Place(place.behind + 0.5 * (floor.length - needed.length),
                  place.right + 0.5 * (floor.width - needed.width))
    return replace(rehearsed, floor=floor, place=spare)


def _tried(name: str, files: CarFiles, floor: Floor, top: float, make: Make,
           notes: tuple[str, ...]) -> tuple[Plan, Place, Floor]:
    """(the plan rehearsed in an open field, where the car stands, the floor it needs)."""
    longest = (floor.length - 2.0 * MARGIN) / OTHER_CARS - 2.0 * TURN
    segments, lane = make(top, longest)
    plan, drive = rehearse(Plan(
        name, tuple(segments), Floor(200.0, 200.0), Place(100.0, 100.0), top, lane=lane,
        oval=True, notes=notes), files)
    xs = [OTHER_CARS * f.pose.x for f in drive.frames]
    ys = [OTHER_CARS * f.pose.y for f in drive.frames]
    place = Place(MARGIN - min(xs), MARGIN - min(ys))
    return plan, place, Floor(max(xs) - min(xs) + 2.0 * MARGIN, max(ys) - min(ys) + 2.0 * MARGIN)


def _fits(needed: Floor, floor: Floor) -> bool:
    return needed.length <= floor.length and needed.width <= floor.width


def _up(metres: float) -> str:
    return f"{math.ceil(10.0 * metres) / 10.0:.1f}"


def _throttle_steps(top: float, lane: float) -> list[Segment]:
    """Up and down on the lanes: turning would brake the car, so that is done apart."""
    out: list[Segment] = []
    for number in range(LANES):
        levels = STEPS[number % 2:] + STEPS[:number % 2]
        out += [
            Segment("to the next lane", 60.0, speed=SLOW, until="room", room=0.6 * lane),
            Segment("throttle steps", 3.0, throttle=Levels(levels, HOLD), steering="lane",
                    top_speed=top, rolls_out=True, measured=True),
            Segment("rolling out", 8.0, steering="lane", until="standstill", measured=True),
        ]
    return [*out, Segment("to the next lane", 60.0, speed=SLOW, until="room", room=0.9 * lane),
            Segment("rolling out", 8.0, steering="lane", until="standstill")]


def _delay(top: float, longest: float) -> tuple[list[Segment], float]:
    """Throttle steps; slow sine, chirp and steps of the steering, to the left and the right."""
    slow, n = DELAY_SPEED * top, 20
    lane = min(LANE, max(longest - 0.1, 0.5 * LANE))
    out = _throttle_steps(top, lane)
    for side in (1.0, -1.0):
        mean = side * MEAN
        out += [
            Segment("getting up to speed", 2.5, speed=slow, steering=Constant(mean)),
            Segment("slow sine", 12.0, speed=slow, steering=Sine(mean, SWING, 4.0),
                    measured=True),
            Segment("chirp", 12.0, speed=slow, steering=Chirp(mean, SWING, 0.25, 2.5, 12.0),
                    measured=True),
            Segment("steering steps", HOLD * n, speed=slow, measured=True,
                    steering=random_steps(mean - SWING, mean + SWING, n, HOLD)),
            *home(mean, side),
        ]
    return out, lane


def _tyres(top: float, _longest: float) -> tuple[list[Segment], float]:
    """A throttle ramp on a circle to each side."""
    out: list[Segment] = []
    for side in (1.0, -1.0):
        lock = side * TYRE_STEERING
        out += [
            Segment("getting up to speed", 3.0, speed=SLOW, steering=Constant(lock)),
            Segment(f"ramp to the {'left' if side > 0 else 'right'}", RAMP_SECONDS,
                    throttle=Ramp(0.0, RAMP, RAMP_SECONDS), relative=True,
                    steering=Constant(lock), top_speed=top, top_lateral=MOST_LATERAL,
                    measured=True),
            *home(lock, side),
        ]
    return out, 0.0


def home(steering: float, side: float) -> list[Segment]:
    """Slowly round until the car looks as at the start, so that the other side lies beside it."""
    end = [Segment("rolling out", 8.0, steering=Constant(steering), until="standstill")]
    if side < 0.0:
        return end
    return [Segment("rolling out", 3.0, steering=Constant(steering), until="standstill"),
            Segment("round to the start", 15.0, speed=SLOW, steering=Constant(steering),
                    until="heading"), *end]
