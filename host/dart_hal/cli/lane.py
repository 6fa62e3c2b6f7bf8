"""``dart-hal lane``: the middle of a lane between two boards, by the lidar alone."""

from __future__ import annotations

from math import inf
from pathlib import Path
from typing import Any

import click
import numpy as np

from dart_hal.car import Car
from dart_hal.cli.common.follow_picture import draw_lane
from dart_hal.cli.common.options import (
    Number,
    car_options,
    drive_options,
    json_option,
    lidar_option,
    waive_option,
)
from dart_hal.cli.common.output import console, notices, print_json, progress_bar, results
from dart_hal.cli.common.outputs import PlotFile
from dart_hal.cli.common.session import check_drives_by_lidar, opened
from dart_hal.cli.common.summary import Summary
from dart_hal.cli.follow import listen, typed
from dart_hal.control.ending import Phase
from dart_hal.control.lane_follow import LaneFollower
from dart_hal.control.plant import plant_of
from dart_hal.estimation.localisation.localiser import MIRRORED

SOURCE = "lane"


@click.command("lane")
@car_options
@click.option("--speed", type=Number(0.1, 10.0), default=1.0, show_default=True,
              help="m/s; slower in bends that ask for it, and where little of the lane is seen; "
              "keys + and - change it")
@click.option("--distance", type=Number(min=0.1), default=None,
              help="m after which it is stopped")
@drive_options
@click.option("--plot", type=PlotFile(), default=None,
              help="write a picture of the lane and the driven line")
@lidar_option
@waive_option
@json_option
def command(url: str | None, car_name: str, cars: Path | None, speed: float,
            distance: float | None, duration: float | None, record: Path | None,
            plot: Path | None, lidar: str | None, waive: tuple[str, ...], as_json: bool) -> int:
    """Drive in the middle of a lane between two boards or walls, by the lidar alone.

    The car stands in the lane and looks along it (within 30 degrees). It slows down to rest where
    the lane ends; and when it sees no board, one board only, or the lidar is silent, which
    exits 1.
    """
    with opened(url, car_name, cars, record, lidar=lidar) as car:
        follower = follower_of(car, speed, distance or inf, duration or inf)
        summary = Summary(car)
        drive(car, follower, waive)
        car.stop()
        found = {**summary.as_json({"recording": record} if record else {})}
    if plot:
        found["files"]["plot"] = draw_lane(follower, plot)
    told = figures(follower)
    if as_json:
        print_json({**found, "summary": {**found["summary"], **told}})
    else:
        results.print(sentence(told), markup=False, highlight=False)
    return 0 if follower.good else 1


def follower_of(car: Car, speed: float, distance: float, duration: float) -> LaneFollower:
    """The drive that was asked for. Raises UsageError for a car that cannot."""
    check_drives_by_lidar(car, "lane")
    notices(() if car.files.model else
            ("the car has no model.toml: bends and delays by the paper's",))
    most = car.files.config.limits.max_speed
    return LaneFollower(plant_of(car.files), min(speed, most), distance, duration)


def drive(car: Car, follower: LaneFollower, waive: tuple[str, ...],
          title: str = "in the lane") -> None:
    """Drive until it has ended."""
    armed = False
    with typed() as keys, progress_bar() as bar:
        task = bar.add_task(title, total=None)
        for state in car.states():
            scans = car.lidar.scans()
            steering, speed = follower.answer(car.now, state.speed, scans)
            if scans and mirrored(car):
                follower.stop("the scans turn against the gyro: inverted in [lidar]", good=False)
            if follower.phase is Phase.ENDED:
                return
            if follower.phase is Phase.WAITING:
                continue
            if not armed:
                armed = True
                console.print(follower.told())
                car.arm(waive=waive)
                continue
            car.drive_speed(steering=steering, speed=speed, source=SOURCE)
            car.log("lane", {"offset": follower.offset, "half_width": follower.half,
                             "speed": speed, "trim": follower.model.trim})
            listen(keys, follower)
            bar.update(task, completed=follower.model.way)


def mirrored(car: Car) -> bool:
    """Whether the lidar takes left for right, as far as the car has turned."""
    health = car.lidar.health
    return health is not None and health.sense is not None and health.sense < MIRRORED


def figures(follower: LaneFollower) -> dict[str, Any]:
    """What the drive came to; offsets by the car's own estimate."""
    driven = follower.driven.table
    offset = driven[:, 3]
    return {
        "ended": follower.why, "as_asked": follower.good, "way_m": follower.model.way,
        "half_width_m": follower.half or None, "trim_rad": follower.model.trim,
        "lidar_yaw_rad": follower.model.mount,
        "offset_rms_m": float(np.sqrt(np.mean(offset**2))) if len(driven) else None,
        "offset_max_m": float(np.abs(offset).max()) if len(driven) else None}


def sentence(told: dict[str, Any]) -> str:
    """The same to be read."""
    if told["offset_rms_m"] is None:
        return f"ended: {told['ended']}"
    trim, yaw = (float(np.degrees(told[name])) for name in ("trim_rad", "lidar_yaw_rad"))
    return (f"ended: {told['ended']}; {told['way_m']:.1f} m, {100.0 * told['offset_rms_m']:.1f} cm "
            f"rms beside the middle, {100.0 * told['offset_max_m']:.1f} cm at most; wheels "
            f"{trim:+.1f} deg to the left of the map, lidar {yaw:+.1f} deg")
