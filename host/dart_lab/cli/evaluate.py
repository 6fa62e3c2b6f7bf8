"""``dart-hal evaluate``: how well a model predicts recordings, open loop."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import click

from dart_hal.car.runs import NamedCar, read_any
from dart_hal.cli.common.options import (
    REFERENCE,
    full_option,
    html_option,
    json_option,
    plots_options,
)
from dart_hal.cli.common.output import print_json, progress_bar, show_notices
from dart_hal.cli.common.sizes import apply_car_sizes, load_named_car, recorded_car_options
from dart_hal.core.config import ModelFile
from dart_hal.core.errors import UsageError
from dart_hal.core.figures import new_figure
from dart_hal.recording.dart import Recording, Reference
from dart_hal.recording.fetch import find
from dart_hal.vehicle.file import missing_parameters
from dart_hal.vehicle.load import find_model
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.cli.cluster_option import cluster_option, connect_cluster
from dart_lab.identification.evaluation import Evaluation, evaluate, kinematic
from dart_lab.identification.measured import MEASURED, default_model, named_model


@click.command("evaluate")
@click.argument("files", nargs=-1, type=click.Path(path_type=Path))
@click.option("--model", default=None, metavar="M",
              help="a model.toml, or paper, paper-printed, upstream-2024; measured: the paper's "
                   "with the calibrated values of the car of the runs (default: measured where "
                   "the runs have a calibration, else paper)")
@click.option("--kinematic", "as_kinematic", is_flag=True,
              help="the kinematic model with the same parameters: no tyre slip")
@click.option("--reference", type=REFERENCE, default=None, metavar="LX,THETA,LY",
              help="position and yaw of the mocap marker frame: m, rad, m "
                   "(default: fitted, but known for the published recordings)")
@plots_options("the errors", "the errors, and those of each recording")
@html_option
@full_option
@cluster_option
@recorded_car_options
@json_option
def command(files: tuple[Path, ...], model: str | None, as_kinematic: bool,
            reference: Reference | None,
            plot: Path | None, html: Path | None, full: bool, cluster: str | None,
            car_name: str | None, cars: Path | None, as_json: bool) -> None:
    """Predict 0.5, 1 and 2 s ahead from every quarter second, with the logged commands alone.

    FILES: recordings with motion capture, or folders, also of the data folder ($DART_DATA, see
    dart-hal data check --help). The reference is constant velocity and yaw rate (CTRV). The table
    also gives the range of validity of the kinematic model.
    """
    if not files:
        raise UsageError("no recording named", expected="FILES (recordings or folders of them)",
                         remedy="dart-hal evaluate --model paper FOLDER")
    # Errors of the arguments are raised here, before the recordings are read.
    _refuse_model_files(files)
    if html is not None:
        new_figure()  # raises at once if matplotlib is missing
    if plot is not None:
        _import_pictures().check_target(plot)
    if model is not None and model != MEASURED:
        find_model(model)  # raises for a wrong name before the search for files
    connect_cluster(cluster)
    # The default model depends on the recordings: those with a calibration give "measured".
    found = tuple(find(files))
    model = model or default_model(found)
    file, vehicle = named_model(model, found)
    assumed = missing_parameters(file, vehicle)
    if assumed:
        show_notices((f"{model} lacks {', '.join(assumed)}: the paper's values are used",))
    car = load_named_car(car_name, cars)
    recordings, skipped = _read_recordings(found, reference, car_name, cars)
    sizes = apply_car_sizes(model, file, car, recordings, fitting=False)
    sizes.show_cautions(as_json)
    vehicle = kinematic(sizes.vehicle) if as_kinematic else sizes.vehicle
    result = _evaluate(vehicle, recordings, skipped, found, reference, list_fitted_hashes(file))
    pictures = _import_pictures().draw(result, plot) if plot is not None else []
    answer = {**result.to_json(), "sizes": sizes.to_json(), "plots": pictures, "report": html}
    if html is not None:
        from dart_lab.pages.evaluate_page import write_page

        write_page(result, html, answer, sizes.lines)
    if as_json:
        print_json(answer)
    else:
        from dart_lab.pages.evaluate_table import show

        show(result, pictures, sizes.first_line, full)


def _refuse_model_files(files: tuple[Path, ...]) -> None:
    """Raise UsageError for a model among the recordings: --model was forgotten."""
    # A model in the place of a recording is the usual slip on this command line.
    models = [f for f in files if f.suffix == ".toml"]
    if models:
        others = " ".join(str(f) for f in files if f not in models) or "FOLDER"
        raise UsageError(f"{models[0]} is a model, no recording", found=str(models[0]),
                         expected="FILES (recordings or folders of them)",
                         remedy=f"dart-hal evaluate --model {models[0]} {others}")


def list_fitted_hashes(model: ModelFile) -> frozenset[str]:
    """Return the SHA-256 of the files in the provenance of a model: it was fitted to them."""
    # Recordings that the model was fitted to are marked: their errors are too small.
    files = model.provenance.get("files", {})
    return frozenset(map(str, files.values())) if isinstance(files, dict) else frozenset()


def _read_recordings(files: tuple[Path, ...], reference: Reference | None, car_name: str | None,
          cars: Path | None) -> tuple[list[Recording], list[tuple[str, str]]]:
    with progress_bar() as bar:
        bar.add_task("reading", total=None)
        return read_any(files, reference=reference,
                        car=NamedCar(car_name, str(cars) if cars else None))


def _evaluate(vehicle: Vehicle, recordings: list[Recording], skipped: list[tuple[str, str]],
              files: tuple[Path, ...], reference: Reference | None, fitted_to: frozenset[str]
              ) -> Evaluation:
    with progress_bar() as bar:
        task = bar.add_task("predicting", total=1.0)
        return evaluate(vehicle, recordings, reference=reference, skipped=skipped,
                        fitted_to=fitted_to,
                        named=[f for f in files if not f.is_dir()],
                        progress=lambda share: bar.update(task, completed=share))


def _import_pictures() -> ModuleType:
    """Import the drawing module, which most evaluations do not need."""
    from dart_lab.identification.evaluation import pictures

    return pictures
