"""``dart-hal top``: show a car live in the terminal."""

from __future__ import annotations

from pathlib import Path

import click
from rich.live import Live
from rich.table import Table
from rich.text import Text

from dart_hal.car import Car
from dart_hal.cli.common.options import FiniteNumber, car_options, json_option, poses_option
from dart_hal.cli.common.output import console, print_json
from dart_hal.cli.common.session import limit_to_real_time, open_car
from dart_hal.cli.common.summary import RunSummary
from dart_hal.core.types import External, State

# STATE frames come at 100 Hz: the table is drawn ten times a second.
FRAMES_PER_UPDATE = 10


@click.command("top")
@car_options
@click.option("--duration", type=FiniteNumber(min=0.1), default=None,
              help="seconds of car time (default: until Ctrl-C)")
@poses_option
@json_option
def command(url: str | None, car_name: str, cars: Path | None, duration: float | None,
            poses: str | None, as_json: bool) -> None:
    """Watch a car: speed, yaw rate, pose, pins, flags, losses. The car is not driven."""
    with open_car(url, car_name, cars, poses=poses) as car:
        summary = RunSummary(car)
        states = limit_to_real_time(car.states(duration=duration or float("inf")))
        if as_json:
            for _ in states:
                pass
            print_json(summary.as_json({}))
            return
        with Live(console=console, auto_refresh=False) as live:
            for n, state in enumerate(states):
                if n % FRAMES_PER_UPDATE == 0:
                    live.update(make_table(car, state), refresh=True)


def make_table(car: Car, state: State) -> Table:
    """Return the table of the car's state."""
    health = state.health
    timing = car.timing
    pose = state.pose
    table = Table(title=Text(f"{car.files.config.name} on {car.url}"), show_header=False, box=None)
    yaw_rate = "no IMU" if state.yaw_rate is None else f"{state.yaw_rate:+7.3f} rad/s"
    rows = {
        "time": f"{state.t:9.2f} s  +- {health.t_std * 1e3:.2f} ms",
        "speed": f"{state.speed:+7.3f} m/s  +- {state.speed_std:.3f}   {state.ticks} edges",
        "yaw rate": yaw_rate,
        "pose": f"x {pose.x:+7.2f} m  y {pose.y:+7.2f} m  yaw {pose.yaw:+6.2f} rad",
        "steering": f"{state.applied.steering:+6.3f} rad  {state.applied.steering_us:7.1f} us",
        "throttle": f"{state.applied.throttle:+6.3f}      {state.applied.throttle_us:7.1f} us",
        "limited": ", ".join(state.applied.limited) or "-",
        "flags": ", ".join(sorted(health.flags)) or "-",
        "link": f"{timing.lost} lost, {timing.damaged} damaged, age {timing.link_age * 1e3:.0f} ms",
        "mode": car.mode,
    }
    if state.external is not None:
        rows["external"] = describe_external_pose(state.external)
    for name, value in rows.items():
        table.add_row(name, Text(value))
    return table


def describe_external_pose(external: External) -> str:
    """Return the external pose, its tracking state and its age on one line."""
    if external.pose is None:
        return external.tracking.value
    pose = external.pose
    return (f"x {pose.x:+7.2f} m  y {pose.y:+7.2f} m  yaw {pose.yaw:+6.2f} rad  "
            f"{external.tracking.value}, "
            f"{external.age * 1e3:.0f} ms old")
