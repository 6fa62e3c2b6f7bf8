"""Commands of ``dart-hal calibrate`` out of procedures: options, the run on a car, the output."""

from __future__ import annotations

import inspect
import shlex
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click
from rich.table import Table

from dart_hal.calibration.measured import write
from dart_hal.calibration.procedure import Option, Procedure
from dart_hal.calibration.result import Result
from dart_hal.car import Car
from dart_hal.car.car import DEFAULT_URL
from dart_hal.car.viewers import VIEWER_GROUP
from dart_hal.cli.common.bench import TerminalOperator, confirm
from dart_hal.cli.common.options import (
    CommandT,
    FiniteNumber,
    PathsOption,
    car_options,
    full_option,
    html_option,
    json_option,
    lidar_option,
    map_option,
    plot_option,
)
from dart_hal.cli.common.output import (
    console,
    count_notices,
    print_json,
    print_line,
    progress_bar,
    results,
    show_notices,
)
from dart_hal.cli.common.session import load_map
from dart_hal.core.config import CarFiles, check_writable
from dart_hal.core.plugins import load_plugin
from dart_hal.core.ports import Workshop
from dart_hal.devices.links.base import Backend, open_backend

# Viewer that writes the page of results; the laboratory offers it.
PAGE_VIEWER = "calibration"


def measuring(command: CommandT, confirm: bool = True) -> CommandT:
    """Add the options that all of these commands have; ``confirm``: before a result is written."""
    # What --yes agrees to: with ``confirm`` also that the result is written.
    text = ("the floor is free, and what comes out is to be written: do not ask" if confirm else
            "the floor is free: do not ask (for scripts)")
    command = click.option("--dry-run", is_flag=True,
                           help="measure and show, write nothing")(command)
    command = click.option("--yes", is_flag=True, help=text)(command)
    return car_options(html_option(full_option(json_option(command))))


def command_of(procedure: Procedure[Any]) -> click.Command:
    """Make the command ``dart-hal calibrate NAME`` of a procedure."""
    def calibrate(url: str | None, car_name: str, cars: Path | None, dry_run: bool, yes: bool,
                  html: Path | None, full: bool, as_json: bool,
                  recordings: tuple[Path, ...] = (), plot: Path | None = None,
                  chart: Path | None = None, lidar: str | None = None, **options: Any) -> None:
        procedure.check(**options)
        # The page needs the laboratory: its absence is reported before the car moves.
        write_page = load_page(html)
        found: Result
        files: CarFiles | None = None
        if recordings and procedure.fit is not None:
            # 1. The result: from recordings, or from a drive of this car.
            found = procedure.fit(recordings, car=car_name)
        else:
            backend = open_backend(url or DEFAULT_URL)
            room = load_map(backend, chart) if procedure.lidar else None
            measure = partial(procedure, source=backend.url.text, chart=room, **options)
            found, files = run(measure, backend, car_name, cars, yes, lidar, writes=not dry_run)
        if plot is not None and procedure.plot is not None:
            # 2. The picture shows the result also if it is not written.
            procedure.plot(found, files, plot)
            console.print(f"picture: {plot}")
        if not as_json:
            show(found, full)
        # 3. Written after the user has seen the table. Results of recordings have no car to write
        #    to.
        write_page([found], files)
        if files is not None and not dry_run and not found.unwritten and (
                not procedure.confirm or may_write(files, yes, backend.workshop is not None)):
            found = write(files, found)
        if as_json:
            print_json(found.to_json())
            return
        outcome = found.unwritten or "nothing written" + (": a dry run" if dry_run else "")
        console.print(f"written: {found.written}" if found.written else outcome, markup=False)

    # Options are decorators, and the one that is applied last is listed first in the help: hence
    # the reversed order.
    command: Callable[..., None] = calibrate
    if procedure.lidar:
        command = map_option(lidar_option(command))
    if procedure.plot is not None:
        command = plot_option(procedure.plot_help)(command)
    for option in reversed(procedure.options):
        command = _click_option(option)(command)
    if procedure.fit is not None:
        command = click.option("--from", "recordings", cls=PathsOption, metavar="FILES",
                               help=procedure.fit_help)(command)
    return click.command(procedure.name, help=inspect.cleandoc(procedure.help))(
        measuring(command, procedure.confirm))


def _click_option(option: Option) -> Callable[[CommandT], CommandT]:
    kind = (click.IntRange(int(option.low), int(option.high))
            if isinstance(option.default, int) else
            FiniteNumber(option.low, option.high, min_open=option.above_low))
    numbers = len(option.default) if isinstance(option.default, tuple) else 1
    return click.option(f"--{option.name.replace('_', '-')}", type=kind, default=option.default,
                        nargs=numbers, show_default=option.default is not None,
                        metavar=option.metavar, help=option.help)


def load_page(path: Path | None) -> Callable[[Sequence[Result], CarFiles | None], None]:
    """Return the function that writes the page of results; it does nothing for no path.

    Raises UsageError if no installed package can write the page.
    """
    if path is None:
        return lambda found, files: None
    writer = load_plugin(VIEWER_GROUP, PAGE_VIEWER)

    def write_page(found: Sequence[Result], files: CarFiles | None) -> None:
        before = None if files is None else files.calibration
        writer(found, path=path, files=files, previous=before,
               command=shlex.join(["dart-hal", *sys.argv[1:]]))
        console.print(f"report: {path}", markup=False, highlight=False)

    return write_page


def run(procedure: Callable[..., Result], backend: Backend, car_name: str, cars: Path | None,
        yes: bool, lidar: str | None = None, writes: bool = True) -> tuple[Result, CarFiles]:
    """Return the result of a procedure and the car's files; show its progress and questions.

    writes: the result will be written; a folder that cannot be is refused before the car moves.
    """
    simulated = backend.workshop is not None
    with Car.over(backend, car=car_name, cars=cars, lidar=lidar) as car:
        show_notices(car.notices)
        if writes:
            check_writable(car.files.folder)
        with progress_bar() as bar:
            task = bar.add_task("calibrating", total=1.0)
            # A simulated car answers for its operator; a real one has a person, whose questions
            # stop the progress bar.
            workshop: Workshop = backend.workshop or TerminalOperator(bar.stop, bar.start)

            def progress(fraction: float, text: str) -> None:
                bar.update(task, completed=fraction, description=text)

            def ask(question: str) -> bool:
                bar.stop()
                if not _confirm(question, yes, simulated, "start"):
                    return False
                bar.start()
                return True

            return procedure(car, workshop, progress=progress, ask=ask), car.files


def may_write(files: CarFiles, yes: bool, simulated: bool) -> bool:
    """Whether what was shown is to go to calibration.toml."""
    return _confirm(f"This would go to {files.folder / 'calibration.toml'}; the "
                   "file before is kept in history/.", yes, simulated, "write")


def _confirm(question: str, yes: bool, simulated: bool, prompt: str) -> bool:
    """Print a question; a real car waits for the answer, a simulated one does not."""
    if simulated:
        console.print(question, markup=False, highlight=False)
        return True
    return confirm(question, yes, prompt)


def show(result: Result, full: bool = False) -> None:
    """Print what was measured and how well it agrees, then the table, then the notes.

    Cautions are always printed, other notes are counted unless ``full``.
    """
    summary = result.summary()
    print_line(f"measured: {summary.title}", "bold")
    # Indented lines are notes; those that begin with "caution:" are warnings.
    notes = [line.strip() for line in summary.lines if line.startswith("  ")]
    cautions = [note for note in notes if note.startswith("caution:")]
    for line in summary.lines:
        if not line.startswith("  "):
            print_line(line)
    for caution in cautions:
        print_line(caution, "yellow")
    table = Table()
    for k, column in enumerate(summary.columns):
        table.add_column(column, justify="right" if k else "left")
    for row in summary.rows:
        table.add_row(*row)
    results.print(table)
    count_notices(tuple(note for note in notes if note not in cautions), full)
