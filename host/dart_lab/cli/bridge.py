"""``dart-hal bridge``: DART's own topics in ROS, so that its controllers drive this car."""

from __future__ import annotations

from contextlib import closing
from math import inf
from pathlib import Path

import click

from dart_hal.cli.common.options import (
    car_options,
    drive_options,
    json_option,
    lidar_option,
    poses_option,
    waive_option,
)
from dart_hal.cli.common.output import console, print_json, results, show_notices
from dart_hal.cli.common.session import limit_to_real_time, open_car, real_time_url
from dart_hal.cli.common.summary import RunSummary
from dart_lab.live.ros.bridge import Bridge, Middleware


@click.command("bridge")
@click.argument("middleware", type=click.Choice(["ros1", "ros2"]))
@car_options
@click.option("--number", type=click.IntRange(0, 999), default=1, show_default=True,
              help="of the car, in the names of its topics")
@drive_options
@waive_option
@poses_option
@lidar_option
@json_option
def command(middleware: str, url: str | None, car_name: str, cars: Path | None, number: int,
            duration: float | None, record: Path | None, waive: tuple[str, ...],
            poses: str | None, lidar: str | None, as_json: bool) -> None:
    """Arm the car and let ROS drive it by DART's own topics, until Ctrl-C.

    The car drives while safety_value is 1. Missing or invalid messages mean neutral. A recording
    is published and not driven.
    """
    with (closing(_open_node(middleware, f"dart_hal_{number}")) as node,
          open_car(real_time_url(url), car_name, cars, record, poses, lidar) as car):
        summary = RunSummary(car)
        states = car.states(duration=duration or inf)
        console.print(f"car {number} on {middleware}: arming" if car.drives else
                      f"car {number} on {middleware}: a recording", markup=False, highlight=False)
        # A source that waits (a simulation, a recording) is slowed down to real time for ROS.
        Bridge(car, number, node, lambda text: show_notices((text,))).run(
            car.arming(waive=waive), limit_to_real_time(states) if car.waits else states)
        found = summary.as_json({"recording": record} if record else {})
    if as_json:
        print_json(found)
    else:
        results.print(f"{summary.distance:.2f} m in {summary.duration:.1f} s")


def _open_node(middleware: str, name: str) -> Middleware:
    """Open a node of that name; only the module of this middleware is imported."""
    if middleware == "ros1":
        from dart_lab.live.ros.ros1 import Ros1
        return Ros1(name)
    from dart_lab.live.ros.ros2 import Ros2
    return Ros2(name)
