"""Plans of delay and tyres: circles at a held steering, first to the left, then to the right."""

from __future__ import annotations

import math
from dataclasses import replace

from dart_hal.config import CarFiles
from dart_hal.errors import ExperimentFailed

from .floor import MARGIN, Floor, Place
from .plans import Plan, Segment
from .rehearsal import rehearse
from .runner import Drive
from .signals import Chirp, Constant, Ramp, Sine, random_steps

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
PULSE = 0.05
"""Throttle by which it is pulsed, up and down."""
TYRE_STEERING = 0.75
MOST_LATERAL = 2.4
"""m/s2 that end the ramp: the front tyres of the paper's car give 2.9 at most."""
RAMP, RAMP_SECONDS = 0.12, 40.0
"""Throttle that is added, and how slowly: every instant is a steady circle."""
TYRES_ON_BOARD = (
    "on board there is no lateral velocity: speed and yaw rate tell the understeer gradient, one "
    "combination of front and rear stiffness, and how it grows with lateral acceleration; front "
    "and rear each, and the yaw inertia, need motion capture",)


def plan_circles(name: str, files: CarFiles, floor: Floor, speed: float | None) -> Plan:
    """The plan of "delay" or "tyres" on this floor, rehearsed; speed [m/s] at most.

    Errors: ExperimentFailed when the floor is too small, with what is needed.
    """
    top = speed if speed is not None else TOP[name]
    segments = _delay(top) if name == "delay" else _tyres(top)
    open_field = Plan(name, tuple(segments), Floor(200.0, 200.0), Place(100.0, 100.0), top,
                      notes=TYRES_ON_BOARD if name == "tyres" else ())
    rehearsed, drive = rehearse(open_field, files)
    place, needed = _needs(drive)
    if needed.length > floor.length or needed.width > floor.width:
        raise ExperimentFailed(
            f"a floor of {floor} is too small for the {name} test at {top:.1f} m/s",
            found=f"{floor}", expected=f"{_up(needed.length)} m along the car and "
            f"{_up(needed.width)} m across", remedy=_remedy(name, files, floor, speed))
    spare = Place(place.behind + 0.5 * (floor.length - needed.length),
                  place.right + 0.5 * (floor.width - needed.width))
    return replace(rehearsed, floor=floor, place=spare)


def _needs(drive: Drive) -> tuple[Place, Floor]:
    """Where the car stands and the floor around it, wider cars and margins included."""
    xs = [OTHER_CARS * f.pose.x for f in drive.frames]
    ys = [OTHER_CARS * f.pose.y for f in drive.frames]
    place = Place(MARGIN - min(xs), MARGIN - min(ys))
    return place, Floor(max(xs) - min(xs) + 2.0 * MARGIN, max(ys) - min(ys) + 2.0 * MARGIN)


def _remedy(name: str, files: CarFiles, floor: Floor, speed: float | None) -> str:
    top = speed if speed is not None else TOP[name]
    for tenth in range(round(10.0 * top) - 1, 5, -1):
        segments = _delay(0.1 * tenth) if name == "delay" else _tyres(0.1 * tenth)
        field = Plan(name, tuple(segments), Floor(200.0, 200.0), Place(100.0, 100.0), 0.1 * tenth)
        _, needed = _needs(rehearse(field, files)[1])
        if needed.length <= floor.length and needed.width <= floor.width:
            return f"--speed {0.1 * tenth:.1f} fits on this floor"
    return "a larger floor"


def _up(metres: float) -> str:
    return f"{math.ceil(10.0 * metres) / 10.0:.1f}"


def _delay(top: float) -> list[Segment]:
    """Slow sine, chirp and steps of the steering, then pulses of the throttle, on both sides."""
    slow, n = DELAY_SPEED * top, 20
    out: list[Segment] = []
    for side in (1.0, -1.0):
        mean, swing = side * MEAN, SWING
        out += [
            Segment("getting up to speed", 2.5, speed=slow, steering=Constant(mean)),
            Segment("slow sine", 12.0, speed=slow, steering=Sine(mean, swing, 4.0),
                    measured=True),
            Segment("chirp", 12.0, speed=slow, steering=Chirp(mean, swing, 0.25, 2.5, 12.0),
                    measured=True),
            Segment("steering steps", 0.45 * n, speed=slow, measured=True,
                    steering=random_steps(mean - swing, mean + swing, n, 0.45)),
            Segment("even circle", 2.0, speed=slow, steering=Constant(mean)),
            Segment("throttle steps", 0.45 * n, relative=True, steering=Constant(mean),
                    throttle=random_steps(-PULSE, PULSE, n, 0.45), measured=True),
            *_home(mean, side),
        ]
    return out


def _tyres(top: float) -> list[Segment]:
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
            *_home(lock, side),
        ]
    return out


def _home(steering: float, side: float) -> list[Segment]:
    """Slowly round until the car looks as at the start, so that the other side lies beside it."""
    end = [Segment("rolling out", 8.0, steering=Constant(steering), until="standstill")]
    if side < 0.0:
        return end
    return [Segment("rolling out", 3.0, steering=Constant(steering), until="standstill"),
            Segment("round to the start", 15.0, speed=SLOW, steering=Constant(steering),
                    until="heading"), *end]
