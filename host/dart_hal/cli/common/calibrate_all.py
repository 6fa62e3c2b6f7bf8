"""``dart-hal calibrate all``: every procedure that is due, in order, each written as it ends."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import click

from dart_hal.calibration import order
from dart_hal.calibration.measured import write
from dart_hal.calibration.result import Result
from dart_hal.car import Car
from dart_hal.car.car import DEFAULT_URL
from dart_hal.cli.common.options import FiniteNumber, lidar_option, map_option
from dart_hal.cli.common.output import console, print_json, results, show_notices
from dart_hal.cli.common.procedures import load_page, may_write, measuring, run, show
from dart_hal.cli.common.session import load_map
from dart_hal.core.config import CarFiles
from dart_hal.core.config.folders import calibration_in
from dart_hal.core.errors import CalibrationFailed
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation.localisation.field import Map


@click.command("all")
@measuring
@click.option("--floor", nargs=2, type=FiniteNumber(1.0, 100.0), default=None,
              metavar="LENGTH WIDTH",
              help="m of free floor; what has no room in it is named before anything moves")
@click.option("--skip", multiple=True, type=click.Choice(order.list_names()),
              help="leave this one out")
@map_option
@lidar_option
@click.option("--again", is_flag=True, help="measure also what was measured in the last 12 hours")
def everything(url: str | None, car_name: str, cars: Path | None, dry_run: bool, yes: bool,
               html: Path | None, full: bool, floor: tuple[float, float] | None,
               skip: tuple[str, ...], chart: Path | None, lidar: str | None, again: bool,
               as_json: bool) -> None:
    """Every procedure, in the order in which each needs the others.

    Each result is saved before the next procedure starts. If interrupted, run the command again: it
    resumes. The lidar, if there is one, is measured in --map.
    """
    url = url or DEFAULT_URL
    # The page needs the laboratory: its absence is reported before the car moves.
    write_page = load_page(html)
    found: dict[str, Result] = {}
    with _home(url, car_name, cars, dry_run, chart, lidar) as (files, home, poses, room):
        # 1. What this car can measure, and what of it is due. Steps that the floor is too small for
        #    raise here, before anything moves.
        steps = order.make_steps(files, floor, skip, poses, room)
        measured = calibration_in(files.folder, files.config.name, files.config)
        left = steps if again else order.due(steps, measured)
        announce(steps, left)
        for step in left:
            # 2. One step after the other, each with a new connection to the car: it then reads the
            #    calibration that the step before has written.
            result = _measure_step(step, url, car_name, home, yes, dry_run, as_json, lidar, full)
            if result is not None:
                found[step.verb] = result
    write_page(tuple(found.values()), files)
    if as_json:
        print_json({"car": files.config.name, "steps": order.to_json(steps, left),
                    "found": {verb: result.to_json() for verb, result in found.items()},
                    "duration_s": sum(result.duration for result in found.values())})
        return
    _conclude(files, left, found)


@contextmanager
def _home(url: str, car_name: str, cars: Path | None, dry_run: bool, chart: Path | None,
          lidar: str | None) -> Iterator[tuple[CarFiles, Path, bool, Map | None]]:
    """(files of the car, folder of cars in which each step finds what the one before wrote,
    whether it has poses from outside, the map of its room if it has a lidar)."""
    backend = open_backend(url)
    with Car.over(backend, car=car_name, cars=cars, lidar=lidar) as car:
        files = car.files
        poses = backend.poses is not None
        mapped = chart is not None or backend.url.scheme == "sim"
        room = load_map(backend, chart) if car.has_lidar and mapped else None
    if not dry_run:
        yield files, files.folder.parent, poses, room
        return
    with tempfile.TemporaryDirectory() as folder:
        # A dry run writes, too, but into a copy of the files: each step needs the results of those
        # before it.
        mine = Path(folder) / files.config.name
        mine.mkdir()
        for name in ("car.toml", "calibration.toml", "model.toml"):
            if (files.folder / name).is_file():
                shutil.copy(files.folder / name, mine)
        if Path(files.origin).is_file():  # the example's car.toml lies in the package
            shutil.copy(files.origin, mine / "car.toml")
        yield files, Path(folder), poses, room


def announce(steps: Sequence[order.ProcedureStep], left: Sequence[order.ProcedureStep]) -> None:
    """What each step does and needs, and which are done already; nothing has moved yet."""
    for step in steps:
        kept = "" if step in left else " [measured already; --again repeats it]"
        console.print(f"{step.verb}{kept}: {step.plan}", markup=False, highlight=False)


def _measure_step(step: order.ProcedureStep, url: str, car_name: str, home: Path, yes: bool,
                  dry_run: bool, as_json: bool, lidar: str | None, full: bool
                  ) -> Result | None:
    """What one step found, written into ``home`` if that is agreed to; None: it can be missed."""
    backend = open_backend(url)
    simulated = backend.workshop is not None
    console.print(f"\n{step.verb}", style="bold")
    try:
        found, files = run(step.run, backend, car_name, home, yes, lidar)
    except CalibrationFailed as error:
        # Later steps use the result of this one, unless it is optional.
        if not step.optional:
            console.print("what was measured before this is written: once it is repaired, the same "
                          "command goes on here")
            raise
        show_notices((f"{step.verb} not measured: {error.what}; {error.remedy}",))
        return None
    if not as_json:
        show(found, full)
    if not (dry_run or may_write(files, yes, simulated)):
        raise CalibrationFailed(f"{step.verb} is not to be written, and what follows needs it",
                                remedy=f"dart-hal calibrate all --skip {step.verb}")
    written = write(files, found)
    # The copy of a dry run is deleted: no path of it is reported.
    return replace(written, written=None) if dry_run else written


def _conclude(files: CarFiles, left: Sequence[order.ProcedureStep], found: Mapping[str, Result]
              ) -> None:
    """The last word: what was measured, how long the car drove, where it is written."""
    missed = [s.verb for s in left if s.verb not in found]
    seconds = sum(result.duration for result in found.values())
    results.print(f"{files.config.name}: {', '.join(found) or 'nothing'} measured in "
                  f"{seconds / 60.0:.1f} min of the car's time"
                  + (f"; not {', '.join(missed)}" if missed else ""), markup=False)
    written = next((r.written for r in found.values() if r.written), None)
    console.print(f"written: {written}" if written else "nothing written", markup=False)
    if written:
        console.print("next: drive and record, then dart-hal diagnose --model measured --train "
                      "RUN.mcap --out model.toml", markup=False)
