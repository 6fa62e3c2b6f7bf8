"""``dart-hal experiment``: drive the test for a sub-model, record it, fit it; or a probe."""

from __future__ import annotations

import shlex
import sys
from datetime import datetime
from pathlib import Path
from typing import Any

import click
from rich import box
from rich.table import Table

from dart_hal.car import Car
from dart_hal.car.car import DEFAULT_URL
from dart_hal.car.files import load_files
from dart_hal.cli.common.options import (
    FiniteNumber,
    car_options,
    json_option,
    out_option,
    plot_option,
    poses_option,
    waive_option,
)
from dart_hal.cli.common.output import console, print_json, progress_bar, results, show_notices
from dart_hal.cli.common.outputs import OutputFile
from dart_hal.core.config import CarFiles
from dart_hal.core.errors import ExperimentFailed, UsageError
from dart_hal.devices.links.base import Backend, open_backend
from dart_lab.identification.experiment.floor import Floor
from dart_lab.identification.experiment.handover import (
    ExperimentOutcome,
    find_mass,
    fit_run,
    note_mass,
    write_model,
)
from dart_lab.identification.experiment.make import conduct, make_plan
from dart_lab.identification.experiment.plans import EXPERIMENTS, PROBES, ExperimentPlan
from dart_lab.identification.experiment.plot import plot_drive
from dart_lab.identification.experiment.runner import ExperimentDrive
from dart_lab.report.numbers import with_error

# Side of the floor of a simulated car [m] if --space is not given.
SIM_FLOOR = "10"


@click.command("experiment")
@click.argument("submodel", metavar="EXPERIMENT", type=click.Choice((*EXPERIMENTS, *PROBES)))
@car_options
@click.option("--space", "space", default=None, metavar="METRES",
              help="free floor: 8 (8 m x 8 m) or 12x3 (12 m along the car, 3 m across); needed on "
              f"a real car, {SIM_FLOOR} on sim://")
@click.option("--speed", type=FiniteNumber(0.2, 6.0), default=None, metavar="MAX",
              help="top speed in m/s (default: what the test needs, or less on a short floor)")
@click.option("--mass", type=FiniteNumber(0.2, 20.0), default=None, metavar="KG",
              help="weight of the car, ready to drive (default: that of car.toml, +- 2 %)")
@out_option(content="the recording  [default: runs/EXPERIMENT-TIME.mcap]")
@click.option("--out-model", type=OutputFile(".toml", replaces=False), default=None,
              help="add the identified values to this model.toml")
@waive_option
@click.option("--no-fit", is_flag=True, help="drive and record only")
@plot_option("the path and the commands")
@poses_option
@click.option("--yes", is_flag=True, help="the floor is free: do not ask (for scripts)")
@json_option
def command(submodel: str, url: str | None, car_name: str, cars: Path | None, space: str | None,
            speed: float | None, mass: float | None, out: Path | None, out_model: Path | None,
            waive: tuple[str, ...], no_fit: bool, plot: Path | None, poses: str | None, yes: bool,
            as_json: bool) -> None:
    """Drive an EXPERIMENT on a free floor and record it.

    \b
    fitted to a sub-model afterwards:
      friction motor steering delay tyres
    for dart-hal diagnose, nothing is fitted:
      standstill crawl circles steps staircase weave rollouts launch laps

    Only the recording is written (and --out-model), for `dart-hal identify` and `dart-hal
    diagnose`.
    """
    if out_model is not None and submodel in PROBES:
        raise UsageError(f"{submodel} fits no sub-model", found="--out-model",
                         expected=f"it with one of {', '.join(EXPERIMENTS)}",
                         remedy=f"dart-hal experiment {submodel}, then dart-hal diagnose")
    if out_model is not None and no_fit:
        raise UsageError("--no-fit leaves nothing to write", found="--no-fit --out-model",
                         expected="one of them")
    no_fit = no_fit or submodel in PROBES
    out = out or Path("runs") / f"{submodel}-{datetime.now():%Y%m%d-%H%M%S}.mcap"
    backend = open_backend(url or DEFAULT_URL)
    try:  # raise every error of the request before the recording begins
        simulated = backend.url.scheme == "sim"
        files = load_files(backend, car_name, cars)
        plan = make_plan(submodel, files, _read_floor(backend, space, submodel), speed)
        weighed = find_mass(files, mass, backend.workshop)
    except BaseException:
        backend.close()
        raise
    # Drive and record; the fit starts after the car is closed, so that the file is complete.
    with Car.over(backend, car=car_name, cars=cars, record=out, poses=poses) as car:
        show_notices(car.notices)
        # The mass turns accelerations into forces: a weighed one belongs to the recording.
        if mass is not None or backend.workshop is not None:
            note_mass(car, weighed)
        _confirm(plan, simulated, yes)
        drive = _conduct(car, plan, waive, out)
        source = car.url
    if plot is not None and drive.frames:
        plot_drive(drive, plot)
        console.print(f"picture: {plot}", markup=False, highlight=False)
    outcome = None if no_fit else fit_run(out, submodel, files, weighed)
    model = (_write_model(outcome, files, out, out_model, submodel) if out_model and outcome
             else None)
    if as_json:
        print_json({**to_json(source, out, plan, drive, outcome), "model": model})
    else:
        print_results(out, drive, outcome, model)
    # Exit 1: the drive ended early, or the fit identified nothing.
    if drive.stopped or (outcome is not None and outcome.empty):
        sys.exit(1)


def _read_floor(backend: Backend, space: str | None, submodel: str) -> Floor:
    """Parse --space; sim:// has a default.

    Raises UsageError for a car that cannot be driven, or a real car without --space.
    """
    if backend.bus is None:
        raise UsageError(f"{backend.url.text} has nothing to drive",
                         expected="a car with its I2C bus",
                         remedy="dart-hal diagnose reads recordings" if submodel in PROBES
                         else f"dart-hal identify {submodel} FILES fits recordings")
    if space is None and backend.url.scheme != "sim":
        raise UsageError("the size of the free floor is missing", expected="--space 8 or 12x3",
                         remedy=f"dart-hal experiment {submodel} --space METRES")
    return Floor.parse(space or SIM_FLOOR)


def _confirm(plan: ExperimentPlan, simulated: bool, yes: bool) -> None:
    """Print the plan and ask before a real car moves. Raises ExperimentFailed."""
    console.print(f"This {plan}.{' yes (--yes)' if yes else ''}", markup=False, highlight=False)
    for note in plan.notes:
        console.print(f"  {note}", markup=False, highlight=False)
    if simulated or yes:
        return
    if not sys.stdin.isatty():
        raise ExperimentFailed("not started: not confirmed", found="no terminal to confirm at",
                               remedy="once the floor is free: the same command with --yes")
    if not click.confirm("Is the floor free? Start", err=True):
        raise ExperimentFailed("not started: not confirmed",
                               remedy="confirm once the floor is free; in a script: --yes")


def _conduct(car: Car, plan: ExperimentPlan, waive: tuple[str, ...], out: Path) -> ExperimentDrive:
    """Drive the plan with a progress bar; after Ctrl-C or a fault, print the recording's path."""
    try:
        with progress_bar() as bar:
            task = bar.add_task("arming", total=1.0)
            return conduct(car, plan, lambda share, text: bar.update(
                task, completed=share, description=text), waive=waive)
    except BaseException:
        # The part that was driven is complete in the file, and may be enough for a fit.
        console.print(f"recorded until then: {out}", markup=False, highlight=False)
        raise


def _write_model(outcome: ExperimentOutcome, files: CarFiles, run: Path, target: Path, submodel: str
                 ) -> Path | None:
    """Write the sound fits; return the file, or None and print the reasons if no fit is sound."""
    typed = f"dart-hal experiment {submodel} --out {run} --out-model {target}"
    written = write_model(outcome, files, run, target, typed)
    for section, why in written.left_out.items():
        console.print(f"not written: {section}: {why}", style="yellow", markup=False)
    return target if written.sections else None


def to_json(source: str, out: Path, plan: ExperimentPlan, drive: ExperimentDrive,
            outcome: ExperimentOutcome | None
            ) -> dict[str, Any]:
    """Return the object of ``--json``."""
    result: dict[str, Any] = {
        "experiment": plan.name, "url": source, "recording": out,
        "duration_s": drive.frames[-1].t if drive.frames else 0.0,
        "top_speed": max((f.speed for f in drive.frames), default=0.0),
        "stopped": drive.stopped or None, "notes": list(plan.notes)}
    if outcome is not None:
        result |= {"fits": {name: fit.to_json() for name, fit in outcome.fits.items()},
                   "base": {name: {p: outcome.value_before(name, p) for p in fit.parameters}
                            for name, fit in outcome.fits.items()},
                   "mass_kg": {"value": outcome.mass.value, "std": outcome.mass.std},
                   "files": {file: {"used": r.used, "dropped": r.dropped, "why": list(r.why)}
                             for file, r in outcome.files.items()}}
        if outcome.understeer is not None:
            result["understeer"] = outcome.understeer.to_json()
    return result


def print_results(out: Path, drive: ExperimentDrive, outcome: ExperimentOutcome | None, model: Path
                  | None) -> None:
    """Print the fits with the previous values and notes, the files and the next command."""
    if outcome is not None:
        for name, fit in outcome.fits.items():
            if fit.n:  # a fit without samples has only the previous values
                results.print(_make_table(name, outcome))
            for note in fit.notes:
                results.print(f"  {note}", style="dim", markup=False, highlight=False)
        if outcome.understeer is not None:
            results.print(str(outcome.understeer), markup=False, highlight=False)
    if drive.stopped:
        console.print(f"ended early: {drive.stopped}", style="yellow", markup=False)
    rest = f"model written: {model}" if model else "nothing else was written"
    console.print(f"recorded in {out}; {rest}", markup=False, highlight=False)
    if outcome is None or outcome.empty:
        return
    if any(e.identifiable for fit in outcome.fits.values() for e in fit.parameters.values()):
        typed = shlex.join(["dart-hal", "identify", *outcome.fits, str(out)])
        console.print(f"next: {typed} --out model.toml", markup=False, highlight=False)


def _make_table(name: str, outcome: ExperimentOutcome) -> Table:
    fit = outcome.fits[name]
    table = Table(title=f"{name}: {fit.n} samples, rmse {fit.rmse:.4g} {fit.unit}; +- one "
                  "standard error", box=box.SIMPLE_HEAD, pad_edge=False, title_justify="left")
    for column in ("", "value", "before", "identifiable"):
        table.add_column(column, justify="right" if column == "before" else "left")
    for key, e in fit.parameters.items():
        table.add_row(key, f"{with_error(e.value, e.std)} {e.unit.strip('-')}",
                      f"{outcome.value_before(name, key):.5g}", "yes" if e.identifiable else "no")
    return table
