"""``calibrate mocap``: where the marker is on the car, and the delay of its poses.

The car drives slow and fast full circles to the left and to the right, twice. Before the fit
(``mocap_fit``), ``estimation.pose_check`` checks that the poses are of this car and follow our
conventions.
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
from .mocap_fit import BLOCK_DURATION, MARKER_KEYS, MarkerTrack, fit_marker, graph_places
from .procedure import Bench, Procedure, ProcedurePlan, Progress, scale_floor
from .runner import CalibrationRunner, driving
from .straight import rest

CIRCLE_ROUNDS = 2
# m/s: 0.3 and 1.3 m/s2 of lateral acceleration, whose difference shows the slip (its square).
CIRCLE_SPEEDS = (0.4, 0.8)
# Share of the steering range that is used in the circles.
CIRCLE_LOCK = 0.9
# m/s, and whether to the left: each a full turn.
MOCAP_LEGS = [(speed, left) for _ in range(CIRCLE_ROUNDS) for speed in CIRCLE_SPEEDS
              for left in (True, False)]
# s for one turn; the slow one takes 8 s at full lock.
MAX_CIRCLE_DURATION = 40.0
# m: two circles of 0.6 m radius side by side, car and marker included.
MOCAP_FLOOR = (3.5, 3.0)
# A drive of 45 s has 450 poses at 10 Hz.
MIN_POSES = 100
# s within which a connected source has sent a pose.
MAX_POSE_WAIT = 2.0


def plan(files: CarFiles) -> ProcedurePlan:
    """Describe what ``measure`` does."""
    floor = scale_floor(MOCAP_FLOOR, files)
    return ProcedurePlan(
        f"circles at {CIRCLE_SPEEDS[0]} and {CIRCLE_SPEEDS[1]} m/s to the left and to the right, "
        f"{CIRCLE_ROUNDS} times, to measure the place of the marker and the delay of the external "
        f"poses: about 55 s, a floor of {floor[0]:g} m x {floor[1]:g} m in view of "
        "the source, no tools", 55.0, floor)


def measure(bench: Bench) -> Measured:
    """Measure marker frame [m, m, rad] and latency [s].

    Raises CalibrationFailed (with the likely cause), LinkLost, NotArmed.
    """
    car = bench.car
    files = bench.files
    poses: dict[float, ExternalPose] = {}
    states: list[State] = []

    def collect(some: list[State]) -> None:
        states.extend(some)
        poses.update((s.external.newest.stamp, s.external.newest) for s in some
                     if s.external is not None and s.external.newest is not None)

    collect(list(car.states(duration=MAX_POSE_WAIT)))
    if not poses:
        raise _no_poses()
    with driving(car) as runner:
        drive_circles(runner, files, bench.progress, collect)
    track = make_track(states, list(poses.values()))
    check(track)
    marker = fit_marker(track)
    method = f"{marker.blocks} blocks of circles"
    found = {f"mocap.{name}": Quantity(estimate.value, estimate.std, method)
             for name, estimate in ((n, marker.found[n]) for n in MARKER_KEYS)}
    return Measured(files.config.name, bench.source, "mocap", found,
                    f"poses and dead reckoning differ by {1e3 * marker.rms:.1f} mm rms",
                    states[-1].t - states[0].t,
                    (f"{len(poses)} poses; dead reckoning restarts every {BLOCK_DURATION:.0f} s",),
                    graph=graph_places("Where each pose has the marker on the car", marker,
                                       "each pose", "marker, 90 % interval to the left"))


def drive_circles(runner: CalibrationRunner, files: CarFiles, progress: Progress,
                  collect: Callable[[list[State]], None],
                  legs: Sequence[tuple[float, bool]] = MOCAP_LEGS, lock: float = CIRCLE_LOCK, *,
                  whole: bool = False) -> None:
    """Drive full circles and pass every State to ``collect``.

    legs: (speed [m/s], to the left) of each circle. lock: share of the steering range.
    whole: the start-up is part of the first turn, so that the car ends where it started.
    """
    steering = files.config.steering
    offset = lock * steering.span_us * steering.direction
    rest(runner, steering.center_us)
    for k, (speed, left) in enumerate(legs):
        progress(k / len(legs), f"{'left' if left else 'right'} at {speed} m/s")
        pulse = steering.center_us + (offset if left else -offset)
        first = None
        if k == 0:
            some = runner.start_moving(pulse, speed, 0.0, left)
            collect(some)
            first = some[0] if whole else None
        _circle(runner, pulse, speed, collect, first)
    collect(runner.hold(0.5, steering.center_us, 0.0))


def _circle(runner: CalibrationRunner, pulse: float, speed: float,
            collect: Callable[[list[State]], None], first: State | None) -> None:
    """Drive a full turn, counted from ``first`` or else from now."""
    some = runner.hold(0.0, pulse, speed)
    collect(some)
    first = first or some[-1]
    while abs(some[-1].pose.yaw - first.pose.yaw) < 2.0 * math.pi:
        some = runner.hold(0.1, pulse, speed)
        collect(some)
        if some[-1].t - first.t > MAX_CIRCLE_DURATION:
            turn = math.degrees(some[-1].pose.yaw - first.pose.yaw)
            raise CalibrationFailed(
                "the circle does not close",
                found=f"{turn:+.0f} deg in {MAX_CIRCLE_DURATION:.0f} s",
                expected="a full turn, 360 deg",
                likely="the servo does not reach its lock, or the gyro dropped out",
                remedy="dart-hal doctor")


def make_track(states: list[State], poses: list[ExternalPose]) -> MarkerTrack:
    """Put states and poses on one clock.

    Raises CalibrationFailed for too few poses, and for a clock of the source that jumped.
    """
    if len(poses) < MIN_POSES:
        raise CalibrationFailed("too few poses", found=f"{len(poses)} poses",
                                expected=f"at least {MIN_POSES}",
                                likely="the source has the car in view only some of the time",
                                remedy="dart-hal top shows the poses")
    poses = sorted(poses, key=lambda p: p.stamp)
    t, jump = to_car_time(np.array([p.stamp for p in poses]), np.array([p.arrival for p in poses]))
    if jump:
        raise CalibrationFailed("the clock of the source jumped", found=jump,
                                expected="stamps that only increase", remedy="run it again")
    car = np.array([(s.pose.x, s.pose.y, s.pose.yaw) for s in states])
    measured = np.array([(p.x, p.y, p.yaw) for p in poses])
    car[:, 2] = np.unwrap(car[:, 2])
    measured[:, 2] = np.unwrap(measured[:, 2])
    car_t = np.array([s.t for s in states])
    # A pose is older than its stamp, so the first poses precede the first State.
    inside = (t > car_t[0] + 0.3) & (t < car_t[-1])
    variance = np.median([np.diag(p.cov) for p in poses], axis=0)
    std = math.sqrt(0.5 * (variance[0] + variance[1])), math.sqrt(variance[2])
    return MarkerTrack(car_t, car, np.array([s.speed for s in states]), t[inside],
                       measured[inside], std)


def check(track: MarkerTrack) -> None:
    """Raise CalibrationFailed with the fault of the poses and its remedy, if there is one."""
    car = np.column_stack([np.interp(track.pose_t, track.t, track.car[:, i]) for i in range(3)])
    fault = find_fault(PoseComparison(track.pose_t, car, track.poses))
    if fault is not None:
        remedy = f"the option {fault.option} of the source's URL" if fault.option else \
            "the settings of the source"
        raise CalibrationFailed(fault.what, found=fault.found, expected=fault.expected,
                                remedy=remedy)


def _no_poses() -> CalibrationFailed:
    return CalibrationFailed(
        "no external poses", found=f"none within {MAX_POSE_WAIT:.0f} s",
        expected="a source of external poses that has the car in view",
        likely="no source is set, or it does not send to this computer",
        remedy="DART_HAL_POSES=udp://:5005, or sim://?mocap=1; docs: how_to/poses.md")


calibrate_mocap = Procedure(
    name="mocap",
    help="""Where the marker is on the car, and the delay of the external poses.

    Slow and fast circles to both sides, about a minute. $DART_HAL_POSES names the source. Poses of
    another body, in other units or in frames that are left-handed or not z-up are refused, with the
    option that corrects them.
    """,
    plan=plan, measure=measure, poses=True, keys=tuple(f"mocap.{n}" for n in MARKER_KEYS),
    after=("clock", "encoder", "imu"))
