"""Plans of friction and motor: pulls at a held throttle, each rolling out to standstill."""

from __future__ import annotations

from dart_hal.core.config import CarFiles
from dart_hal.core.errors import ExperimentFailed
from dart_hal.vehicle.load import vehicle_of
from dart_hal.vehicle.motor import make_motor

from .excitation import Constant
from .floor import MARGIN, Floor
from .limits import Rolling
from .plans import Plan, Segment
from .rehearsal import rehearse
from .track import oval_width, start_of, straight_of

FRICTION = (0.28, 0.32, 0.36, 0.40, 0.32, 0.28, 0.40, 0.36, 0.32, 0.40, 0.36, 0.32)
MOTOR = (0.22, 0.24, 0.26, 0.28, 0.30, 0.32, 0.36, 0.40, 0.26, 0.30, 0.36)
"""Throttles of the pulls; the paper's motor recordings go from 0.20 to 0.40."""
TOP = {"friction": 2.0, "motor": 2.5}
"""m/s unless something else is asked for."""
SHARES = (0.4, 0.6, 0.8, 1.0, 1.0, 0.8, 0.6, 1.0, 0.5, 0.9, 0.7, 1.0)
"""Of the top speed at which a friction pull is let go: coasting from several speeds."""
LONGEST_PULL = 3.0
BETWEEN = 0.5
"""m/s from one pull to the start of the next."""
LEAST_TOP = 0.8
"""m/s that the fastest pull must reach: below, friction is the tanh and nothing else."""


def plan_straight(name: str, files: CarFiles, floor: Floor, speed: float | None) -> Plan:
    """The plan of "friction" or "motor" on this floor, rehearsed.

    speed [m/s]: a must if given, else as fast as the floor allows. A floor on
    which all pulls fit one after the other is used straight, else as an oval.
    Errors: ExperimentFailed with what is needed.
    """
    wanted = speed if speed is not None else TOP[name]
    needs = [_room(files, throttle, share * wanted) for throttle, share in _pulls(name)]
    if sum(needs) + BETWEEN <= straight_of(floor, oval=False):
        return _rehearsed(name, files, floor, wanted, needs, oval=False)
    lane = straight_of(floor, oval=True)
    top = wanted
    while speed is None and top > LEAST_TOP and max(needs) > lane:
        top -= 0.1
        needs = [_room(files, throttle, share * top) for throttle, share in _pulls(name)]
    if max(needs) > lane:
        raise _too_small(name, files, floor, wanted if speed is not None else LEAST_TOP, lane)
    return _rehearsed(name, files, floor, top, needs, oval=True)


def _pulls(name: str) -> list[tuple[float, float]]:
    if name == "friction":
        return list(zip(FRICTION, SHARES, strict=True))
    return [(throttle, 1.0) for throttle in MOTOR]


def _room(files: CarFiles, throttle: float, top: float) -> float:
    """Lane [m] of one pull up to ``top`` [m/s] and its rolling out."""
    vehicle = vehicle_of(files.model)
    motor, rolling = make_motor(vehicle.motor), Rolling(vehicle)
    friction = vehicle.friction
    x = v = t = 0.0
    while v < top and t < LONGEST_PULL:
        drive = motor(throttle, v) - friction.a * min(13.0 * v, 1.0) - friction.c * v
        v = max(v + drive / vehicle.body.mass * 0.01, 0.0)
        x += v * 0.01
        t += 0.01
    return x + rolling(v) + 0.2


def _rehearsed(name: str, files: CarFiles, floor: Floor, top: float, needs: list[float], *,
               oval: bool) -> Plan:
    segments: list[Segment] = []
    for (throttle, share), room in zip(_pulls(name), needs, strict=True):
        segments += one_pull(throttle, share * top, room)
    plan = Plan(name, tuple(segments), floor, start_of(oval=oval), top,
                lane=straight_of(floor, oval=oval), oval=oval)
    plan, drive = rehearse(plan, files)
    if drive.stopped:
        raise ExperimentFailed(f"the drive does not fit on a floor of {floor}",
                               found=drive.stopped, remedy="a larger --space, or a lower --speed")
    return plan


def one_pull(throttle: float, top: float, room: float) -> list[Segment]:
    """From standstill up to ``top`` [m/s] and rolling out, on a lane with ``room`` [m] ahead."""
    name = f"throttle {throttle:.2f}"
    return [
        Segment("to the next lane", 60.0, speed=BETWEEN, until="room", room=room),
        Segment("standing", 3.0, steering="lane", until="standstill"),
        Segment("standing", 0.5, steering="lane"),
        Segment(name, LONGEST_PULL, throttle=Constant(throttle), steering="lane", top_speed=top,
                rolls_out=True, measured=True),
        Segment("rolling out", 8.0, steering="lane", until="standstill", measured=True),
    ]


def _too_small(name: str, files: CarFiles, floor: Floor, top: float, lane: float
               ) -> ExperimentFailed:
    fits = 0.0
    for tenth in range(1, round(10.0 * top)):
        if max(_room(files, t, 0.1 * tenth * s) for t, s in _pulls(name)) <= lane:
            fits = 0.1 * tenth
    most = max(_room(files, t, top * s) for t, s in _pulls(name))
    long = most + straight_of(Floor(0.0, oval_width()), oval=True) * -1.0
    total = sum(_room(files, t, top * s) for t, s in _pulls(name)) + BETWEEN + 2.0 * MARGIN
    remedy = (f"--speed {fits:.1f} fits on this floor" if fits >= LEAST_TOP
              else "a larger floor: a corridor or a hall")
    return ExperimentFailed(
        f"a floor of {floor} is too small for the {name} test at {top:.1f} m/s",
        found=f"{max(lane, 0.0):.1f} m of straight lane between two turns" if lane > 0.0
        else "no room for a lane and two turns",
        expected=f"{long:.1f} m x {oval_width():.1f} m (lanes and turns), or a corridor of "
                 f"{total:.0f} m x {2.0 * MARGIN:.1f} m", remedy=remedy)
