"""``dart-hal report``: one page for a car: its calibrations, its last runs, what changed."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

import click

from dart_hal.car.digest import Digest, digest
from dart_hal.car.files import DEFAULT_CAR
from dart_hal.cli.common.options import (
    cars_option,
    full_option,
    html_option_with_default,
    json_option,
    old_spelling,
)
from dart_hal.cli.common.output import (
    console,
    count_notices,
    print_json,
    print_verdict,
    progress_bar,
    show_notices,
)
from dart_hal.cli.common.outputs import OutputFile
from dart_hal.core.config import CarFiles, load_car, parse_car
from dart_hal.core.config.history import calibration_changes, model_changes
from dart_hal.core.errors import ConfigError, DartHalError
from dart_lab.pages.report_page import CarReport, write_page

# Folder that is read if no runs are named.
DEFAULT_RUNS = Path("runs")
# Runs on the page, the newest.
MAX_RUNS = 10


@click.command("report")
@click.option("--car", "car_name", default=DEFAULT_CAR, envvar="DART_HAL_CAR", show_default=True,
              help="name of the car (also: $DART_HAL_CAR)")
@cars_option
@html_option_with_default(Path("report.html"))
@old_spelling("--out", "--html", OutputFile(".html"))
@click.argument("runs", nargs=-1, type=click.Path(path_type=Path, exists=True), metavar="[RUNS]..")
@full_option
@json_option
def command(car_name: str, cars: Path | None, html: Path, runs: tuple[Path, ...], full: bool,
            as_json: bool) -> None:
    """Write one page about a car: calibrations with intervals and age, last runs, what changed.

    RUNS are recordings (MCAP) or folders (default: ./runs); the ten newest are shown. Nothing is
    driven and no port is opened.
    """
    # The files of a simulated car may exist only inside its runs: read the runs first.
    found, skipped = _read_digests(runs or ((DEFAULT_RUNS,) if DEFAULT_RUNS.is_dir() else ()))
    files = _load_files(car_name, [cars] if cars else None, found)
    calibration = files.calibration
    model = files.model
    car_report = CarReport(
        files, found,
        tuple(calibration_changes(calibration, files.folder)) if calibration else (),
        tuple(model_changes(model, files.folder / "model.toml")) if model else (),
        datetime.now(timezone.utc))
    answer = car_report.to_json(html)
    write_page(car_report, html, answer)
    show_notices(skipped)
    if as_json:
        print_json(answer)
        return
    verdict, driven = car_report.describe()
    to_do = car_report.to_do()
    print_verdict(verdict, driven, to_do[0] if to_do else "")
    count_notices(tuple(to_do[1:]), full)
    console.print(f"report: {html}", markup=False, highlight=False)


def _load_files(name: str, folders: list[Path] | None, runs: tuple[Digest, ...]) -> CarFiles:
    """Load the files of a car. Raises ConfigError."""
    try:
        return load_car(name, folders)
    except ConfigError:
        # The car.toml of a simulated car is only in its runs.
        for run in runs:
            if run.car == name and "car.toml" in run.files:
                return parse_car(run.files["car.toml"], run.path, folders)
        raise


def _read_digests(given: tuple[Path, ...]) -> tuple[tuple[Digest, ...], tuple[str, ...]]:
    """Return the newest runs, newest first, and a message for each skipped one.

    A file that is named by itself is not skipped: its error is raised.
    """
    paths = {p for path in given for p in (path.rglob("*.mcap") if path.is_dir() else [path])}
    newest = sorted((p for p in paths if p.is_file()), key=lambda p: p.stat().st_mtime,
                    reverse=True)[:MAX_RUNS]
    digests = []
    skipped = []
    with progress_bar() as bar:
        task = bar.add_task("reading runs", total=len(newest) or 1)
        for path in newest:
            try:
                digests.append(digest(path))
            except DartHalError as error:
                if path in given:
                    raise
                skipped.append(f"{path} was skipped: {error.what}")
            bar.advance(task)
    return tuple(digests), tuple(skipped)
