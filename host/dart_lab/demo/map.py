"""Chapter of the demo on the lidar: a car maps a track and follows the mapped line.

The track is between boards. The car localises itself by its lidar alone. Its Nano is the mock,
which is faster.
"""

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
from dart_hal.core.figures import BLUE, INK, LEGEND_ABOVE, ORANGE, finish, new_figure
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
MAX_SPEED = 1.2  # m/s
LAP_LENGTH = 22.9  # m of the track
LAP_OVERLAP = 1.5  # m that are driven twice, so that the loop closes
MAP_FILE = "track.yaml"
# m between the points of the line that is followed.
POINT_SPACING = 0.4
# m on both sides of the line within which it is smoothed, because the first lap oscillated.
SMOOTHING_WIDTH = 0.1
WAIVED_CHECKS = ("CALIBRATION_MISSING", "PWM_CLOCK_UNCALIBRATED")
Section = tuple[Html, dict[str, Any]]


@dataclass(frozen=True, slots=True)
class FollowedLap:
    """The lap that followed the mapped line.

    estimated, true (n, 3): x, y [m], yaw [rad] in the room at each pose of the lidar. grid:
    occupied cells (k, 2) [m] in the room. boards (m, 4) [m]: the true ones. size: size of the room
    over that of the map. ended: why the lap ended.
    """

    estimated: FloatArray
    true: FloatArray
    grid: FloatArray
    boards: FloatArray
    size: float
    ended: str
    closures: int


def section(number: int, out: Path) -> Section:
    """Text of the page and numbers of the JSON for the car of a seed."""
    try:
        found = drive_laps(number, out)
    except DartHalError as why:  # the car of this seed cannot: show the rest of the demo
        return el("p", f"Not shown: {why.what}.", class_="notice"), {"skipped": why.what}
    errors = np.hypot(*(found.estimated - found.true)[:, :2].T)
    rms = float(np.sqrt(np.mean(errors**2)))
    largest = float(errors.max())
    numbers = {"ended": found.ended, "closures": found.closures, "poses": len(errors),
               "map_size": 1.0 / found.size, "rms_m": rms, "max_m": largest}
    text = ("The car drove one lap between the boards by its lidar alone and made a map "
            f"({found.closures} loop closures). Then it followed the line of that lap, with poses "
            f"of its lidar in its own map. Errors of these poses: "
            f"{100 * rms:.1f} cm rms, {100 * largest:.1f} cm at most; "
            f"{found.ended}. Its map is {100 * abs(1.0 - 1.0 / found.size):.1f} % too "
            f"{'small' if found.size > 1.0 else 'large'}: its scale comes from an "
            "uncalibrated lidar.")
    figure = new_figure((7.0, 5.6))
    draw(figure.add_subplot(), found)
    return join([el("p", text), page.figure(TITLE, image(figure, TITLE))]), numbers


def summarise(numbers: dict[str, Any]) -> str:
    """Summarise the chapter in one line for the terminal."""
    if "skipped" in numbers:
        return f"a track by the lidar: skipped, {numbers['skipped']}"
    return (f"a track by the lidar: mapped, then followed in the own map; poses off by "
            f"{100 * numbers['rms_m']:.1f} cm rms; the map is "
            f"{numbers['map_size']:.3f} times as large")


def drive_laps(number: int, out: Path) -> FollowedLap:
    """Drive both laps of the car of a seed; out: folder of its files and of the map."""
    url = f"sim://?seed={number}&nano=mock&lidar=1&map=track"
    cars = out / "cars"
    survey, alignment, boards = map_track(url, cars)
    grid = grid_of(survey)
    write_grid(grid, out / MAP_FILE)
    line = make_closed_line(survey)
    estimated, true, ended = follow_line(url, cars, grid, line)
    # The map begins at the start pose; truth is in the frame of the room.
    estimated[:, :2] = alignment.transform(estimated[:, :2])
    row, column = np.nonzero(grid.occupied)
    cells = grid.origin + (np.column_stack((column, row)) + 0.5) * grid.cell
    return FollowedLap(estimated, true, alignment.transform(cells), boards, alignment.size,
                    ended, len(survey.closures))


def map_track(url: str, cars: Path) -> tuple[Survey, Alignment, FloatArray]:
    """Map one lap; return the survey, its alignment with the room, and the boards of the room."""
    backend = open_backend(url)
    mapper = Mapper()
    with Car.over(backend, cars=cars) as car:
        follower = LaneFollower(plant_of(car.files), MAX_SPEED, LAP_LENGTH + LAP_OVERLAP)

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
    """Drive until the follower has ended; arm the car when it stops waiting."""
    armed = False
    for state in car.states():
        steering, speed = answer(state)
        if follower.phase is Phase.ENDED:
            return
        if follower.phase is not Phase.WAITING and not armed:
            armed = True
            car.arm(waive=WAIVED_CHECKS)
        elif armed:
            car.drive_speed(steering=steering, speed=speed)


def make_closed_line(survey: Survey) -> Track:
    """Make a closed line of one lap of the survey."""
    distance = np.array([frame.travel for frame in survey.frames])
    # The lap ends where the car is closest to its start, after 70 % of the length.
    from_start = np.hypot(*(survey.poses[:, :2] - survey.poses[0, :2]).T)
    end = int(np.argmin(np.where(distance < 0.7 * LAP_LENGTH, np.inf, from_start)))
    kept = [0]
    # Keyframes may be close to each other where the car turned: keep points at a regular distance,
    # also from the closing point.
    for k in range(1, end):
        if (distance[k] - distance[kept[-1]] > POINT_SPACING
                and distance[end] - distance[k] > 0.5 * POINT_SPACING):
            kept.append(k)
    return Track.through(survey.poses[kept, :2], closed=True)


def follow_line(url: str, cars: Path, grid: Grid, line: Track
             ) -> tuple[FloatArray, FloatArray, str]:
    """Follow the line; return the poses by the lidar, the true poses, and why the lap ended."""
    backend = open_backend(url)
    source = LidarPoses(map_of_grid(grid), (0.0, 0.0, 0.0))
    poses: dict[float, tuple[float, float, float]] = {}
    with Car.over(backend, cars=cars, poses=source) as car:
        plant = plant_of(car.files)
        follower = Follower(raceline(line, SMOOTHING_WIDTH, plant, MAX_SPEED), plant, MAX_SPEED,
                            rules=Rules(laps=1))

        def answer(state: State) -> DriveCommand:
            if source.newest is not None and (at := source.newest.pose) is not None:
                poses[source.newest.t] = at.x, at.y, at.yaw
            return follower.answer(state.estimate.predict(car.now))

        drive(car, follower, answer)
        return np.array(list(poses.values())), true_path(backend,
                                                         np.array(list(poses))), follower.why


def draw(axes: Any, found: FollowedLap) -> None:
    """Draw the map on the true boards, and the paths of the second lap."""
    for k, (x1, y1, x2, y2) in enumerate(found.boards):
        axes.plot((x1, x2), (y1, y2), color=ORANGE, lw=0.8, label=None if k else "true boards")
    axes.plot(*found.grid.T, "s", color=INK, ms=0.8, label="its map")
    axes.plot(*found.true[:, :2].T, color=ORANGE, lw=3, alpha=0.5, label="truth")
    axes.plot(*found.estimated[:, :2].T, color=BLUE, lw=1, label="by the lidar in its own map")
    axes.set_aspect("equal")
    finish(axes, "x [m]", "y [m]", ncols=4, **LEGEND_ABOVE)
