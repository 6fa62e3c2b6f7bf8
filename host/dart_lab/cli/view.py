"""``dart-hal view``: a live page of a car, to watch and to drive it from a desk or a phone."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from math import inf
from pathlib import Path

import click

from dart_hal.car import Car
from dart_hal.car.member import join
from dart_hal.cli.common.options import (
    FiniteNumber,
    camera_option,
    car_options,
    json_option,
    lidar_option,
    map_option,
    poses_option,
    room_key_option,
    waive_option,
)
from dart_hal.cli.common.outputs import OutputFile
from dart_hal.cli.common.page_address import lan_option, print_page_address
from dart_hal.cli.common.session import open_car, real_time_url
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.grid import lines_of_grid, read_grid


@click.command("view")
@car_options
@click.argument("runs", metavar="[RUN] [RUN]", nargs=-1,
                type=click.Path(path_type=Path, dir_okay=False))
@lan_option
@click.option("--duration", type=FiniteNumber(min=0.1), default=None, help="s (default: until "
                                                                           "Ctrl-C)")
@click.option("--max-throttle", type=FiniteNumber(0.0, 1.0), default=0.35, show_default=True,
              help="of a stick that is pushed to its end")
@waive_option
@click.option("--record", type=OutputFile(replaces=False), default=None,
              help="write the run to this MCAP file")
@poses_option
@lidar_option
@camera_option
@map_option
@click.option("--room", default=None, metavar="URL",
              help="group of cars that share their poses: the others are drawn, too")
@room_key_option
@json_option
def command(url: str | None, car_name: str, cars: Path | None, runs: tuple[Path, ...],
            lan: bool, port: int, duration: float | None, max_throttle: float,
            waive: tuple[str, ...], record: Path | None, poses: str | None, lidar: str | None,
            camera: str | None, chart: Path | None, room: str | None, room_key: Path | None,
            as_json: bool) -> None:
    """Page in a browser: watch the car, drive it, stop it. RUN: a recording, or two to compare.

    Every visitor may stop the car. A visitor with the token may drive it, one at a time.
    """
    if runs:
        play(runs, port, lan, duration or inf, as_json)
        return
    with open_car(real_time_url(url), car_name, cars, record, poses, lidar, camera) as car, \
            ExitStack() as stack:
        car.raise_on_trip = False  # the page shows the cause of a trip
        others = None
        if room:
            others = stack.enter_context(join(car, room, room_key=room_key)).other_poses
        with car.view(port=port, lan=lan, drives=car.drives, lines=load_map_lines(car.url, chart),
                      others=others, waive=waive, max_throttle=max_throttle) as page:
            print_page_address(page.urls, lan, as_json)
            page.run(duration or inf)
        car.stop()


def load_map_lines(url: str, chart: Path | None) -> FloatArray | dict[str, FloatArray]:
    """Return the lines of a map file, or those of a simulated car's room, by frame."""
    if chart is not None:
        return lines_of_grid(read_grid(chart))
    from dart_lab.sim.room_truth import lines_by_frame

    return lines_by_frame(url)


def play(runs: Sequence[Path], port: int, lan: bool, duration: float, as_json: bool) -> None:
    """Serve one or two recordings until Ctrl-C, or for ``duration`` s."""
    import time

    from dart_lab.live.view.player import Player, run_of

    if len(runs) > 2:
        raise UsageError(f"{len(runs)} recordings", expected="one, or two on one time bar")
    read = []
    for run in runs:
        if not run.is_file():
            raise UsageError(f"there is no recording {run}",
                             expected="an MCAP file of this project",
                             remedy="dart-hal record --help")
        # Read the whole run first: the time bar jumps to any time of it.
        with Car.open(f"replay://{run}") as car:
            read.append(run_of(car))
    with Player(read[0], port, lan, *read[1:]) as player:
        print_page_address(player.urls, lan, as_json)
        until = time.monotonic() + duration
        while time.monotonic() < until:
            time.sleep(0.2)
