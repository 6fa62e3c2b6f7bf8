"""Plans of the friction and motor tests: pulls at constant throttle, each coasting to rest."""

from __future__ import annotations

from dart_hal.core.config import CarFiles
from dart_hal.core.errors import ExperimentFailed
from dart_hal.vehicle.load import vehicle_of
from dart_hal.vehicle.motor import make_motor

from .excitation import Constant
from .floor import FLOOR_MARGIN, Floor
from .limits import RollingDistance
from .plans import ExperimentPlan, Segment
from .rehearsal import rehearse_plan
from .track import longest_lane, oval_width, start_place

FRICTION_THROTTLES = (0.28, 0.32, 0.36, 0.40, 0.32, 0.28, 0.40, 0.36, 0.32, 0.40, 0.36, 0.32)
# Throttles of the pulls; the paper's motor recordings go from 0.20 to 0.40.
MOTOR_THROTTLES = (0.22, 0.24, 0.26, 0.28, 0.30, 0.32, 0.36, 0.40, 0.26, 0.30, 0.36)
# [m/s] Default top speeds.
PULL_SPEEDS = {"friction": 2.0, "motor": 2.5}
# Shares of the top speed at which the friction pulls end: coasting from several speeds.
SPEED_SHARES = (0.4, 0.6, 0.8, 1.0, 1.0, 0.8, 0.6, 1.0, 0.5, 0.9, 0.7, 1.0)
# [s]
MAX_PULL_TIME = 3.0
# [m/s] From one pull to the start of the next.
PULL_TRANSFER_SPEED = 0.5
# [m/s] Least top speed of the fastest pull: below it only the tanh of the friction shows.
MIN_PULL_SPEED = 0.8


def plan_straight(name: str, files: CarFiles, floor: Floor, speed: float | None) -> ExperimentPlan:
    """Plan "friction" or "motor" for this floor, with a rehearsal.

    speed [m/s]: top speed, None: as fast as the floor allows. All pulls follow each other on a
    straight line if the floor is long enough, else they are driven on an oval. Raises
    ExperimentFailed if the floor is too small, with the size that is needed.
    """
    requested = speed if speed is not None else PULL_SPEEDS[name]
    needs = [_pull_length(files, throttle, share * requested) for throttle, share in _pulls(name)]
    if sum(needs) + PULL_TRANSFER_SPEED <= longest_lane(floor, oval=False):
        return _make_rehearsed(name, files, floor, requested, needs, oval=False)
    lane = longest_lane(floor, oval=True)
    top = requested
    while speed is None and top > MIN_PULL_SPEED and max(needs) > lane:
        top -= 0.1
        needs = [_pull_length(files, throttle, share * top) for throttle, share in _pulls(name)]
    if max(needs) > lane:
        raise _too_small(name, files, floor, requested if speed is not None else MIN_PULL_SPEED,
                         lane)
    return _make_rehearsed(name, files, floor, top, needs, oval=True)


def _pulls(name: str) -> list[tuple[float, float]]:
    if name == "friction":
        return list(zip(FRICTION_THROTTLES, SPEED_SHARES, strict=True))
    return [(throttle, 1.0) for throttle in MOTOR_THROTTLES]


def _pull_length(files: CarFiles, throttle: float, top: float) -> float:
    """Compute the lane [m] of one pull up to ``top`` [m/s] and its coasting."""
    vehicle = vehicle_of(files.model)
    motor = make_motor(vehicle.duty_motor)
    rolling = RollingDistance(vehicle)
    friction = vehicle.friction
    x = v = t = 0.0
    while v < top and t < MAX_PULL_TIME:
        drive = motor(throttle, v) - friction.a * min(13.0 * v, 1.0) - friction.c * v
        v = max(v + drive / vehicle.body.mass * 0.01, 0.0)
        x += v * 0.01
        t += 0.01
    return x + rolling(v) + 0.2


def _make_rehearsed(name: str, files: CarFiles, floor: Floor, top: float, needs: list[float], *,
                    oval: bool) -> ExperimentPlan:
    segments: list[Segment] = []
    for (throttle, share), room in zip(_pulls(name), needs, strict=True):
        segments += one_pull(throttle, share * top, room)
    plan = ExperimentPlan(name, tuple(segments), floor, start_place(oval=oval), top,
                          lane=longest_lane(floor, oval=oval), oval=oval)
    plan, drive = rehearse_plan(plan, files)
    if drive.stopped:
        raise ExperimentFailed(f"the drive does not fit on a floor of {floor}",
                               found=drive.stopped, remedy="a larger --space, or a lower --speed")
    return plan


def one_pull(throttle: float, top: float, room: float) -> list[Segment]:
    """Return a pull from rest up to ``top`` [m/s] and its coasting, with ``room`` [m] ahead."""
    name = f"throttle {throttle:.2f}"
    return [
        Segment("to the next lane", 60.0, speed=PULL_TRANSFER_SPEED, until="room", room=room),
        Segment("at rest", 3.0, steering="lane", until="standstill"),
        Segment("at rest", 0.5, steering="lane"),
        Segment(name, MAX_PULL_TIME, throttle=Constant(throttle), steering="lane", top_speed=top,
                rolls_out=True, measured=True),
        Segment("rolling out", 8.0, steering="lane", until="standstill", measured=True),
    ]


def _too_small(name: str, files: CarFiles, floor: Floor, top: float, lane: float
               ) -> ExperimentFailed:
    fits = 0.0
    for tenth in range(1, round(10.0 * top)):
        if max(_pull_length(files, t, 0.1 * tenth * s) for t, s in _pulls(name)) <= lane:
            fits = 0.1 * tenth
    most = max(_pull_length(files, t, top * s) for t, s in _pulls(name))
    long = most + longest_lane(Floor(0.0, oval_width()), oval=True) * -1.0
    total = sum(_pull_length(files, t, top * s) for t, s
                in _pulls(name)) + PULL_TRANSFER_SPEED + 2.0 * FLOOR_MARGIN
    remedy = (f"--speed {fits:.1f} fits on this floor" if fits >= MIN_PULL_SPEED
              else "a larger floor: a corridor or a hall")
    return ExperimentFailed(
        f"a floor of {floor} is too small for the {name} test at {top:.1f} m/s",
        found=f"{max(lane, 0.0):.1f} m of straight lane between two turns" if lane > 0.0
        else "no room for a lane and two turns",
        expected=f"{long:.1f} m x {oval_width():.1f} m (lanes and turns), or a corridor of "
                 f"{total:.0f} m x {2.0 * FLOOR_MARGIN:.1f} m", remedy=remedy)
