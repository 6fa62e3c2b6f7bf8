"""``dart-hal follow``: follow a path with a tracker that uses the model of the car."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

import click
import numpy as np

from dart_hal.car import Car, join
from dart_hal.car.others import Others
from dart_hal.cli.common.follow_picture import draw_follow
from dart_hal.cli.common.options import (
    DiscType,
    FiniteNumber,
    car_options,
    drive_options,
    guard_option,
    json_option,
    lidar_option,
    plot_option,
    poses_option,
    room_key_option,
    waive_option,
)
from dart_hal.cli.common.output import console, print_json, progress_bar, results, show_notices
from dart_hal.cli.common.session import end_on_interrupt, exit_status, open_car
from dart_hal.cli.common.summary import RunSummary
from dart_hal.control.curvature_aware.generator import WEIGHTS
from dart_hal.control.drive_record import DriveRecord
from dart_hal.control.ending import Phase
from dart_hal.control.follow import DEFAULT_HALF_WIDTH, Follower, Rules
from dart_hal.control.keyboard import Terminal
from dart_hal.control.lane_follow import LaneFollower
from dart_hal.control.lap import CRAWL_SPEED
from dart_hal.control.measured import throttle_calibration
from dart_hal.control.mpc.obstacles import HALF_LENGTH, HALF_WIDTH, Disc
from dart_hal.control.mpc.tracker import Contouring
from dart_hal.control.paths import Path as Track
from dart_hal.control.plant import Plant, plant_of
from dart_hal.control.raceline import minimum_time_line, raceline
from dart_hal.control.trackers import TRACKERS, Make, contouring, curvature_aware
from dart_hal.control.tracks import track_named
from dart_hal.core.errors import UsageError
from dart_hal.core.types import Limit, MotionEstimate, State
from dart_hal.estimation.localisation.health import Status
from dart_hal.estimation.localisation.source import LidarPoses
from dart_hal.estimation.other_cars.rectangle import CarSize

# The keys + and - change the speed by this step [m/s], not below the minimum [m/s].
KEY_SPEED_STEP = 0.1
MIN_KEY_SPEED = 0.3
# Name under which the commands of this program are recorded.
COMMAND_SOURCE = "follow"
# Why a localisation by the lidar has no pose, with the remedy.
MISSING_BY_STATUS = {
    Status.AMBIGUOUS: ("the room looks the same from several places of the map; state the pose of "
                       "the car: lidar:MAP.yaml?start=X,Y,YAW"),
    Status.LOST: ("the scans fit no place of the map; is it of this room? dart-hal localize shows "
                  "how far they agree, dart-hal map makes a new one")}


@click.command("follow")
@car_options
@click.argument("path", metavar="PATH")
@click.option("--speed", type=FiniteNumber(CRAWL_SPEED, 10.0), default=None,
              help="m/s; slower where tyres, steering or path require it; keys + and - change it")
@click.option("--profile", is_flag=True, help="as fast as the model of the car allows at each "
                                              "point")
@click.option("--tracker", type=click.Choice(list(TRACKERS)), default=None,
              help="lqr (default): linear-quadratic with preview; pursuit: pure pursuit; mpcc "
                   "(default with --profile): model predictive contouring control; ca-mpcc: the "
                   "same, curvature-aware, in two layers")
@click.option("--weights", type=click.Choice(list(WEIGHTS)), default=None,
              help="weights of the planned path (ca-mpcc): tuned (default), or as published")
@click.option("--obstacle", "discs", type=DiscType(), multiple=True, metavar="X,Y,R[,SPEED]",
              help="disc to avoid (mpcc, ca-mpcc): centre in the frame of the poses and radius, "
                   "m; speed along the path, m/s; repeat for several")
@click.option("--room", default=None, metavar="URL",
              help="join this fleet room (udp://.., zenoh://.., local://..): other cars on the "
                   "path are overtaken (mpcc, ca-mpcc), or the car waits for them")
@room_key_option
@click.option("--detect-cars", "detect", is_flag=True,
              help="detect other cars in the scans (--poses lidar:MAP): they are overtaken or "
                   "waited for, as those of --room")
@click.option("--compiled", is_flag=True,
              help="plan with generated C (mpcc); needs the extra mpc and a C compiler")
@click.option("--laps", type=click.IntRange(min=1), default=1, show_default=True,
              help="laps of a closed path")
@click.option("--raceline", "half_width", type=FiniteNumber(0.0, 1.0), default=None, metavar="M",
              help="cut the bends of a closed path by up to M metres to either side")
@click.option("--minimum-time", "shortest", is_flag=True,
              help="search the line with the shortest lap time (with --raceline); takes some 20 s")
@click.option("--reverse", is_flag=True, help="drive from the end of the path to its start")
@click.option("--here", is_flag=True, help="shift the path so that it begins at the pose of the "
                                           "car")
@click.option("--odometry", is_flag=True,
              help="dead reckoning by wheels and gyro, from the pose of the car; drifts")
@click.option("--lane", type=FiniteNumber(0.05, 5.0), default=DEFAULT_HALF_WIDTH, show_default=True,
              help="largest offset from the path, m; the car stops beyond it")
@click.option("--careful/--no-careful", default=None,
              help="begin bends slowly, faster as the model is confirmed; default: without "
                   "model.toml")
@drive_options
@plot_option("the path and the driven line")
@waive_option
@poses_option
@lidar_option
@guard_option
@json_option
def command(url: str | None, car_name: str, cars: Path | None, path: str, speed: float | None,
            profile: bool, tracker: str | None, weights: str | None, discs: tuple[Disc, ...],
            room: str | None, room_key: Path | None, detect: bool, compiled: bool, laps: int,
            half_width: float | None, shortest: bool, reverse: bool, here: bool, odometry: bool,
            lane: float, careful: bool | None, duration: float | None, record: Path | None,
            plot: Path | None, waive: tuple[str, ...], poses: str | None, lidar: str | None,
            guard_distance: float | None, as_json: bool) -> int:
    """Follow PATH, a CSV file with the columns x,y or x,y,speed [m, m/s], or a track by its name.

    Place the car within 1 m of the path, along it; the path is in the frame of the poses. The car
    stops at the end, after --duration, when it leaves the lane and when it loses its pose; the last
    two exit 1.
    """
    if profile == (speed is not None):
        raise UsageError("one speed is required", expected="one of --speed M/S and --profile",
                         remedy=f"dart-hal follow {path} --speed 1")
    if shortest and half_width is None:
        raise UsageError("--minimum-time needs a lane for the line", expected="--raceline M",
                         remedy=f"dart-hal follow {path} --profile --raceline 0.3 --minimum-time")
    # Options that would have no effect.
    if room is None and room_key is not None:
        raise UsageError("--room-key needs --room", found=str(room_key),
                         expected="the room that the key is for",
                         remedy=f"dart-hal follow {path} --room udp://239.255.42.99:7447 ...")
    if odometry and poses is not None:
        raise UsageError("--odometry uses no poses", found=f"--poses {poses}",
                         expected="one of --odometry and --poses", remedy="leave one of them out")
    # At the limit of the tyres only a tracker that plans its speed has a margin for model errors.
    make = choose_tracker(tracker or ("mpcc" if profile else "lqr"), discs, compiled, lane, weights)
    track = track_named(path).reversed() if reverse else track_named(path)
    rules = Rules(laps, duration or inf, lane, odometry, here or odometry)
    with open_car(url, car_name, cars, record, poses, lidar, guard_distance=guard_distance) as car:
        rules = replace(rules, careful=not car.files.model if careful is None else careful)
        follower = make_follower(car, track, speed or inf, make, rules, half_width,
                                 minimum_time_line if shortest else raceline)
        summary = RunSummary(car)
        joined = nullcontext() if room is None else join(car, room, room_key=room_key)
        with end_on_interrupt(car, follower), joined as member:
            tracked = track_cars(car) if detect else None
            others = Others(member, follower, tracked) if member or tracked else None
            follow(car, follower, waive, others)
            car.stop()
        found = {**summary.as_json({"recording": record} if record else {})}
    if plot:
        found["files"]["plot"] = draw_follow(follower, path, plot)
    summary_json = summarise_drive(follower) | (others.summary if others else {})
    if as_json:
        print_json({**found, "summary": {**found["summary"], "path": path, **summary_json}})
    else:
        results.print(format_summary(summary_json), markup=False, highlight=False)
    return exit_status(follower)


def are_poses_silent(car: Car) -> bool:
    """Return whether no pose can be expected: motion capture or lidar send nothing.

    A lidar whose scans fit no map is not silent.
    """
    by_lidar = car.has_lidar and car.lidar.localiser is not None
    return car.lidar.located if by_lidar else True


def track_cars(car: Car) -> LidarPoses:
    """Let the localisation by the lidar track other cars of the size of this one; return it.

    Raises UsageError without such a localisation.
    """
    localiser = car.lidar.localiser if car.has_lidar else None
    if localiser is None:
        raise UsageError("--detect-cars needs the pose by the lidar", found="other poses",
                         expected="--poses lidar:MAP.yaml", likely="no --poses",
                         remedy="add --poses lidar:MAP.yaml, or use --room")
    body = car.files.config.geometry
    localiser.track_cars(CarSize(body.length or 2.0 * HALF_LENGTH, body.width or 2.0 * HALF_WIDTH,
                                 body.l_r))
    return localiser


def describe_missing_pose(car: Car) -> str:
    """Return why the car has no pose, with the remedy; empty before the first scan."""
    localiser = car.lidar.localiser if car.has_lidar else None
    if localiser is None:
        return ("motion capture is silent, or its source is not stated; --poses URL states it, "
                "--odometry drives by dead reckoning")
    return MISSING_BY_STATUS.get(localiser.newest.status, "") if localiser.newest else ""


def choose_tracker(name: str, discs: tuple[Disc, ...], compiled: bool, lane: float,
                   weights: str | None) -> Make:
    """Return the factory of the tracker. Raises UsageError for options of another tracker."""
    for option, value, trackers in (("--obstacle", discs, ("mpcc", "ca-mpcc")),
                                 ("--compiled", compiled, ("mpcc",)),
                                 ("--weights", weights, ("ca-mpcc",))):
        if value and name not in trackers:
            raise UsageError(f"{name} has no {option}", found=f"--tracker {name}",
                             expected=" or ".join(f"--tracker {other}" for other in trackers),
                             remedy=f"add --tracker {trackers[0]} to {option}")
    if name == "mpcc":
        return partial(contouring, discs=discs, compiled=compiled, lane=lane)
    if name == "ca-mpcc":
        return partial(curvature_aware, path_weights=WEIGHTS[weights or "tuned"], discs=discs,
                       lane=lane)
    return TRACKERS[name]


def make_follower(car: Car, track: Track, speed: float, tracker: Make, rules: Rules,
                  half_width: float | None,
                  find_line: Callable[[Track, float, Plant, float], Track] = raceline) -> Follower:
    """Return the controller of the drive, and show notices about it. Raises UsageError.

    speed [m/s]: upper limit, the speed limit of the car applies as well. half_width [m]: of the
    race line, None for the path as it is; find_line: ``raceline`` or ``minimum_time_line``.
    """
    if not car.drives:
        raise UsageError(f"{car.url} has no actuators", expected="a car with its I2C bus",
                         remedy="sim://, or serial:///dev/ttyUSB0?i2c=1")
    plant = plant_of(car.files)
    # The lower one of the requested speed and that of the car.
    max_speed = car.files.config.limits.max_speed
    cap = min(speed, max_speed)
    if half_width is not None:
        track = find_line(track, half_width, plant, cap)
    follower = Follower(track, plant, cap, tracker, rules, max_speed)
    # Planners end their search after a budget of time on this clock.
    follower.clock = lambda: car.now
    follower.silent = lambda: are_poses_silent(car)
    follower.missing_reason = lambda: describe_missing_pose(car)
    slowest = int(np.argmin(follower.profile.speed[1:])) + 1
    v = float(follower.profile.speed[slowest])
    warnings = [] if car.files.model else [
        "the car has no model.toml: the steering and delay model of the paper is used"
        + (", and bends begin slowly (--no-careful: at once)" if rules.careful else "")]
    if speed == inf and throttle_calibration(car.files).brake is None:
        warnings.append(f"the brake was not measured: {plant.brake:.2f} m/s2 is assumed "
                        "(dart-hal calibrate throttle)")
    if v < cap < inf and speed < inf and track.closed:
        warnings.append(f"{cap:g} m/s is too fast for the tightest bend: the car slows down to "
                        f"{v:.2f} m/s at {track.s[slowest]:.1f} m")
    if isinstance(follower.tracker, Contouring) and follower.tracker.compile_error:
        warnings.append("the plan is computed in numpy, not in C: "
                        f"{follower.tracker.compile_error}")
    show_notices(tuple(warnings))
    return follower


def follow(car: Car, follower: Follower, waive: tuple[str, ...],
           others: Others | None = None) -> None:
    """Drive until the controller has ended."""
    armed = False
    with open_keys() as keys, progress_bar() as bar:
        task = bar.add_task("following", total=follower.path.length * follower.rules.laps)
        for state in car.states():
            motion = estimate_motion(car, state, follower.rules)
            if others:
                others.update(motion)
            # Otherwise a car that waits before an obstacle would end as one that is stuck.
            follower.obstructed = Limit.OBSTACLE in state.applied.limited
            follower.doubts = (", ".join(sorted(state.health.doubts))
                               if Limit.ENCODER_DOUBTED in state.applied.limited else "")
            steering, speed = follower.answer(motion)
            if follower.phase is Phase.ENDED:
                return
            if follower.phase is Phase.WAITING:
                continue
            # Arming takes seconds, in which this command gets old: drive from the next state on.
            if not armed:
                armed = True
                console.print(describe_start(follower), markup=False, highlight=False)
                car.arm(waive=waive)
                continue
            car.drive_speed(steering=steering, speed=speed, source=COMMAND_SOURCE)
            car.log("follow", {"s": follower.tracker.s, "offset": follower.tracker.offset,
                               "speed": speed})
            if follower.tracker.plan_log:
                car.log("plan", follower.tracker.plan_log)
            if others:
                car.log("traffic", others.publish())
            apply_keys(keys, follower)
            bar.update(task, completed=follower.tracker.s - follower.begun_at)


def estimate_motion(car: Car, state: State, rules: Rules) -> MotionEstimate:
    """Return the motion of the car now: in the frame of the poses, or by dead reckoning."""
    # Without external poses the estimate is the dead reckoning of wheels and gyro.
    state = replace(state, external=None) if rules.odometry else state
    return state.estimate.predict(car.now)


def describe_start(follower: Follower) -> str:
    """Return a sentence about the start: where on the path the car was found."""
    side = "left" if follower.tracker.offset > 0.0 else "right"
    return (f"begins at {follower.begun_at:.2f} m of {follower.path.length:.2f} m, "
            f"{100.0 * abs(follower.tracker.offset):.0f} cm to the {side} of the path")


@contextmanager
def open_keys() -> Iterator[Terminal | None]:
    """Yield the keys of the terminal, None if standard input is no terminal."""
    if not sys.stdin.isatty():
        yield None
        return
    terminal = Terminal()
    console.print("+ and - change the speed, q slows down and ends")
    try:
        yield terminal
    finally:
        terminal.close()


def apply_keys(keys: Terminal | None, follower: Follower | LaneFollower) -> None:
    """Apply the keys pressed since the last call: + and - change the speed, q ends the drive."""
    for key in keys.keys().decode("ascii", "ignore") if keys else "":
        if key == "q":
            follower.stop("ended by the keyboard")
        elif key in "+-":
            # Relative to the fastest speed of the profile: a limit above it would have no effect.
            step = KEY_SPEED_STEP if key == "+" else -KEY_SPEED_STEP
            follower.cap = max(follower.fastest + step, MIN_KEY_SPEED)


def summarise_drive(follower: Follower) -> dict[str, Any]:
    """Return the figures of the drive.

    Offsets are by the car's own estimate, from the moment at which it was in the lane.
    """
    path = follower.path
    tracker = follower.tracker
    return {
        "ended": follower.why, "as_asked": follower.good, "length_m": path.length,
        "closed": path.closed,
        "least_radius_m": 1.0 / max(float(np.abs(path.curvature).max()), 1e-9),
        "begun_at_m": follower.begun_at, "lap_times_s": follower.driven.lap_times,
        "profile_s": follower.expected,
        **summarise_offset(follower.driven),
        **(summarise_obstacles(tracker) if isinstance(tracker, Contouring) else {})}


def summarise_offset(driven: DriveRecord) -> dict[str, float | None]:
    """Return root mean square and largest value of the offset [m]; None before the first call."""
    has_figures = driven.offset_max >= 0.0
    return {"offset_rms_m": driven.offset_rms if has_figures else None,
            "offset_max_m": driven.offset_max if has_figures else None}


def summarise_obstacles(tracker: Contouring[Any]) -> dict[str, Any]:
    """Return counts of plans by outcome, and by obstacle the smallest gap to the body [m]."""
    return {"plans": {str(how): n for how, n in tracker.mpcc.outcomes.items() if n},
            "obstacles": [{"x": disc.x, "y": disc.y, "radius_m": disc.radius,
                           "air_m": gap if gap < inf else None}
                          for disc, gap in zip(tracker.discs, tracker.air, strict=True)]}


def format_summary(summary: dict[str, Any]) -> str:
    """Return the figures of the drive as one sentence."""
    if summary["offset_rms_m"] is None:
        return f"ended: {summary['ended']}"
    laps = ", ".join(f"{t:.2f}" for t in summary["lap_times_s"])
    obstacles = enumerate(summary.get("obstacles", ()), start=1)
    return (f"ended: {summary['ended']}; offset from the path "
            f"{100.0 * summary['offset_rms_m']:.1f} "
            f"cm rms, {100.0 * summary['offset_max_m']:.1f} cm at most"
            + (f"; laps of {laps} s, {summary['profile_s']:.2f} s by the profile" if laps else "")
            + "".join(f"; {100.0 * disc['air_m']:.1f} cm to obstacle {k}" for k, disc in obstacles
                      if disc["air_m"] is not None))
