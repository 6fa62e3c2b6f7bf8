"""Plans of the delay and tyre tests: circles to both sides, and lanes for the throttle."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from dart_hal.core.config import CarFiles
from dart_hal.core.errors import ExperimentFailed

from .excitation import Chirp, Constant, Levels, Ramp, Sine, random_steps
from .floor import FLOOR_MARGIN, Floor, StartPlace
from .plans import ExperimentPlan, Segment
from .rehearsal import rehearse_plan
from .track import TURN_RADIUS

# [m/s] Default top speeds.
CIRCLE_SPEEDS = {"delay": 1.2, "tyres": 1.6}
# Largest turn radius of a car of this class over that of the rehearsal.
TURN_SCALE = 1.25
# [m/s] Between two tests.
TRANSFER_SPEED = 0.5
# Steering command of the delay test: its mean leads round a circle.
MEAN_STEERING = 0.5
STEERING_AMPLITUDE = 0.4
# Share of the top speed in the steering tests.
DELAY_SPEED = 0.65
# [s] Between two steps: four times the sum of delay and lag of these cars.
LEVEL_TIME = 0.45
THROTTLE_LEVELS = (0.32, 0.16, 0.30, 0.20, 0.34, 0.18)
# Length [m] and number of the lanes on which the throttle is stepped through these levels.
LANE_LENGTH = 3.0
LANE_COUNT = 8
TYRE_STEERING = 0.75
# [m/s2] The ramp ends there: the limit of the paper's front tyres is 2.9.
MAX_RAMP_LATERAL = 2.4
# Throttle that is added over that time [s]: slow enough for a steady circle at any time.
RAMP_THROTTLE = 0.12
RAMP_SECONDS = 40.0
TYRES_ON_BOARD = (
    "on board there is no lateral velocity: speed and yaw rate identify the understeer gradient, "
    "one combination of front and rear stiffness, and how it grows with lateral acceleration; "
    "front and rear each, and the yaw inertia, need motion capture",)


MakeSegments = Callable[[float, float], tuple[list[Segment], float]]
"""(top speed [m/s], longest lane [m] on the floor) -> (segments, lane [m], 0: needs none)."""


def plan_circles(name: str, files: CarFiles, floor: Floor, speed: float | None) -> ExperimentPlan:
    """Plan "delay" or "tyres" for this floor, with a rehearsal; speed [m/s] at most.

    Raises ExperimentFailed if the floor is too small, with the size that is needed.
    """
    make, notes = (_delay_segments, ()) if name == "delay" else (_tyre_segments, TYRES_ON_BOARD)
    return plan_in_field(name, files, floor, speed, CIRCLE_SPEEDS[name], make, notes)


def plan_in_field(name: str, files: CarFiles, floor: Floor, speed: float | None, usual: float,
                  make: MakeSegments, notes: tuple[str, ...] = ()) -> ExperimentPlan:
    """Rehearse a plan in an open field, and place it in the middle of the floor.

    usual [m/s]: top speed without ``speed``, reduced on a small floor. Raises ExperimentFailed if
    the floor is too small, with the size that is needed.
    """
    top = speed if speed is not None else usual
    rehearsed, place, needed = _rehearse_in_field(name, files, floor, top, make, notes)
    if not _fits(needed, floor):
        slower = (0.1 * tenth for tenth in range(round(10.0 * top) - 2, 5, -2))
        tries = ((v, _rehearse_in_field(name, files, floor, v, make, notes)) for v in slower)
        found = next(((v, t) for v, t in tries if _fits(t[2], floor)), None)
        if found is None or speed is not None:
            raise ExperimentFailed(
                f"a floor of {floor} is too small for the {name} test at {top:.1f} m/s",
                found=f"{floor}", expected=f"{_round_up(needed.length)} m along the car and "
                f"{_round_up(needed.width)} m across",
                remedy="a larger floor" if found is None
                else f"--speed {found[0]:.1f} fits on this floor")
        rehearsed, place, needed = found[1]
    spare = StartPlace(place.behind + 0.5 * (floor.length - needed.length),
                       place.right + 0.5 * (floor.width - needed.width))
    return replace(rehearsed, floor=floor, place=spare)


def _rehearse_in_field(name: str, files: CarFiles, floor: Floor, top: float, make: MakeSegments,
                       notes: tuple[str, ...]) -> tuple[ExperimentPlan, StartPlace, Floor]:
    """Return (the plan rehearsed in an open field, start of the car, floor that it needs)."""
    longest = (floor.length - 2.0 * FLOOR_MARGIN) / TURN_SCALE - 2.0 * TURN_RADIUS
    segments, lane = make(top, longest)
    plan, drive = rehearse_plan(ExperimentPlan(
        name, tuple(segments), Floor(200.0, 200.0), StartPlace(100.0, 100.0), top, lane=lane,
        oval=True, notes=notes), files)
    xs = [TURN_SCALE * f.pose.x for f in drive.frames]
    ys = [TURN_SCALE * f.pose.y for f in drive.frames]
    place = StartPlace(FLOOR_MARGIN - min(xs), FLOOR_MARGIN - min(ys))
    return plan, place, Floor(max(xs) - min(xs) + 2.0 * FLOOR_MARGIN, max(ys) - min(ys)
                              + 2.0 * FLOOR_MARGIN)


def _fits(needed: Floor, floor: Floor) -> bool:
    return needed.length <= floor.length and needed.width <= floor.width


def _round_up(metres: float) -> str:
    return f"{math.ceil(10.0 * metres) / 10.0:.1f}"


def _throttle_steps(top: float, lane: float) -> list[Segment]:
    """Return throttle steps on the lanes: turns brake the car, so none is in a test."""
    out: list[Segment] = []
    for number in range(LANE_COUNT):
        levels = THROTTLE_LEVELS[number % 2:] + THROTTLE_LEVELS[:number % 2]
        out += [
            Segment("to the next lane", 60.0, speed=TRANSFER_SPEED, until="room", room=0.6 * lane),
            Segment("throttle steps", 3.0, throttle=Levels(levels, LEVEL_TIME), steering="lane",
                    top_speed=top, rolls_out=True, measured=True),
            Segment("rolling out", 8.0, steering="lane", until="standstill", measured=True),
        ]
    return [*out, Segment("to the next lane", 60.0, speed=TRANSFER_SPEED, until="room",
                          room=0.9 * lane),
            Segment("rolling out", 8.0, steering="lane", until="standstill")]


def _delay_segments(top: float, longest: float) -> tuple[list[Segment], float]:
    """Return throttle steps; slow sine, chirp and steps of the steering, to both sides."""
    slow = DELAY_SPEED * top
    n = 20
    lane = min(LANE_LENGTH, max(longest - 0.1, 0.5 * LANE_LENGTH))
    out = _throttle_steps(top, lane)
    for side in (1.0, -1.0):
        mean = side * MEAN_STEERING
        out += [
            Segment("getting up to speed", 2.5, speed=slow, steering=Constant(mean)),
            Segment("slow sine", 12.0, speed=slow, steering=Sine(mean, STEERING_AMPLITUDE, 4.0),
                    measured=True),
            Segment("chirp", 12.0, speed=slow, measured=True,
                    steering=Chirp(mean, STEERING_AMPLITUDE, 0.25, 2.5, 12.0)),
            Segment("steering steps", LEVEL_TIME * n, speed=slow, measured=True,
                    steering=random_steps(mean - STEERING_AMPLITUDE, mean + STEERING_AMPLITUDE,
                                          n, LEVEL_TIME)),
            *home(mean, side),
        ]
    return out, lane


def _tyre_segments(top: float, _longest: float) -> tuple[list[Segment], float]:
    """Return a throttle ramp on a circle to each side."""
    out: list[Segment] = []
    for side in (1.0, -1.0):
        lock = side * TYRE_STEERING
        out += [
            Segment("getting up to speed", 3.0, speed=TRANSFER_SPEED, steering=Constant(lock)),
            Segment(f"ramp to the {'left' if side > 0 else 'right'}", RAMP_SECONDS,
                    throttle=Ramp(0.0, RAMP_THROTTLE, RAMP_SECONDS), relative=True,
                    steering=Constant(lock), top_speed=top, top_lateral=MAX_RAMP_LATERAL,
                    measured=True),
            *home(lock, side),
        ]
    return out, 0.0


def home(steering: float, side: float) -> list[Segment]:
    """Return a slow turn to the heading of the start, so that the circles of both sides adjoin."""
    end = [Segment("rolling out", 8.0, steering=Constant(steering), until="standstill")]
    if side < 0.0:
        return end
    return [Segment("rolling out", 3.0, steering=Constant(steering), until="standstill"),
            Segment("round to the start", 15.0, speed=TRANSFER_SPEED, steering=Constant(steering),
                    until="heading"), *end]
