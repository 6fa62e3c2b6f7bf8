"""``dart-hal map``: a drive through the room becomes a map of it."""

from __future__ import annotations

from contextlib import closing
from math import inf
from pathlib import Path
from typing import Any

import click
import numpy as np

from dart_hal.car import Car
from dart_hal.cli.common.map_picture import draw
from dart_hal.cli.common.options import (
    Number,
    car_options,
    json_option,
    lidar_option,
    waive_option,
)
from dart_hal.cli.common.output import console, notices, print_json, progress_bar, results
from dart_hal.cli.common.outputs import OutputFile, PlotFile
from dart_hal.cli.common.session import check_drives_by_lidar, opened
from dart_hal.cli.drive import run_manual
from dart_hal.cli.lane import drive as drive_along
from dart_hal.control.gamepad import Gamepad
from dart_hal.control.keyboard import Keyboard
from dart_hal.control.lane_follow import WallFollower
from dart_hal.control.plant import plant_of
from dart_hal.control.wall import Wall
from dart_hal.core.errors import Disarmed, LinkLost, UsageError
from dart_hal.estimation.localisation.field import map_of_grid
from dart_hal.estimation.localisation.grid import Grid, write_grid
from dart_hal.estimation.localisation.health import AGREED, agreement
from dart_hal.estimation.mapping.checks import Checks
from dart_hal.estimation.mapping.keyframes import Survey
from dart_hal.estimation.mapping.mapper import Mapper
from dart_hal.estimation.mapping.occupancy import CELL, grid_of


@click.command("map")
@car_options
@click.argument("out", metavar="OUT.yaml", type=OutputFile(".yaml", ".yml"))
@click.option("--run", type=click.Path(path_type=Path, dir_okay=False), default=None,
              help="map this recording, which holds scans; no car is driven")
@click.option("--speed", type=Number(0.1, 3.0), default=None,
              help="m/s along the walls, on their own; keys + and - change it, q ends")
@click.option("--keyboard", is_flag=True, help="drive by the arrow keys or WASD of this terminal")
@click.option("--gamepad", is_flag=True, help="drive by /dev/input/js0, right bumper held")
@click.option("--side", type=click.Choice(["left", "right"]), default="right", show_default=True,
              help="where the wall is that is driven along")
@click.option("--gap", type=Number(0.3, 3.0), default=0.6, show_default=True,
              help="m from that wall")
@click.option("--distance", type=Number(min=0.1), default=None,
              help="m after which it is stopped")
@click.option("--duration", type=Number(min=0.1), default=None, help="s after which it is stopped")
@click.option("--max-throttle", type=Number(0.0, 1.0), default=0.25, show_default=True,
              help="scale of keyboard and gamepad")
@click.option("--cell", type=Number(0.01, 0.2), default=CELL, show_default=True,
              help="m of a cell")
@click.option("--record", type=OutputFile(replaces=False), default=None,
              help="keep the drive in this MCAP file (default: OUT.mcap)")
@click.option("--plot", type=PlotFile(), default=None,
              help="write a picture of map, path and loop closures")
@lidar_option
@waive_option
@json_option
def command(url: str | None, car_name: str, cars: Path | None, out: Path, run: Path | None,
            speed: float | None, keyboard: bool, gamepad: bool, side: str, gap: float,
            distance: float | None, duration: float | None, max_throttle: float, cell: float,
            record: Path | None, plot: Path | None, lidar: str | None, waive: tuple[str, ...],
            as_json: bool) -> int:
    """Map the room: OUT.yaml and OUT.pgm, as ROS's map_server reads them.

    The car is driven by hand or along its walls, and the drive recorded; then the recording is
    mapped. Ctrl-C stops the car, and what was driven is mapped. The frame of the map begins where
    the car did. Exits 1 where the map does not explain the scans that it is made of, and where
    the drive ended otherwise than it was asked to.
    """
    if (run is not None) + (speed is not None) + keyboard + gamepad != 1:
        raise UsageError("say how the room is driven", expected="one of --speed M/S, --keyboard, "
                         "--gamepad, --run FILE", remedy=f"dart-hal map {out} --speed 0.8")
    ended, good = "", True
    if run is None:
        run = record or out.with_suffix(".mcap")
        manual = Keyboard() if keyboard else Gamepad() if gamepad else None
        try:
            with opened(url, car_name, cars, run, lidar=lidar) as car:
                check_drives_by_lidar(car, "room")
                if manual is not None:
                    with closing(manual):
                        car.arm(waive=waive)
                        run_manual(car, manual, max_throttle, duration or inf)
                else:
                    follower = along_walls(car, speed or 0.0,
                                           Wall(1 if side == "left" else -1, gap),
                                           distance or inf, duration or inf, waive)
                    ended, good = follower.why, follower.good
                car.stop()
        except KeyboardInterrupt:
            ended = "stopped by Ctrl-C"
            console.print(f"{ended}: what was driven is mapped")
        except (Disarmed, LinkLost) as why:
            ended, good = why.what, False
            console.print(str(why), style="red", markup=False, highlight=False)
    survey, said = survey_of(run, car_name, cars)
    notices(said)
    grid = grid_of(survey, cell)
    image = write_grid(grid, out)
    found = figures(survey, grid) | {"ended": ended, "as_asked": good, "files": {
        "map": str(out), "image": str(image), "recording": str(run)}}
    if plot:
        found["files"]["plot"] = str(draw(survey, grid, plot))
    if as_json:
        print_json(found)
    else:
        results.print(sentence(found), markup=False, highlight=False)
    return 0 if good and found["explained"] > AGREED else 1


def along_walls(car: Car, speed: float, wall: Wall, distance: float, duration: float,
                waive: tuple[str, ...]) -> WallFollower:
    """Drive along the walls until that has ended."""
    most = car.files.config.limits.max_speed
    follower = WallFollower(plant_of(car.files), min(speed, most), distance, duration, wall)
    drive_along(car, follower, waive, "along the walls")
    return follower


def survey_of(run: Path, car_name: str, cars: Path | None) -> tuple[Survey, tuple[str, ...]]:
    """What a recording shows, and what is to be said of it. Raises UsageError, RecordingError."""
    mapper, checks, way = Mapper(), Checks(), 0.0
    with Car.open(f"replay://{run}", car=car_name, cars=cars) as car, progress_bar() as bar:
        task, before = bar.add_task("mapping", total=None), None
        for n, state in enumerate(car.states()):
            at = state.pose
            way += 0.0 if before is None else float(np.hypot(at.x - before.x, at.y - before.y))
            before = at
            mapper.moved(state.t, at.x, at.y, at.yaw)
            for scan in car.lidar.scans():
                checks.add(scan, at.yaw)
                mapper.add(scan)
            if n % 20 == 0:
                bar.update(task, completed=n)
    checks.judge(way)
    said = []
    if mapper.broken:
        said.append(f"the map ends where the lidar was silent: {mapper.broken}")
    if checks.unsure:
        said.append("the car turned too little to tell whether its scans turn the right way")
    return mapper.finish(), tuple(said)


def figures(survey: Survey, grid: Grid) -> dict[str, Any]:
    """What the map came to."""
    chart, every = map_of_grid(grid), max(len(survey.frames) // 50, 1)
    explained = [agreement(chart, np.append(pose, 0.0), frame.own.points, frame.own.rays,
                           frame.own.origin).share
                 for frame, pose in zip(survey.frames[::every], survey.poses[::every], strict=True)]
    path, (row, column) = survey.path(), np.nonzero(grid.occupied)
    told = sum(edge.closes for edge in survey.edges)
    return {
        "way_m": survey.frames[-1].way, "duration_s": float(path[-1, 0] - path[0, 0]),
        "keyframes": len(survey.frames), "closures": len(survey.closures),
        "closures_refused": told - len(survey.closures), "explained": float(np.mean(explained)),
        "cell_m": grid.cell, "walls_cells": len(row),
        "size_m": [float(np.ptp(v) + 1) * grid.cell for v in (column, row)]}


def sentence(found: dict[str, Any]) -> str:
    """The same to be read."""
    x, y = found["size_m"]
    ended = f"ended: {found['ended']}; " if found["ended"] else ""
    return (f"{ended}{found['files']['map']}: {x:.1f} x {y:.1f} m in cells of "
            f"{100.0 * found['cell_m']:g} cm, of {found['way_m']:.1f} m driven in "
            f"{found['duration_s']:.0f} s; {found['keyframes']} keyframes, {found['closures']} "
            f"loop closures ({found['closures_refused']} not believed); the map explains "
            f"{100.0 * found['explained']:.0f} % of the scans")
