"""``dart-hal calibrate``: measure this car and write calibration.toml."""

from __future__ import annotations

from pathlib import Path

import click

from dart_hal.calibration.from_recordings import steering_from
from dart_hal.calibration.plot import plot_steering
from dart_hal.calibration.result import SteeringResult
from dart_hal.calibration.schedule import SPEEDS
from dart_hal.calibration.steering import calibrate_steering
from dart_hal.cli.common.bench import agreed
from dart_hal.cli.common.calibrate_all import everything
from dart_hal.cli.common.calibrate_measured import (
    clock,
    encoder,
    esc,
    imu,
    latency,
    lidar,
    mocap,
    throttle,
)
from dart_hal.cli.common.options import Number, PathsOption, car_options, json_option
from dart_hal.cli.common.output import print_json, progress_bar, results
from dart_hal.cli.common.outputs import PlotFile
from dart_hal.cli.common.session import opened
from dart_hal.cli.common.steering_table import show
from dart_hal.core.config import accept_board, check_writable
from dart_hal.core.errors import UsageError

LEAST_DIFFERENCE = 0.1
"""m/s; closer speeds do not show how the tyres slip."""


@click.group("calibrate")
def command() -> None:
    """Measure this car and write calibration.toml."""


for verb in (everything, clock, esc, throttle, encoder, imu, latency, mocap, lidar):
    command.add_command(verb)


@command.command("accept-board")
@car_options
@click.option("--yes", is_flag=True, help="do not ask (for scripts)")
@json_option
def accept(url: str | None, car_name: str, cars: Path | None, yes: bool, as_json: bool) -> None:
    """Use the car's calibration with the Nano that answers now, after that was exchanged.

    calibration.toml records with which Nano it was measured, and a car with another one does not
    arm. Accept it if servo, ESC and their board are still those that were measured.
    """
    with opened(url, car_name, cars) as car:
        files = car.files
    question = (f"Board {files.board} gets the calibration of {files.config.name}. Servo, ESC and "
                "PCA9685 must be those that were measured.")
    if not (car.url.startswith("sim:") or agreed(question, yes, "accept")):
        raise click.Abort
    before, written = accept_board(files)
    if as_json:
        print_json({"car": files.config.name, "board": files.board, "before": before,
                    "written": str(written)})
        return
    results.print(f"{written}: board {files.board} (was {before or 'not recorded'})", markup=False)


@command.command("steering")
@car_options
@click.option("--from", "recordings", cls=PathsOption, metavar="FILES",
              help="fit recordings (files or folders) instead of driving; to compare, and for the "
                   "paper's form: nothing is written to calibration.toml")
@click.option("--dry-run", is_flag=True, help="measure and show, write nothing")
@click.option("--plot", type=PlotFile(), default=None,
              help="picture of map, data and residuals")
@click.option("--yes", is_flag=True, help="the floor is free: do not ask (for scripts)")
@click.option("--speeds", nargs=2, type=Number(0.15, 0.8), default=SPEEDS,
              show_default=True, metavar="SLOW FAST",
              help="m/s there and back; slower needs less floor, and both must differ")
@json_option
def steering(url: str | None, car_name: str, cars: Path | None, recordings: tuple[Path, ...],
             dry_run: bool, plot: Path | None, yes: bool, speeds: tuple[float, float],
             as_json: bool) -> None:
    """The map from steering command to road-wheel angle, with its standard errors.

    On a car: slow circles over the whole range, from both sides, about one
    minute. With --from: recordings of a car, MCAP or the DART CSV files. They
    hold commands (-1..1), not pulses (our MCAP runs: both), and their map is
    never written.
    """
    if recordings:
        result = steering_from(recordings, car=car_name)
    else:
        result = _drive(url, car_name, cars, dry_run, yes, speeds)
    if plot is not None:
        plot_steering(result, plot)
    if as_json:
        print_json(result.to_json())
    else:
        show(result, plot)


def _drive(url: str | None, car_name: str, cars: Path | None, dry_run: bool, yes: bool,
           speeds: tuple[float, float]) -> SteeringResult:
    if abs(speeds[1] - speeds[0]) < LEAST_DIFFERENCE:
        raise UsageError("the two speeds must differ: they tell the slip of the tyres",
                         found="--speeds {} {}".format(*speeds),
                         expected=f"a difference of at least {LEAST_DIFFERENCE} m/s")
    with opened(url, car_name, cars) as car, progress_bar() as bar:
        if not dry_run:
            check_writable(car.files.folder)
        task = bar.add_task("calibrating", total=1.0)

        def progress(fraction: float, text: str) -> None:
            bar.update(task, completed=fraction, description=text)

        def ask(question: str) -> bool:
            if car.url.startswith("sim:"):
                return True
            bar.stop()
            if not agreed(question, yes):
                return False
            bar.start()
            return True

        result = calibrate_steering(car, progress=progress, ask=ask, dry_run=dry_run,
                                    source=car.url, speeds=speeds)
    return result
