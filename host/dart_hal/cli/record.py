"""``dart-hal record``: record a run to an MCAP file, with the raw bytes."""

from __future__ import annotations

from pathlib import Path

import click

from dart_hal.cli.common.options import (
    FiniteNumber,
    camera_option,
    car_options,
    foxglove_options,
    json_option,
    lidar_option,
    out_option,
    poses_option,
)
from dart_hal.cli.common.output import print_json, results
from dart_hal.cli.common.session import limit_to_real_time, open_car, serve_foxglove, with_progress
from dart_hal.cli.common.summary import RunSummary


@click.command("record")
@car_options
@click.option("--duration", type=FiniteNumber(min=0.1), default=60.0, show_default=True,
              help="seconds of car time")
@out_option(content="the recording", default=Path("runs/run.mcap"))
@poses_option
@lidar_option
@camera_option
@foxglove_options
@json_option
def command(url: str | None, car_name: str, cars: Path | None, duration: float, out: Path,
            poses: str | None, lidar: str | None, camera: str | None, foxglove: bool,
            port: int, as_json: bool) -> None:
    """Record the car's sensors without driving it (to drive: `dart-hal drive --record`)."""
    with (open_car(url, car_name, cars, record=out, poses=poses, lidar=lidar,
                   camera=camera) as car,
          serve_foxglove(car, foxglove, port)):
        summary = RunSummary(car)
        states = car.states(duration=duration)
        states = limit_to_real_time(states) if foxglove else states
        for _ in with_progress(states, duration, "recording"):
            pass
        result = summary.as_json({"recording": out})
    # A full disk ends the recording but not the drive: it is an error of this verb. The index is
    # written last, when the car is closed.
    if car.recorder.trouble is not None:
        raise car.recorder.trouble
    if as_json:
        print_json(result)
    else:
        results.print(f"{summary.frames} frames, {summary.lost} lost, in {out} "
                      f"(dart-hal replay {out})", markup=False)
