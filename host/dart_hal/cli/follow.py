"""``dart-hal follow``: a path, by a tracker that knows the car, at a speed that it holds."""

from __future__ import annotations

import sys
from collections.abc import Iterator
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
from dart_hal.cli.common.follow_picture import draw
from dart_hal.cli.common.options import (
    DiscType,
    Number,
    car_options,
    drive_options,
    json_option,
    lidar_option,
    poses_option,
    room_key_option,
    waive_option,
)
from dart_hal.cli.common.output import console, notices, print_json, progress_bar, results
from dart_hal.cli.common.outputs import PlotFile
from dart_hal.cli.common.session import opened
from dart_hal.cli.common.summary import Summary
from dart_hal.control.curvature_aware.generator import WEIGHTS
from dart_hal.control.ending import Phase
from dart_hal.control.follow import LANE, Follower, Rules
from dart_hal.control.keyboard import Terminal
from dart_hal.control.lane_follow import LaneFollower
from dart_hal.control.mpc.obstacles import Disc
from dart_hal.control.mpc.tracker import Contouring
from dart_hal.control.paths import Path as Track
from dart_hal.control.plant import plant_of
from dart_hal.control.raceline import raceline
from dart_hal.control.trackers import TRACKERS, Make, contouring, curvature_aware
from dart_hal.control.tracks import track_named
from dart_hal.core.errors import UsageError
from dart_hal.core.types import MotionEstimate, State

STEP, SLOWEST = 0.1, 0.3
"""m/s for a key, and the least that keys ask for."""
SOURCE = "follow"


@click.command("follow")
@car_options
@click.argument("path", metavar="PATH")
@click.option("--speed", type=Number(0.1, 10.0), default=None,
              help="m/s; slower where tyres, steering or path ask for it; keys + and - change it")
@click.option("--profile", is_flag=True, help="as fast as the car's model holds everywhere")
@click.option("--tracker", type=click.Choice(list(TRACKERS)), default="lqr", show_default=True,
              help="linear-quadratic with preview, pure pursuit, contouring control, or two "
                   "layers of it that know the bend ahead")
@click.option("--weights", type=click.Choice(list(WEIGHTS)), default=None,
              help="of the planned path (ca-mpcc): tuned, the default, or as published")
@click.option("--obstacle", "discs", type=DiscType(), multiple=True, metavar="X,Y,R[,SPEED]",
              help="a disc to be passed (mpcc, ca-mpcc): middle in the frame of the poses and "
                   "radius, m; m/s along the path; may be given again")
@click.option("--room", default=None, metavar="URL",
              help="enter this room of cars (udp://.., zenoh://.., local://..): others on the path "
                   "are passed (mpcc, ca-mpcc) or waited for")
@room_key_option
@click.option("--compiled", is_flag=True,
              help="plan by generated C (mpcc): the extra mpc and a C compiler")
@click.option("--laps", type=click.IntRange(min=1), default=1, show_default=True,
              help="of a closed path")
@click.option("--raceline", "half_width", type=Number(0.0, 1.0), default=None, metavar="M",
              help="cut the bends of a closed path by up to M m to either side")
@click.option("--reverse", is_flag=True, help="from the path's end to its start")
@click.option("--here", is_flag=True, help="lay the path so that it begins where the car stands")
@click.option("--odometry", is_flag=True,
              help="by wheels and gyro alone, from where the car stands; drifts")
@click.option("--lane", type=Number(0.05, 5.0), default=LANE, show_default=True,
              help="m beside the path at which the car is stopped")
@drive_options
@click.option("--plot", type=PlotFile(), default=None,
              help="write a picture of the path and the driven line")
@waive_option
@poses_option
@lidar_option
@json_option
def command(url: str | None, car_name: str, cars: Path | None, path: str, speed: float | None,
            profile: bool, tracker: str, weights: str | None, discs: tuple[Disc, ...],
            room: str | None, room_key: Path | None, compiled: bool, laps: int,
            half_width: float | None, reverse: bool, here: bool, odometry: bool, lane: float,
            duration: float | None, record: Path | None, plot: Path | None,
            waive: tuple[str, ...], poses: str | None, lidar: str | None, as_json: bool) -> int:
    """Follow PATH, a CSV file with the columns x,y or x,y,speed [m, m/s], or a track by its name.

    The path lies in the frame of the poses (motion capture); the car starts within 1 m of it,
    looking along it. It slows down to rest at the end, and when it leaves the lane, loses its pose
    or is out of time; leaving the lane and losing the pose exit 1.
    """
    if profile == (speed is not None):
        raise UsageError("say how fast", expected="one of --speed M/S and --profile",
                         remedy=f"dart-hal follow {path} --speed 1")
    make = tracker_of(tracker, discs, compiled, lane, weights)
    track = track_named(path).reversed() if reverse else track_named(path)
    rules = Rules(laps, duration or inf, lane, odometry, here or odometry)
    with opened(url, car_name, cars, record, poses, lidar) as car:
        follower = follower_of(car, track, speed or inf, make, rules, half_width)
        summary = Summary(car)
        with (nullcontext() if room is None else join(car, room, room_key=room_key)) as member:
            cars_about = Others(member, follower) if member else None
            follow(car, follower, waive, cars_about)
            car.stop()
        found = {**summary.as_json({"recording": record} if record else {})}
    if plot:
        found["files"]["plot"] = draw(follower, path, plot)
    told = figures(follower) | (cars_about.told if cars_about else {})
    if as_json:
        print_json({**found, "summary": {**found["summary"], "path": path, **told}})
    else:
        results.print(sentence(told), markup=False, highlight=False)
    return 0 if follower.good else 1


def tracker_of(name: str, discs: tuple[Disc, ...], compiled: bool, lane: float,
               weights: str | None) -> Make:
    """What makes the tracker. Raises UsageError for options of another one."""
    for option, given, whose in (("--obstacle", discs, ("mpcc", "ca-mpcc")),
                                 ("--compiled", compiled, ("mpcc",)),
                                 ("--weights", weights, ("ca-mpcc",))):
        if given and name not in whose:
            raise UsageError(f"{name} has no {option}", found=f"--tracker {name}",
                             expected=" or ".join(f"--tracker {other}" for other in whose),
                             remedy=f"add --tracker {whose[0]} to {option}")
    if name == "mpcc":
        return partial(contouring, discs=discs, compiled=compiled, lane=lane)
    if name == "ca-mpcc":
        return partial(curvature_aware, path_weights=WEIGHTS[weights or "tuned"], discs=discs,
                       lane=lane)
    return TRACKERS[name]


def follower_of(car: Car, track: Track, speed: float, tracker: Make, rules: Rules,
                half_width: float | None) -> Follower:
    """The drive that was asked for; says what of it the car cannot. Raises UsageError."""
    if not car.drives:
        raise UsageError(f"{car.url} has nothing to drive", expected="a car with its I2C bus",
                         remedy="sim://, or serial:///dev/ttyUSB0?i2c=1")
    plant, most = plant_of(car.files), car.files.config.limits.max_speed
    cap = min(speed, most)
    if half_width is not None:
        track = raceline(track, half_width, plant, cap)
    follower = Follower(track, plant, cap, tracker, rules, most)
    follower.clock = lambda: car.now
    follower.silent = lambda: car.has_lidar and car.lidar.located
    slowest = int(np.argmin(follower.profile.speed[1:])) + 1
    v = float(follower.profile.speed[slowest])
    said = [] if car.files.model else ["the car has no model.toml: bends and delays by the paper's"]
    if v < cap < inf and speed < inf and track.closed:
        said.append(f"{cap:g} m/s is more than the car holds in every bend: {v:.2f} m/s at "
                    f"{track.s[slowest]:.1f} m")
    if isinstance(follower.tracker, Contouring) and follower.tracker.in_numpy:
        said.append(f"numpy plans, not C: {follower.tracker.in_numpy}")
    notices(tuple(said))
    return follower


def follow(car: Car, follower: Follower, waive: tuple[str, ...],
           others: Others | None = None) -> None:
    """Drive until it has ended."""
    armed = False
    with typed() as keys, progress_bar() as bar:
        task = bar.add_task("following", total=follower.path.length * follower.rules.laps)
        for state in car.states():
            motion = motion_of(car, state, follower.rules)
            if others:
                others.look(motion)
            steering, speed = follower.answer(motion)
            if follower.phase is Phase.ENDED:
                return
            if follower.phase is Phase.WAITING:
                continue
            if not armed:
                armed = True
                console.print(picked_up(follower), markup=False, highlight=False)
                car.arm(waive=waive)
                continue
            car.drive_speed(steering=steering, speed=speed, source=SOURCE)
            car.log("follow", {"s": follower.tracker.s, "offset": follower.tracker.offset,
                               "speed": speed})
            if follower.tracker.told:
                car.log("plan", follower.tracker.told)
            if others:
                car.log("traffic", others.tell())
            listen(keys, follower)
            bar.update(task, completed=follower.tracker.s - follower.begun_at)


def motion_of(car: Car, state: State, rules: Rules) -> MotionEstimate:
    """Where the car is now, in the room, or by dead reckoning."""
    state = replace(state, external=None) if rules.odometry else state
    return state.estimate.at(car.now)


def picked_up(follower: Follower) -> str:
    """Where on the path the car was found."""
    side = "left" if follower.tracker.offset > 0.0 else "right"
    return (f"begins at {follower.begun_at:.2f} m of {follower.path.length:.2f} m, "
            f"{100.0 * abs(follower.tracker.offset):.0f} cm to the {side} of the path")


@contextmanager
def typed() -> Iterator[Terminal | None]:
    """The keys of the terminal, if there is one."""
    if not sys.stdin.isatty():
        yield None
        return
    terminal = Terminal()
    console.print("+ and - change the speed, q slows down and ends")
    try:
        yield terminal
    finally:
        terminal.close()


def listen(keys: Terminal | None, follower: Follower | LaneFollower) -> None:
    """What was typed."""
    for key in keys.keys().decode("ascii", "ignore") if keys else "":
        if key == "q":
            follower.stop("ended by the keyboard")
        elif key in "+-":
            follower.cap = max(follower.fastest + (STEP if key == "+" else -STEP), SLOWEST)


def figures(follower: Follower) -> dict[str, Any]:
    """What the drive came to; offsets by the car's own estimate, once it was in the lane."""
    driven, path, tracker = follower.driven.table, follower.path, follower.tracker
    inside = np.abs(driven[:, 3])[follower.joined:] if len(driven) else np.zeros(0)
    return {
        "ended": follower.why, "as_asked": follower.good, "length_m": path.length,
        "closed": path.closed,
        "least_radius_m": 1.0 / max(float(np.abs(path.curvature).max()), 1e-9),
        "begun_at_m": follower.begun_at, "lap_times_s": follower.driven.lap_times,
        "profile_s": follower.expected,
        "offset_rms_m": float(np.sqrt(np.mean(inside**2))) if len(inside) else None,
        "offset_max_m": float(inside.max()) if len(inside) else None,
        **(passed(tracker) if isinstance(tracker, Contouring) else {})}


def passed(tracker: Contouring[Any]) -> dict[str, Any]:
    """Plans by how they came about, and the least air beside the body at each obstacle."""
    return {"plans": {str(how): n for how, n in tracker.mpcc.outcomes.items() if n},
            "obstacles": [{"x": disc.x, "y": disc.y, "radius_m": disc.radius,
                           "air_m": air if air < inf else None}
                          for disc, air in zip(tracker.discs, tracker.air, strict=True)]}


def sentence(told: dict[str, Any]) -> str:
    """The same to be read."""
    if told["offset_rms_m"] is None:
        return f"ended: {told['ended']}"
    laps = ", ".join(f"{t:.2f}" for t in told["lap_times_s"])
    return (f"ended: {told['ended']}; {100.0 * told['offset_rms_m']:.1f} cm rms beside the path, "
            f"{100.0 * told['offset_max_m']:.1f} cm at most"
            + (f"; laps of {laps} s, {told['profile_s']:.2f} s by the profile" if laps else "")
            + "".join(f"; {100.0 * disc['air_m']:.1f} cm beside obstacle {k}" for k, disc in
                      enumerate(told.get("obstacles", ()), start=1) if disc["air_m"] is not None))
