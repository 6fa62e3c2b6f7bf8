"""``dart-hal calibrate``: measure this car and write calibration.toml."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from dart_hal.calibration.from_recordings import steering_from
from dart_hal.calibration.plot import plot_steering
from dart_hal.calibration.result import SteeringResult
from dart_hal.calibration.schedule import SPEEDS
from dart_hal.calibration.steering import calibrate_steering
from dart_hal.cli.options import PathsOption, car_options, json_option
from dart_hal.cli.output import console, print_json, progress_bar
from dart_hal.cli.session import opened
from dart_hal.errors import UsageError

LEAST_DIFFERENCE = 0.1
"""m/s; closer speeds do not show how the tyres slip."""


@click.group("calibrate")
def command() -> None:
    """Measure this car and write calibration.toml."""


@command.command("steering")
@car_options
@click.option("--from", "recordings", cls=PathsOption, metavar="FILES",
              help="fit recordings (files or folders) instead of driving")
@click.option("--dry-run", is_flag=True, help="measure and show, write nothing")
@click.option("--plot", type=click.Path(path_type=Path, dir_okay=False), default=None,
              help="picture of map, data and residuals")
@click.option("--yes", is_flag=True, help="the floor is free: do not ask")
@click.option("--speeds", nargs=2, type=click.FloatRange(0.15, 0.8), default=SPEEDS,
              show_default=True, metavar="SLOW FAST",
              help="m/s there and back; slower needs less floor, and both must differ")
@json_option
def steering(url: str | None, car_name: str, cars: Path | None, recordings: tuple[Path, ...],
             dry_run: bool, plot: Path | None, yes: bool, speeds: tuple[float, float],
             as_json: bool) -> None:
    """The map from steering command to road-wheel angle, with its standard errors.

    On a car: slow circles over the whole range, from both sides, about one
    minute. With --from: recordings of a car, MCAP or the DART CSV files.
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
        show(result)
        if plot is not None:
            console.print(f"picture: {plot}")


def _drive(url: str | None, car_name: str, cars: Path | None, dry_run: bool, yes: bool,
           speeds: tuple[float, float]) -> SteeringResult:
    if abs(speeds[1] - speeds[0]) < LEAST_DIFFERENCE:
        raise UsageError("the two speeds must differ: they tell the slip of the tyres",
                         found="--speeds {} {}".format(*speeds),
                         expected=f"a difference of at least {LEAST_DIFFERENCE} m/s")
    with opened(url, car_name, cars) as car, progress_bar() as bar:
        task = bar.add_task("calibrating", total=1.0)

        def progress(fraction: float, text: str) -> None:
            bar.update(task, completed=fraction, description=text)

        def ask(question: str) -> bool:
            if yes or car.url.startswith("sim:"):
                return True
            bar.stop()
            if not sys.stdin.isatty():
                console.print(f"{question}  (answer with --yes)")
                return False
            agreed = click.confirm(question, err=True)
            bar.start()
            return agreed

        return calibrate_steering(car, progress=progress, ask=ask, dry_run=dry_run,
                                  source=car.url, speeds=speeds)


def show(result: SteeringResult) -> None:
    """Table of the map and the sentences that belong to it."""
    from rich.table import Table

    table = Table(title=f"steering map of {result.car}")
    for column in ("command", "pulse", "angle", "one sigma"):
        table.add_column(column, justify="right")
    pulses = result.pulse_us if result.pulse_us is not None else [None] * len(result.command)
    for command_, pulse, angle, std in zip(result.command, pulses, result.angle,
                                           result.angle_std, strict=True):
        table.add_row(f"{command_:+.3f}", "-" if pulse is None else f"{pulse:.1f} us",
                      f"{angle:+.4f} rad", f"{std:.4f} rad")
    console.print(table)
    form = ", ".join(f"{name} {value:.4f}" for name, value in result.paper_form.items())
    console.print(f"five-parameter form: {form}")
    backlash = result.backlash
    console.print("backlash: not known from these data" if backlash is None else
                  f"backlash {backlash.value:.4f} +- {backlash.std:.4f} rad")
    console.print(f"residual {result.residual_rms:.5f} rad rms over {result.n} samples")
    for note in result.notes:
        console.print(f"  {note}", style="dim", markup=False, highlight=False)
    if result.written:
        console.print(f"written: {result.written}")
