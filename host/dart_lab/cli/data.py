"""``dart-hal data``: check recordings, repair one, or download the published ones."""

from __future__ import annotations

import shlex
import sys
from dataclasses import replace
from pathlib import Path

import click

from dart_hal.cli.common.options import (
    full_option,
    html_option,
    json_option,
    out_option,
    plots_options,
)
from dart_hal.cli.common.output import console, print_json, progress_bar
from dart_hal.cli.common.sizes import load_named_car, recorded_car_options
from dart_hal.core.errors import UsageError
from dart_hal.recording.check import RecordingCheck, check, folder_of, stem_of, summary
from dart_hal.recording.fetch import fetch, find
from dart_hal.recording.repair import repair
from dart_lab.pages.check_page import write_page
from dart_lab.pages.data_show import show_checks, show_fetch, show_repair


@click.group("data")
def command() -> None:
    """Recordings: what is in them and what is wrong with them; repair; the published set."""


@command.command("check")
@click.argument("files", nargs=-1, metavar="[FILES]...", type=click.Path(path_type=Path))
@plots_options("one recording, or several at a glance", "one of each recording")
@html_option
@full_option
@recorded_car_options
@json_option
def check_command(files: tuple[Path, ...], plot: Path | None, html: Path | None, full: bool,
                  car_name: str | None, cars: Path | None, as_json: bool) -> int:
    """List what is in recordings, what was dropped and why, and what each is good for.

    FILES are DART CSV files, runs (.mcap) or folders, also of the data folder ($DART_DATA, else
    ~/.local/share/dart-hal/recordings); default: all of it. Exit 0: a recording is good for a fit
    or an evaluation. Exit 1: all are readable, none is good for either. Exit 2: a named file, or a
    whole folder, cannot be read.
    """
    from dart_hal.car.runs import NamedCar, read_any

    car = load_named_car(car_name, cars)
    recordings, skipped = read_any(find(files),
                                   car=NamedCar(car_name, str(cars) if cars else None))
    if car is not None:
        # A recording without car.toml gets the named car.
        recordings = [r if r.car else replace(r, car=car.config) for r in recordings]
    with progress_bar() as bar:
        task = bar.add_task("checking", total=len(recordings))
        checks = []
        for recording in recordings:
            checks.append(check(recording))
            bar.advance(task)
    pictures = _plot(checks, plot) if plot is not None else []
    whole = summary(checks)
    answer = {"files": [c.to_json() for c in checks],
              "skipped": [{"path": p, "reason": why} for p, why in skipped],
              "summary": whole.to_json(), "plots": pictures}
    if html is not None:
        write_page(checks, skipped, whole, html, command=shlex.join(["dart-hal", *sys.argv[1:]]),
                   answer=answer)
    if as_json:
        print_json(answer)
    else:
        show_checks(checks, skipped, whole, full)
        if pictures:
            console.print(f"{len(pictures)} picture(s): {pictures[-1]}", markup=False)
        if html is not None:
            console.print(f"report: {html}", markup=False, highlight=False)
    return 0 if any(c.good_for for c in checks) else 1


def _plot(checks: list[RecordingCheck], target: Path) -> list[Path]:
    """Draw one picture into a file, or one of each recording and an overview into a folder."""
    from dart_lab.report.recordings import plot_check, plot_overview

    # A name with a suffix is one picture: of the recording, or of all at a glance.
    if target.suffix:
        return [plot_overview(checks, target) if len(checks) > 1
                else plot_check(checks[0], target)]
    pictures: list[Path] = []
    with progress_bar() as bar:
        task = bar.add_task("drawing", total=len(checks))
        for c in checks:
            name = f"{folder_of(c.recording.path)}_{stem_of(c.recording.path)}.png"
            pictures.append(plot_check(c, target / name))
            bar.advance(task)
    if len(checks) > 1:
        pictures.append(plot_overview(checks, target / "overview.png"))
    return pictures


@command.command("repair")
@click.argument("files", nargs=-1, required=True, metavar="FILES...",
                type=click.Path(path_type=Path))
@json_option
def repair_command(files: tuple[Path, ...], as_json: bool) -> int:
    """Write the missing index of runs (.mcap) that were not closed, so that every tool opens them.

    Damaged messages are removed. The old file is kept as NAME.old. dart-hal also reads a run
    without repair.
    """
    done = [repair(file) for file in files]
    if as_json:
        print_json({"files": [{"path": str(d.path), "repaired": d.old is not None,
                               "messages": d.messages, "left_out": d.left_out,
                               "old": d.old and str(d.old)} for d in done]})
    else:
        show_repair(done)
    return 0


@command.command("fetch")
@click.option("--from", "source", default=None, metavar="DIR|URL",
              help="a folder or an archive (.zip, .tar.gz) that has the files, in any layout; "
              "or an http(s) address (default: the repository at the listed commit)")
@click.option("--to", "folder", type=click.Path(path_type=Path, file_okay=False), default=None,
              help="folder to complete (default: $DART_DATA, else "
              "~/.local/share/dart-hal/recordings)")
@json_option
def fetch_command(source: str | None, folder: Path | None, as_json: bool) -> int:
    """Download the 83 published recordings (33 MB); each is checked by its SHA-256.

    Complete files are not downloaded again, so an interrupted download resumes. Exit 1: some
    files are still missing.
    """
    with progress_bar() as bar:
        task = bar.add_task("fetching", total=None)
        outcome = fetch(source, folder, progress=lambda done, total, name: bar.update(
            task, completed=done, total=total, description=name.rsplit("/", 1)[-1][:48]))
    if as_json:
        print_json(outcome.to_json())
    else:
        show_fetch(outcome)
    return 0 if outcome.complete else 1


@command.command("import")
@click.argument("files", nargs=-1, metavar="FILES...", type=click.Path(path_type=Path))
@click.option("--map", "map_name", default=None, metavar="MAP",
              help="a map (.toml), or the name of a shipped one: dart, dart-mocap, deep-dynamics, "
              "donkeycar, f1tenth, mocap, mushr")
@click.option("--guess", is_flag=True, help="propose a map with its evidence, and import nothing; "
              "with --out a file of it")
@click.option("--unchecked", is_flag=True,
              help="import although signs, units or axes contradict each other")
@out_option(".mcap", ".toml", content="the recording (.mcap), or with --guess the map (.toml)")
@recorded_car_options
@json_option
def import_command(files: tuple[Path, ...], map_name: str | None, guess: bool, unchecked: bool,
                   out: Path | None, car_name: str | None, cars: Path | None, as_json: bool) -> int:
    """Import recordings of any car: CSV, ROS bags, MCAP, LeRobot data sets.

    The map states quantity, unit and sign of each column or topic, and what a command is. The
    result is one file that identify, evaluate, diagnose and data check read.
    """
    from dart_lab.cli.importing import guess_import, run_import
    from dart_lab.importing.tables import read_tables

    if not files:
        raise UsageError("no file to import", found="no FILES",
                         expected="CSV files, ROS bags, MCAP files or folders of them",
                         remedy="dart-hal data import LOG.csv --guess")
    if guess:
        return guess_import(files, out, as_json)
    if map_name is None:
        read_tables(files)  # a missing file is stated before a missing map
        raise UsageError("no map", found=" ".join(map(str, files)), expected="--map MAP",
                         remedy=f"dart-hal data import {files[0]} --guess --out map.toml proposes "
                                "one")
    car = load_named_car(car_name, cars)
    return run_import(files, map_name, car, out, unchecked, as_json)
