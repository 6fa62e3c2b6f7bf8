"""``calibrate mocap``: where the marker sits on the car, and how late its poses come.

Slow and fast full circles to the left and to the right, twice. ``mocap_fit`` makes numbers
of what wheels, gyro and source told; ``estimation.pose_check`` says before whether the source
tells of this car, and in our conventions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from dart_hal.core.config import CarFiles, Quantity
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import ExternalPose, State
from dart_hal.estimation.pose_check import PoseComparison, find_fault
from dart_hal.estimation.source_clock import to_car_time

from .measured import Measured
from .mocap_fit import NAMES, Track, fit_marker
from .procedure import Bench, Procedure, ProcedurePlan, Progress
from .runner import Runner, driving
from .straight import rest

ROUNDS, SPEEDS = 2, (0.4, 0.8)
"""m/s: a lateral acceleration of 0.3 and 1.3 m/s2 tells the slip, which grows with its square."""
LOCK = 0.9
LEGS = [(speed, left) for _ in range(ROUNDS) for speed in SPEEDS for left in (True, False)]
"""m/s, and whether to the left: each a full turn."""
LONGEST = 40.0
"""s for one turn; the slow one takes 8 s at full lock."""
FLOOR = (3.5, 3.0)
"""m: two circles of 0.6 m radius beside each other, car and marker included."""
FEWEST = 100
"""Poses; at 10 Hz the drive of 45 s has 450."""
WAIT = 2.0
"""s in which a source that is there has told something."""


def plan(files: CarFiles) -> ProcedurePlan:
    """Say what ``measure`` will do."""
    return ProcedurePlan(
        f"circles at {SPEEDS[0]} and {SPEEDS[1]} m/s to the left and to the right, {ROUNDS} "
        "times, to measure where the marker sits and how late the poses from outside come: "
        f"about 55 s, a floor of {FLOOR[0]:g} m x {FLOOR[1]:g} m that the source sees, no "
        "tools", 55.0, FLOOR)


def measure(bench: Bench) -> Measured:
    """Measure marker frame [m, m, rad] and latency [s].

    Errors: CalibrationFailed (with the likely cause), LinkLost, NotArmed.
    """
    car = bench.car
    files = bench.files
    seen: dict[float, ExternalPose] = {}
    states: list[State] = []

    def watch(some: list[State]) -> None:
        states.extend(some)
        seen.update((s.external.newest.stamp, s.external.newest) for s in some
                    if s.external is not None and s.external.newest is not None)

    watch(list(car.states(duration=WAIT)))
    if not seen:
        raise _no_poses()
    with driving(car) as runner:
        drive(runner, files, bench.progress, watch)
    track = track_of(states, list(seen.values()))
    check(track)
    marker = fit_marker(track)
    found = {f"mocap.{name}": Quantity(e.value, e.std, f"{marker.stretches} stretches of circles")
             for name, e in ((n, marker.found[n]) for n in NAMES)}
    return Measured(files.config.name, bench.source, "mocap", found,
                    f"poses and dead reckoning differ by {1e3 * marker.rms:.1f} mm rms",
                    states[-1].t - states[0].t,
                    (f"{len(seen)} poses; dead reckoning begins anew every 3 s",))


def drive(runner: Runner, files: CarFiles, progress: Progress,
          watch: Callable[[list[State]], None], legs: Sequence[tuple[float, bool]] = LEGS,
          lock: float = LOCK, *, whole: bool = False) -> None:
    """Full circles at a share ``lock`` of the steering; every State is shown to ``watch``.

    whole: the start is part of the first turn, so that the car comes back to where it stood.
    """
    steering = files.config.steering
    side = lock * steering.span_us * steering.direction
    rest(runner, steering.center_us)
    for k, (speed, left) in enumerate(legs):
        progress(k / len(legs), f"{'left' if left else 'right'} at {speed} m/s")
        pulse = steering.center_us + (side if left else -side)
        first = None
        if k == 0:
            some = runner.start_moving(pulse, speed, 0.0, left)
            watch(some)
            first = some[0] if whole else None
        _circle(runner, pulse, speed, watch, first)
    watch(runner.hold(0.5, steering.center_us, 0.0))


def _circle(runner: Runner, pulse: float, speed: float, watch: Callable[[list[State]], None],
            first: State | None) -> None:
    """A full turn since ``first``, else from now on."""
    some = runner.hold(0.0, pulse, speed)
    watch(some)
    first = first or some[-1]
    while abs(some[-1].pose.yaw - first.pose.yaw) < 2.0 * math.pi:
        some = runner.hold(0.1, pulse, speed)
        watch(some)
        if some[-1].t - first.t > LONGEST:
            raise CalibrationFailed("the circle does not close", found=f"{LONGEST:.0f} s",
                                    expected="a full turn", likely="the servo does not reach its "
                                    "lock, or the gyro dropped out", remedy="dart-hal doctor")


def track_of(states: list[State], poses: list[ExternalPose]) -> Track:
    """Errors: CalibrationFailed for next to no poses."""
    if len(poses) < FEWEST:
        raise CalibrationFailed("too few poses", found=f"{len(poses)}", expected=f"{FEWEST}",
                                likely="the source sees the car only now and then",
                                remedy="dart-hal top shows the poses")
    poses = sorted(poses, key=lambda p: p.stamp)
    t, anew = to_car_time(np.array([p.stamp for p in poses]), np.array([p.arrival for p in poses]))
    if anew:
        raise CalibrationFailed("the clock of the source jumped", found=anew,
                                expected="stamps that only go on", remedy="run it again")
    car = np.array([(s.pose.x, s.pose.y, s.pose.yaw) for s in states])
    seen = np.array([(p.x, p.y, p.yaw) for p in poses])
    car[:, 2], seen[:, 2] = np.unwrap(car[:, 2]), np.unwrap(seen[:, 2])
    at = np.array([s.t for s in states])
    inside = (t > at[0] + 0.3) & (t < at[-1])
    return Track(at, car, np.array([s.speed for s in states]), t[inside], seen[inside])


def check(track: Track) -> None:
    """Errors: CalibrationFailed that names what is wrong with the poses and how to mend it."""
    car = np.column_stack([np.interp(track.t_seen, track.t, track.car[:, i]) for i in range(3)])
    wrong = find_fault(PoseComparison(track.t_seen, car, track.seen))
    if wrong is not None:
        option = f"the option {wrong.option} of the source's URL" if wrong.option else \
            "the settings of the source"
        raise CalibrationFailed(wrong.what, found=wrong.found, expected=wrong.expected,
                                remedy=option)


def _no_poses() -> CalibrationFailed:
    return CalibrationFailed(
        "no poses from outside", found=f"none within {WAIT:.0f} s", expected="a source that sees "
        "the car", likely="no source is named, or it does not send to this computer",
        remedy="DART_HAL_POSES=udp://:5005, or sim://?mocap=1; docs: how_to/poses.md")


calibrate_mocap = Procedure(
    name="mocap",
    help="""Where the marker sits on the car, and how late the poses from outside come.

    Slow and fast circles to both sides, about a minute. $DART_HAL_POSES names the source. Poses
    of another body, other units and frames that are left-handed or not z-up are named, with the
    option that mends them.
    """,
    plan=plan, measure=measure, poses=True, keys=tuple(f"mocap.{n}" for n in NAMES),
    after=("clock", "encoder", "imu"))
