"""``dart-hal calibrate``: measure this car and write calibration.toml."""

from __future__ import annotations

from pathlib import Path

import click
from rich.table import Table

from dart_hal.calibration.from_recordings import steering_from
from dart_hal.calibration.plot import plot_steering
from dart_hal.calibration.result import SteeringResult
from dart_hal.calibration.schedule import SPEEDS
from dart_hal.calibration.steering import calibrate_steering
from dart_hal.cli.bench import agreed, say_where_used
from dart_hal.cli.calibrate_measured import clock, encoder, imu, latency
from dart_hal.cli.options import Number, PathsOption, car_options, json_option
from dart_hal.cli.output import console, print_json, progress_bar, results
from dart_hal.cli.session import opened
from dart_hal.errors import UsageError

MOST_ROWS = 13
"""Rows of the map on a terminal, so that the result does not scroll away."""
LEAST_DIFFERENCE = 0.1
"""m/s; closer speeds do not show how the tyres slip."""


@click.group("calibrate")
def command() -> None:
    """Measure this car and write calibration.toml."""


command.add_command(clock)
command.add_command(encoder)
command.add_command(imu)
command.add_command(latency)


@command.command("steering")
@car_options
@click.option("--from", "recordings", cls=PathsOption, metavar="FILES",
              help="fit recordings (files or folders) instead of driving; to compare, and for the "
                   "paper's form: nothing is written to calibration.toml")
@click.option("--dry-run", is_flag=True, help="measure and show, write nothing")
@click.option("--plot", type=click.Path(path_type=Path, dir_okay=False), default=None,
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
    say_where_used(car.url, result.written, cars)
    return result


def show(result: SteeringResult, plot: Path | None = None) -> None:
    """Some rows of the map, what there is to say about the data, and the result last."""
    results.print(_table(result))
    for note in result.brief or result.notes:
        style = "yellow" if note.startswith("caution:") else "dim"
        results.print(f"  {note}", style=style, markup=False, highlight=False)
    form = ", ".join(f"{name} {value:.4f}" for name, value in result.paper_form.items())
    results.print(f"five-parameter form: {form}")
    backlash = result.backlash
    results.print("backlash: not known from these data" if backlash is None else
                  f"backlash {backlash.value:.4f} +- {backlash.std:.4f} rad")
    results.print(f"residual {result.residual_rms:.5f} rad rms over {result.n} samples")
    if result.dropped:
        results.print(result.dropped)
    if plot is not None:
        console.print(f"picture: {plot}")
    why = result.unwritten or "nothing written: a dry run"
    console.print(f"written: {result.written}" if result.written else why, markup=False)


def _table(result: SteeringResult) -> Table:
    rows = rows_shown(len(result.command))
    some = "" if len(rows) == len(result.command) else (
        f", {len(rows)} of {len(result.command)} points (--json has all)")
    table = Table(title=f"steering map of {result.car}{some}")
    for column in ("command", "pulse", "angle", "one sigma"):
        table.add_column(column, justify="right")
    for i in rows:
        pulse = "-" if result.pulse_us is None else f"{result.pulse_us[i]:.1f} us"
        table.add_row(f"{result.command[i]:+.3f}", pulse, f"{result.angle[i]:+.4f} rad",
                      f"{result.angle_std[i]:.4f} rad")
    return table


def rows_shown(points: int) -> list[int]:
    """At most MOST_ROWS indices of 0..points-1, evenly where that works, both ends included."""
    last = points - 1
    least = max(1, -(-last // (MOST_ROWS - 1)))
    even = [step for step in range(least, 2 * least + 1) if last % step == 0]
    if even:
        return list(range(0, points, even[0]))
    return sorted({round(i * last / (MOST_ROWS - 1)) for i in range(MOST_ROWS)})
