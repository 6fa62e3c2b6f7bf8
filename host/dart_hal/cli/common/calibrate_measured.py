"""The verbs of ``dart-hal calibrate`` that measure quantities: all but steering."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import click
from rich.table import Table
from rich.text import Text

from dart_hal.calibration.asking import Ask, Progress
from dart_hal.calibration.clock import calibrate_clock, typed_clock
from dart_hal.calibration.encoder import DISTANCE, RUNS, calibrate_encoder
from dart_hal.calibration.esc import calibrate_esc
from dart_hal.calibration.imu import TURNS, calibrate_imu
from dart_hal.calibration.latency import calibrate_latency
from dart_hal.calibration.lidar import calibrate_lidar
from dart_hal.calibration.measured import UNITS, Measured, write
from dart_hal.calibration.mocap import calibrate_mocap
from dart_hal.calibration.plot_throttle import plot_throttle
from dart_hal.calibration.throttle import ROOM, calibrate_throttle
from dart_hal.car import Car
from dart_hal.car.car import DEFAULT_URL
from dart_hal.cli.common.bench import AskedWorkshop, agreed
from dart_hal.cli.common.options import (
    F,
    Number,
    car_options,
    json_option,
    lidar_option,
    map_option,
)
from dart_hal.cli.common.output import console, notices, print_json, progress_bar, results
from dart_hal.cli.common.outputs import PlotFile
from dart_hal.cli.common.session import map_of
from dart_hal.core.config import CarFiles, DriveTable, Quantity, check_writable
from dart_hal.core.errors import UsageError
from dart_hal.core.ports import Workshop
from dart_hal.core.types import NINETY
from dart_hal.devices.links.base import Backend, open_backend

T = TypeVar("T")
Procedure = Callable[[Car, Workshop, Progress, Ask], T]


def measuring(command: F) -> F:
    """The options that all of these verbs have."""
    command = click.option("--dry-run", is_flag=True,
                           help="measure and show, write nothing")(command)
    command = click.option("--yes", is_flag=True, help="the floor is free, and what comes out "
                           "is to be written: do not ask")(command)
    return car_options(json_option(command))


@click.command("encoder")
@measuring
@click.option("--distance", type=Number(1.0, 20.0), default=DISTANCE, show_default=True,
              help="m of each roll; twice as long is twice as exact")
@click.option("--runs", type=click.IntRange(1, 10), default=RUNS, show_default=True,
              help="rolls; with one alone a misread tape is not noticed")
def encoder(url: str | None, car_name: str, cars: Path | None, dry_run: bool, yes: bool,
            distance: float, runs: int, as_json: bool) -> None:
    """Travel per edge of the encoder, and how its ring is spaced.

    The car rolls straight; you chalk where it starts and type how far it came,
    by a tape. Missing and double marks of the ring are named. On sim:// the
    simulated world holds the tape.
    """
    def procedure(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Measured:
        return calibrate_encoder(car, workshop, progress=progress, ask=ask, source=car.url,
                                 distance=distance, runs=runs)

    measure(procedure, url, car_name, cars, dry_run, yes, as_json)


@click.command("clock")
@measuring
@click.option("--frequency", type=Number(20.0, 400.0), default=None, metavar="HZ",
              help="PWM frequency of any channel as an instrument shows it; nothing is measured")
@click.option("--std", type=Number(0.0, 10.0, min_open=True), default=None, metavar="HZ",
              help="its one sigma")
def clock(url: str | None, car_name: str, cars: Path | None, dry_run: bool, yes: bool,
          frequency: float | None, std: float | None, as_json: bool) -> None:
    """The oscillator of the PCA9685, by which every pulse is made.

    The Nano times the pulses of the spare channel, by a wire to its D8. Without
    the wire: --frequency and --std of a scope or a logic analyser.
    """
    if (frequency is None) != (std is None):
        raise UsageError("a measured frequency needs its standard error",
                         found="--frequency or --std alone", expected="both",
                         remedy="--frequency 50.21 --std 0.01")

    def procedure(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Measured:
        if frequency is not None and std is not None:
            return typed_clock(car.files, frequency, std, car.url)
        return calibrate_clock(car, progress=progress, ask=ask, source=car.url)

    measure(procedure, url, car_name, cars, dry_run, yes, as_json)


@click.command("imu")
@measuring
@click.option("--turns", type=click.IntRange(1, 10), default=TURNS, show_default=True,
              help="full turns each way; twice as many are twice as exact")
def imu(url: str | None, car_name: str, cars: Path | None, dry_run: bool, yes: bool,
        turns: int, as_json: bool) -> None:
    """Bias and scale of the gyro, and how the IMU sits in the car.

    The car stands, circles to the left and to the right, and pulls away
    straight; you chalk its heading and type by how many degrees it has turned.
    Measure the encoder first.
    """
    def procedure(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Measured:
        return calibrate_imu(car, workshop, progress=progress, ask=ask, source=car.url,
                             turns=turns)

    measure(procedure, url, car_name, cars, dry_run, yes, as_json)


@click.command("latency")
@measuring
def latency(url: str | None, car_name: str, cars: Path | None, dry_run: bool, yes: bool,
            as_json: bool) -> None:
    """How late the car answers: command to pulse, pulse to wheels, sensor to host.

    The car stands while the Nano times pulses (by the wire to its D8), then circles
    to the left with steps of the throttle, and of the steering. drive_speed is tuned by
    what comes out. Measure clock, encoder and steering first.
    """
    def procedure(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Measured:
        return calibrate_latency(car, workshop, progress=progress, ask=ask, source=car.url)

    measure(procedure, url, car_name, cars, dry_run, yes, as_json)


@click.command("mocap")
@measuring
def mocap(url: str | None, car_name: str, cars: Path | None, dry_run: bool, yes: bool,
          as_json: bool) -> None:
    """Where the marker sits on the car, and how late the poses from outside come.

    Slow and fast circles to both sides, about a minute. $DART_HAL_POSES names the source. Poses
    of another body, other units and frames that are left-handed or not z-up are named, with the
    option that mends them.
    """
    def procedure(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Measured:
        return calibrate_mocap(car, progress=progress, ask=ask, source=car.url)

    measure(procedure, url, car_name, cars, dry_run, yes, as_json)


@click.command("lidar")
@measuring
@map_option
@lidar_option
def lidar(url: str | None, car_name: str, cars: Path | None, chart: Path | None,
          lidar: str | None, dry_run: bool, yes: bool, as_json: bool) -> None:
    """How the lidar sits on the car, and how true its distances are.

    Slow and fast circles to both sides, about a minute, in a room of which there is a map. A lidar
    that is upside down or turns the other way than car.toml says, and a map of another room are
    named. Measure encoder and imu first.
    """
    backend = open_backend(url or DEFAULT_URL)
    room = map_of(backend, chart)

    def procedure(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Measured:
        return calibrate_lidar(car, room, progress=progress, ask=ask, source=car.url)

    measure(procedure, backend, car_name, cars, dry_run, yes, as_json, lidar)


@click.command("esc")
@measuring
def esc(url: str | None, car_name: str, cars: Path | None, dry_run: bool, yes: bool,
        as_json: bool) -> None:
    """Neutral, dead band, brake, reverse and end of the throttle; wheels lifted.

    The car stands on a stand and spins its wheels, up to full throttle; you turn
    a wheel by hand and say which way they turned. Measure the clock first.
    """
    def procedure(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Measured:
        return calibrate_esc(car, workshop, progress=progress, ask=ask, source=car.url)

    measure(procedure, url, car_name, cars, dry_run, yes, as_json)


@click.command("throttle")
@measuring
@click.option("--room", type=Number(0.0, 30.0), default=ROOM, show_default=True, metavar="METRES",
              help="straight floor; more of it reaches faster speeds, below 2.5 m the car circles "
                   "on 3.5 m x 3.5 m")
@click.option("--plot", type=PlotFile(), default=None,
              help="picture of the pulses beside the model's")
def throttle(url: str | None, car_name: str, cars: Path | None, dry_run: bool, yes: bool,
             room: float, plot: Path | None, as_json: bool) -> None:
    """Which pulse holds which speed, for drive_speed's feed-forward.

    The car drives from rest to rest at one speed after the other; you put it back
    to the start. Measure esc and encoder first.
    """
    def procedure(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Measured:
        found = calibrate_throttle(car, workshop, progress=progress, ask=ask, source=car.url,
                                   room=room)
        table = found.others["throttle.drive"]
        if plot is not None and isinstance(table, DriveTable):
            plot_throttle(table, car.files, plot)
            console.print(f"picture: {plot}")
        return found

    measure(procedure, url, car_name, cars, dry_run, yes, as_json)


def measure(procedure: Procedure[Measured], where: str | Backend | None, car_name: str,
            cars: Path | None, dry_run: bool, yes: bool, as_json: bool, lidar: str | None = None
            ) -> None:
    """Run a procedure on the car of a URL, or of an open backend, show what it found, ask, write.
    """
    backend = where if isinstance(where, Backend) else open_backend(where or DEFAULT_URL)
    simulated = backend.workshop is not None
    found, files = run(procedure, backend, car_name, cars, yes, lidar, writes=not dry_run)
    if not as_json:
        show(found)
    if not dry_run and may_write(files, yes, simulated):
        found = write(files, found)
    if as_json:
        print_json(found.to_json())
        return
    console.print(f"written: {found.written}" if found.written else "nothing written",
                  markup=False)


def run(procedure: Procedure[T], backend: Backend, car_name: str, cars: Path | None, yes: bool,
        lidar: str | None = None, writes: bool = True) -> tuple[T, CarFiles]:
    """(what a procedure found, the car's files) with a bar; the person beside the car is asked.

    writes: the result will be written; a folder that cannot be is refused before the car moves.
    """
    simulated = backend.workshop is not None
    with Car.over(backend, car=car_name, cars=cars, lidar=lidar) as car:
        notices(car.notices)
        if writes:
            check_writable(car.files.folder)
        with progress_bar() as bar:
            task = bar.add_task("calibrating", total=1.0)
            workshop: Workshop = backend.workshop or AskedWorkshop(bar.stop, bar.start)

            def progress(fraction: float, text: str) -> None:
                bar.update(task, completed=fraction, description=text)

            def ask(question: str) -> bool:
                bar.stop()
                if not _agreed(question, yes, simulated, "start"):
                    return False
                bar.start()
                return True

            return procedure(car, workshop, progress, ask), car.files


def may_write(files: CarFiles, yes: bool, simulated: bool) -> bool:
    """Whether what was shown is to go to calibration.toml."""
    return _agreed(f"This would go to {files.folder / 'calibration.toml'}; the "
                   "file before is kept in history/.", yes, simulated, "write")


def _agreed(question: str, yes: bool, simulated: bool, prompt: str) -> bool:
    """Nobody can be hurt by a simulated car: it says what is coming and goes on."""
    if simulated:
        console.print(question, markup=False, highlight=False)
        return True
    return agreed(question, yes, prompt)


def show(found: Measured) -> None:
    """Each quantity with its standard error and 90 % interval, how well they agree, the notes."""
    table = Table(title=Text(f"{found.verb} of {found.car}"))
    table.add_column("quantity", no_wrap=True)
    for column in ("value", "one sigma", "90 % interval"):
        table.add_column(column, justify="right")
    for name, quantity in found.quantities.items():
        if isinstance(quantity, Quantity):
            unit = "" if UNITS[name] == "-" else f" {UNITS[name]}"
            half = NINETY * quantity.std
            table.add_row(name, f"{quantity.value:.6g}{unit}", f"{quantity.std:.2g}{unit}",
                          f"{quantity.value - half:.6g} to {quantity.value + half:.6g}")
        else:
            low, high = min(quantity.value), max(quantity.value)
            table.add_row(name, f"{len(quantity.value)} from {low:.3f} to {high:.3f}",
                          "per value (--json)", "")
    for name, other in found.others.items():
        if isinstance(other, DriveTable):
            rows = zip(other.speed, other.pulse_us, other.std_us, strict=True)
            for speed, pulse, std in rows:
                table.add_row(f"{name} at {speed:.2f} m/s", f"{pulse:.2f} us", f"{std:.2g} us",
                              f"{pulse - NINETY * std:.2f} to {pulse + NINETY * std:.2f}")
        else:
            table.add_row(name, other.replace("_", " "), "", "")
    results.print(table)
    results.print(f"{found.residual}, {found.duration:.0f} s of the car's time", markup=False)
    for note in found.notes:
        style = "yellow" if note.startswith("caution:") else "dim"
        results.print(f"  {note}", style=style, markup=False, highlight=False)
