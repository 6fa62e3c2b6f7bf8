"""The demo's chapter on the lidar: a car maps a track between boards, and follows the line that it
drove by what it sees. Its Nano is the mock, which is quicker."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.car import Car
from dart_hal.control.ending import Ending, Phase
from dart_hal.control.follow import DriveCommand, Follower, Rules
from dart_hal.control.lane_follow import LaneFollower
from dart_hal.control.paths import Path as Track
from dart_hal.control.plant import plant_of
from dart_hal.control.raceline import raceline
from dart_hal.core.errors import DartHalError
from dart_hal.core.figures import ABOVE, BLUE, INK, ORANGE, finish, new_figure
from dart_hal.core.types import FloatArray, State
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation.localisation.field import map_of_grid
from dart_hal.estimation.localisation.grid import Grid, write_grid
from dart_hal.estimation.localisation.source import LidarPoses
from dart_hal.estimation.mapping.align import Alignment, align_points
from dart_hal.estimation.mapping.keyframes import Survey
from dart_hal.estimation.mapping.mapper import Mapper
from dart_hal.estimation.mapping.occupancy import grid_of
from dart_lab.report import page
from dart_lab.report.html import Html, el, join
from dart_lab.report.page import image
from dart_lab.sim.room_truth import map_of_room, true_path

TITLE = "Map a track by the lidar, find the way in it, follow it"
SPEED, LAP, OVER = 1.2, 22.9, 1.5
"""m/s; m of the track, and that are driven a second time, so that the loop closes."""
MAP = "track.yaml"
POINTS = 0.4
"""m between the points of the line that is followed."""
SMOOTH = 0.1
"""m to either side of it in which the line is bent less: where the first lap swung."""
WAIVED = ("CALIBRATION_MISSING", "PWM_CLOCK_UNCALIBRATED")
Section = tuple[Html, dict[str, Any]]


@dataclass(frozen=True, slots=True)
class Followed:
    """estimated, true (n, 3): x, y [m], yaw [rad] at each pose of the lidar, in the room; grid:
    occupied cells (k, 2) [m] there; boards (m, 4) [m]: the true ones; size: of the room over that
    of the map; why it ended."""

    estimated: FloatArray
    true: FloatArray
    grid: FloatArray
    boards: FloatArray
    size: float
    ended: str
    closures: int


def section(number: int, out: Path) -> Section:
    """What the page and the JSON say of the car of a seed."""
    try:
        found = driven(number, out)
    except DartHalError as why:  # of a seed whose car cannot: the rest of the demo is worth it
        return el("p", f"Not shown: {why.what}.", class_="notice"), {"skipped": why.what}
    off = np.hypot(*(found.estimated - found.true)[:, :2].T)
    rms, most = float(np.sqrt(np.mean(off**2))), float(off.max())
    numbers = {"ended": found.ended, "closures": found.closures, "poses": len(off),
               "map_size": 1.0 / found.size, "rms_m": rms, "max_m": most}
    text = ("The car drove once around between the boards by its lidar alone, and what it saw "
            f"became a map ({found.closures} loop closures). Then it followed the line that it had "
            f"driven, with no other poses than those of its lidar in its own map: off by "
            f"{100 * rms:.1f} cm rms, {100 * most:.1f} cm at most; "
            f"{found.ended}. Its map is {100 * abs(1.0 - 1.0 / found.size):.1f} % too "
            f"{'small' if found.size > 1.0 else 'large'}: how long a metre is, it knows by a lidar "
            "that nobody has calibrated.")
    figure = new_figure((7.0, 5.6))
    draw(figure.add_subplot(), found)
    return join([el("p", text), page.figure(TITLE, image(figure, TITLE))]), numbers


def sentence(told: dict[str, Any]) -> str:
    """The same to be read in a terminal."""
    if "skipped" in told:
        return f"a track by the lidar: skipped, {told['skipped']}"
    return (f"a track by the lidar: mapped, then followed in the own map; poses off by "
            f"{100 * told['rms_m']:.1f} cm rms; the map is {told['map_size']:.3f} times as large")


def driven(number: int, out: Path) -> Followed:
    """Both laps of the car of a seed; out: the folder with its files, and for the map."""
    url, cars = f"sim://?seed={number}&nano=mock&lidar=1&map=track", out / "cars"
    survey, place, boards = mapped(url, cars)
    grid = grid_of(survey)
    write_grid(grid, out / MAP)
    line = closed(survey)
    estimated, true, ended = followed(url, cars, grid, line)
    estimated[:, :2] = place.transform(estimated[:, :2])
    row, column = np.nonzero(grid.occupied)
    cells = grid.origin + (np.column_stack((column, row)) + 0.5) * grid.cell
    return Followed(estimated, true, place.transform(cells), boards, place.size,
                    ended, len(survey.closures))


def mapped(url: str, cars: Path) -> tuple[Survey, Alignment, FloatArray]:
    """The survey of one lap, where it lies in the room, and the boards there."""
    backend, mapper = open_backend(url), Mapper()
    with Car.over(backend, cars=cars) as car:
        follower = LaneFollower(plant_of(car.files), SPEED, LAP + OVER)

        def answer(state: State) -> DriveCommand:
            scans = car.lidar.scans()
            mapper.update_odometry(state.t, state.pose.x, state.pose.y, state.pose.yaw)
            for scan in scans:
                mapper.add(scan)
            return follower.answer(car.now, state.speed, scans)

        drive(car, follower, answer)
        survey = mapper.finish()
        path = survey.path()
        return (survey, align_points(path[:, 1:3], true_path(backend, path[:, 0])[:, :2]),
                map_of_room(backend).lines)


def drive(car: Car, follower: Ending, answer: Callable[[State], DriveCommand]) -> None:
    """Until it has ended; the car is armed once it need not wait any more."""
    armed = False
    for state in car.states():
        steering, speed = answer(state)
        if follower.phase is Phase.ENDED:
            return
        if follower.phase is not Phase.WAITING and not armed:
            armed = True
            car.arm(waive=WAIVED)
        elif armed:
            car.drive_speed(steering=steering, speed=speed)


def closed(survey: Survey) -> Track:
    """The line that was driven, one lap of it."""
    way = np.array([frame.travel for frame in survey.frames])
    apart = np.hypot(*(survey.poses[:, :2] - survey.poses[0, :2]).T)
    end = int(np.argmin(np.where(way < 0.7 * LAP, np.inf, apart)))
    kept = [0]
    for k in range(1, end):
        if way[k] - way[kept[-1]] > POINTS and way[end] - way[k] > 0.5 * POINTS:
            kept.append(k)
    return Track.through(survey.poses[kept, :2], closed=True)


def followed(url: str, cars: Path, grid: Grid, line: Track
             ) -> tuple[FloatArray, FloatArray, str]:
    """Poses that the lidar told in the map, the true ones in the room, why it ended."""
    backend, source = open_backend(url), LidarPoses(map_of_grid(grid), (0.0, 0.0, 0.0))
    told: dict[float, tuple[float, float, float]] = {}
    with Car.over(backend, cars=cars, poses=source) as car:
        plant = plant_of(car.files)
        follower = Follower(raceline(line, SMOOTH, plant, SPEED), plant, SPEED, rules=Rules(laps=1))

        def answer(state: State) -> DriveCommand:
            if source.newest is not None and (at := source.newest.pose) is not None:
                told[source.newest.t] = at.x, at.y, at.yaw
            return follower.answer(state.estimate.at(car.now))

        drive(car, follower, answer)
        return np.array(list(told.values())), true_path(backend, np.array(list(told))), follower.why


def draw(axes: Any, found: Followed) -> None:
    """The map on the true boards, and the paths of the second lap."""
    for k, (x1, y1, x2, y2) in enumerate(found.boards):
        axes.plot((x1, x2), (y1, y2), color=ORANGE, lw=0.8, label=None if k else "true boards")
    axes.plot(*found.grid.T, "s", color=INK, ms=0.8, label="its map")
    axes.plot(*found.true[:, :2].T, color=ORANGE, lw=3, alpha=0.5, label="truth")
    axes.plot(*found.estimated[:, :2].T, color=BLUE, lw=1, label="by the lidar in its own map")
    axes.set_aspect("equal")
    finish(axes, "x [m]", "y [m]", ncols=4, **ABOVE)
