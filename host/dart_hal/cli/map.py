"""``dart-hal map``: drive through a room and make a map of it."""

from __future__ import annotations

from contextlib import closing
from math import inf
from pathlib import Path
from typing import Any

import click
import numpy as np

from dart_hal.car import Car
from dart_hal.cli.common.map_picture import draw_map
from dart_hal.cli.common.options import (
    FiniteNumber,
    car_options,
    json_option,
    lidar_option,
    plot_option,
    waive_option,
)
from dart_hal.cli.common.output import console, print_json, progress_bar, results, show_notices
from dart_hal.cli.common.outputs import OutputFile
from dart_hal.cli.common.session import INTERRUPTED, check_drives_by_lidar, open_car
from dart_hal.cli.drive import run_manual
from dart_hal.cli.lane import drive as drive_along
from dart_hal.control.gamepad_map import open_gamepad
from dart_hal.control.keyboard import Keyboard
from dart_hal.control.lane_follow import WallFollower
from dart_hal.control.lap import CRAWL_SPEED
from dart_hal.control.plant import plant_of
from dart_hal.control.wall import Wall
from dart_hal.core.errors import Disarmed, LinkLost, UsageError
from dart_hal.estimation.localisation.field import map_of_grid
from dart_hal.estimation.localisation.grid import Grid, write_grid
from dart_hal.estimation.localisation.health import MIN_AGREEMENT, agreement
from dart_hal.estimation.mapping.checks import MIN_DRIVE, MapChecks
from dart_hal.estimation.mapping.keyframes import Survey
from dart_hal.estimation.mapping.mapper import Mapper
from dart_hal.estimation.mapping.occupancy import DEFAULT_CELL, grid_of

# Places that a map needs: the drive between two of them.
MIN_FRAMES = 2


@click.command("map")
@car_options
@click.argument("out", metavar="OUT.yaml", type=OutputFile(".yaml", ".yml"))
@click.option("--run", type=click.Path(path_type=Path, dir_okay=False), default=None,
              help="map this recording with scans; no car is driven")
@click.option("--speed", type=FiniteNumber(CRAWL_SPEED, 3.0), default=None,
              help="drive along the walls automatically, m/s; keys + and - change it, q ends")
@click.option("--keyboard", is_flag=True, help="drive with the arrow keys or WASD of this terminal")
@click.option("--gamepad", is_flag=True, help="drive with the gamepad; hold the right bumper")
@click.option("--side", type=click.Choice(["left", "right"]), default="right", show_default=True,
              help="side of the car on which the wall is")
@click.option("--gap", type=FiniteNumber(0.3, 3.0), default=0.6, show_default=True,
              help="m to that wall")
@click.option("--distance", type=FiniteNumber(min=MIN_DRIVE), default=None,
              help="m after which the car stops")
@click.option("--duration", type=FiniteNumber(min=0.1), default=None,
              help="s after which the car stops")
@click.option("--max-throttle", type=FiniteNumber(0.0, 1.0), default=0.25, show_default=True,
              help="throttle of a key or of a stick pushed to its end")
@click.option("--cell", type=FiniteNumber(0.01, 0.2), default=DEFAULT_CELL, show_default=True,
              help="side of a cell of the map, m")
@click.option("--record", type=OutputFile(replaces=False), default=None,
              help="write the drive to this MCAP file (default: OUT.mcap)")
@plot_option("map, path and loop closures")
@lidar_option
@waive_option
@json_option
def command(url: str | None, car_name: str, cars: Path | None, out: Path, run: Path | None,
            speed: float | None, keyboard: bool, gamepad: bool, side: str, gap: float,
            distance: float | None, duration: float | None, max_throttle: float, cell: float,
            record: Path | None, plot: Path | None, lidar: str | None, waive: tuple[str, ...],
            as_json: bool) -> int:
    """Map a room: writes OUT.yaml and OUT.pgm, as ROS's map_server reads them.

    You drive the car, or it drives along the walls. The recording of the drive is mapped, from the
    start pose as origin. Ctrl-C stops the car and maps what was driven. Exits 1 if the map explains
    too few of its scans, or the drive was aborted.
    """
    if (run is not None) + (speed is not None) + keyboard + gamepad != 1:
        raise UsageError("exactly one way to drive the room is required",
                         expected="one of --speed M/S, --keyboard, "
                         "--gamepad, --run FILE", remedy=f"dart-hal map {out} --speed 0.8")
    ended = ""
    good = True
    if run is None:
        run = record or out.with_suffix(".mcap")
        # 1. Drive, by hand or along the walls; everything is recorded.
        manual = Keyboard() if keyboard else open_gamepad() if gamepad else None
        try:
            with open_car(url, car_name, cars, run, lidar=lidar) as car:
                check_drives_by_lidar(car, "room")
                if manual is not None:
                    with closing(manual):
                        car.arm(waive=waive)
                        run_manual(car, manual, max_throttle, duration or inf)
                else:
                    follower = drive_along_walls(car, speed or 0.0,
                                                 Wall(1 if side == "left" else -1, gap),
                                                 distance or inf, duration or inf, waive)
                    ended, good = follower.why, follower.good
                car.stop()
        except KeyboardInterrupt:
            ended = INTERRUPTED
            console.print(f"{ended}: the part that was driven is mapped")
        except (Disarmed, LinkLost) as why:
            ended, good = why.what, False
            console.print(str(why), style="red", markup=False, highlight=False)
    # 2. Map the recording: an aborted drive and --run FILE give a map in the same way.
    survey, warnings = build_survey(run, car_name, cars)
    show_notices(warnings)
    grid = grid_of(survey, cell)
    image = write_grid(grid, out)
    # 3. Compare the map with its own scans: a wrong loop closure leaves walls that the scans
    #    contradict.
    found = summarise_map(survey, grid) | {"ended": ended, "as_asked": good, "files": {
        "map": str(out), "image": str(image), "recording": str(run)}}
    if plot:
        found["files"]["plot"] = str(draw_map(survey, grid, plot))
    if as_json:
        print_json(found)
    else:
        results.print(format_summary(found), markup=False, highlight=False)
    return 0 if good and found["explained"] > MIN_AGREEMENT else 1


def drive_along_walls(car: Car, speed: float, wall: Wall, distance: float, duration: float,
                      waive: tuple[str, ...]) -> WallFollower:
    """Drive along the walls until the distance, the duration or the walls end."""
    max_speed = car.files.config.limits.max_speed
    follower = WallFollower(plant_of(car.files), min(speed, max_speed), distance, duration, wall)
    drive_along(car, follower, waive, "along the walls")
    return follower


def build_survey(run: Path, car_name: str, cars: Path | None) -> tuple[Survey, tuple[str, ...]]:
    """Map a recording; return the survey and warnings. Raises UsageError, RecordingError."""
    mapper = Mapper()
    checks = MapChecks()
    distance = 0.0
    with Car.open(f"replay://{run}", car=car_name, cars=cars) as car, progress_bar() as bar:
        task = bar.add_task("mapping", total=None)
        previous = None
        for n, state in enumerate(car.states()):
            pose = state.pose
            if previous is not None:
                distance += float(np.hypot(pose.x - previous.x, pose.y - previous.y))
            previous = pose
            mapper.update_odometry(state.t, pose.x, pose.y, pose.yaw)
            for scan in car.lidar.scans():
                # Raises as soon as the scans turn against the gyro: a mirrored map would be of no
                # use.
                checks.add(scan, pose.yaw)
                mapper.add(scan)
            if n % 20 == 0:
                bar.update(task, completed=n)
    checks.judge(distance)
    if len(mapper.frames) < MIN_FRAMES:
        why = mapper.broken or "too few beams of a scan have an echo"
        raise UsageError("the scans are too few for a map", read=str(run),
                         found=f"{len(mapper.frames)} of {checks.scans} scans used: {why}",
                         expected=f"{MIN_FRAMES} places with scans of 60 echoes or more",
                         remedy="dart-hal doctor, then record the drive again")
    warnings = []
    if mapper.broken:
        warnings.append(f"the map ends where the lidar sent no scans: {mapper.broken}")
    if checks.is_sense_unknown:
        warnings.append("the car turned too little to check the mounting side of the lidar")
    return mapper.finish(), tuple(warnings)


def summarise_map(survey: Survey, grid: Grid) -> dict[str, Any]:
    """Return the figures of the map.

    "explained" is the mean share of the points of a scan that lie on walls of the map, over about
    50 keyframes.
    """
    chart = map_of_grid(grid)
    # About 50 keyframes over the whole drive are enough for a mean.
    step = max(len(survey.frames) // 50, 1)
    explained = [agreement(chart, np.append(pose, 0.0), frame.own.points, frame.own.rays,
                           frame.own.origin).share
                 for frame, pose in zip(survey.frames[::step], survey.poses[::step], strict=True)]
    path = survey.path()
    row, column = np.nonzero(grid.occupied)
    # ``survey.closures`` are those that the solution uses; it rejects those that contradict it.
    proposed = sum(edge.is_closure for edge in survey.edges)
    return {
        "way_m": survey.frames[-1].travel, "duration_s": float(path[-1, 0] - path[0, 0]),
        "keyframes": len(survey.frames), "closures": len(survey.closures),
        "closures_refused": proposed - len(survey.closures), "explained": float(np.mean(explained)),
        "cell_m": grid.cell, "walls_cells": len(row),
        "size_m": [float(np.ptp(v) + 1) * grid.cell for v in (column, row)]}


def format_summary(found: dict[str, Any]) -> str:
    """Return the figures of the map as one sentence."""
    x, y = found["size_m"]
    ended = f"ended: {found['ended']}; " if found["ended"] else ""
    return (f"{ended}{found['files']['map']}: {x:.1f} x {y:.1f} m in cells of "
            f"{100.0 * found['cell_m']:g} cm, of {found['way_m']:.1f} m driven in "
            f"{found['duration_s']:.0f} s; {found['keyframes']} keyframes, {found['closures']} "
            f"loop closures ({found['closures_refused']} rejected); the map explains "
            f"{100.0 * found['explained']:.0f} % of the scans")
