"""``dart-hal lane``: drive in the middle of a lane between two boards, by the lidar alone."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import Any

import click
import numpy as np

from dart_hal.car import Car
from dart_hal.car.obstacle_guard import half_width
from dart_hal.cli.common.follow_picture import draw_lane
from dart_hal.cli.common.options import (
    FiniteNumber,
    car_options,
    drive_options,
    json_option,
    lidar_option,
    plot_option,
    waive_option,
)
from dart_hal.cli.common.output import console, print_json, progress_bar, results, show_notices
from dart_hal.cli.common.session import (
    check_drives_by_lidar,
    end_on_interrupt,
    exit_status,
    open_car,
)
from dart_hal.cli.common.summary import RunSummary
from dart_hal.cli.follow import apply_keys, open_keys, summarise_offset
from dart_hal.control.ending import Phase
from dart_hal.control.lane_follow import LaneFollower
from dart_hal.control.lap import CRAWL_SPEED
from dart_hal.control.plant import plant_of
from dart_hal.estimation.localisation.localiser import MIN_ROTATION_SENSE

COMMAND_SOURCE = "lane"


@click.command("lane")
@car_options
@click.option("--speed", type=FiniteNumber(CRAWL_SPEED, 10.0), default=1.0, show_default=True,
              help="m/s; slower in tight bends and where little of the lane is visible; "
              "keys + and - change it")
@click.option("--distance", type=FiniteNumber(min=0.1), default=None,
              help="m after which the car stops")
@drive_options
@plot_option("the lane and the driven line")
@lidar_option
@waive_option
@json_option
def command(url: str | None, car_name: str, cars: Path | None, speed: float,
            distance: float | None, duration: float | None, record: Path | None,
            plot: Path | None, lidar: str | None, waive: tuple[str, ...], as_json: bool) -> int:
    """Drive in the middle of a lane between two boards or walls, by the lidar alone.

    Place the car in the lane, along it (within 30 degrees). The car stops at the end of the lane.
    It also stops, with exit status 1, if the lidar detects fewer than two boards or sends no scans.
    """
    with open_car(url, car_name, cars, record, lidar=lidar) as car:
        follower = make_follower(car, speed, distance or inf, duration or inf)
        summary = RunSummary(car)
        with end_on_interrupt(car, follower):
            drive(car, follower, waive)
            car.stop()
        found = {**summary.as_json({"recording": record} if record else {})}
    if plot:
        found["files"]["plot"] = draw_lane(follower, plot)
    summary_json = summarise_drive(follower)
    if as_json:
        print_json({**found, "summary": {**found["summary"], **summary_json}})
    else:
        results.print(format_summary(summary_json), markup=False, highlight=False)
    return exit_status(follower)


def make_follower(car: Car, speed: float, distance: float, duration: float) -> LaneFollower:
    """Return the controller of the drive. Raises UsageError for a car without lidar or bus."""
    check_drives_by_lidar(car, "lane")
    show_notices(() if car.files.model else
                 ("the car has no model.toml: the steering and delay model of the paper is used",))
    max_speed = car.files.config.limits.max_speed
    return LaneFollower(plant_of(car.files), min(speed, max_speed), distance, duration,
                        half_width=half_width(car.files.config.geometry))


def drive(car: Car, follower: LaneFollower, waive: tuple[str, ...],
          title: str = "in the lane") -> None:
    """Drive until the controller has ended."""
    armed = False
    with open_keys() as keys, progress_bar() as bar:
        task = bar.add_task(title, total=None)
        for state in car.states():
            scans = car.lidar.scans()
            steering, speed = follower.answer(car.now, state.speed, scans)
            # Upside down, left and right of the lane are exchanged: the car would steer into a
            # board.
            if scans and is_mirrored(car):
                follower.stop("the scans turn against the gyro: check inverted in [lidar]",
                              good=False)
            if follower.phase is Phase.ENDED:
                return
            if follower.phase is Phase.WAITING:
                continue
            # Arming takes seconds, in which this command gets old: drive from the next state on.
            if not armed:
                armed = True
                console.print(follower.describe())
                car.arm(waive=waive)
                continue
            car.drive_speed(steering=steering, speed=speed, source=COMMAND_SOURCE)
            car.log("lane", {"offset": follower.offset, "half_width": follower.half,
                             "speed": speed, "trim": follower.model.trim})
            apply_keys(keys, follower)
            bar.update(task, completed=follower.model.distance)


def is_mirrored(car: Car) -> bool:
    """Return whether the lidar is mounted upside down, judged by the turns so far."""
    # The scan turns against the gyro in every turn of the car if the lidar is upside down.
    health = car.lidar.health
    return health is not None and health.sense is not None and health.sense < MIN_ROTATION_SENSE


def summarise_drive(follower: LaneFollower) -> dict[str, Any]:
    """Return the figures of the drive; offsets are by the car's own estimate."""
    return {
        "ended": follower.why, "as_asked": follower.good, "way_m": follower.model.distance,
        "half_width_m": follower.half or None, "trim_rad": follower.model.trim,
        "lidar_yaw_rad": follower.model.mount,
        **summarise_offset(follower.driven)}


def format_summary(summary: dict[str, Any]) -> str:
    """Return the figures of the drive as one sentence."""
    if summary["offset_rms_m"] is None:
        return f"ended: {summary['ended']}"
    trim, yaw = (float(np.degrees(summary[name])) for name in ("trim_rad", "lidar_yaw_rad"))
    return (f"ended: {summary['ended']}; {summary['way_m']:.1f} m; offset from the middle "
            f"{100.0 * summary['offset_rms_m']:.1f} cm rms, {100.0 * summary['offset_max_m']:.1f} "
            "cm "
            f"at most; wheels {trim:+.1f} deg to the left of the steering map, lidar yaw "
            f"{yaw:+.1f} deg")
