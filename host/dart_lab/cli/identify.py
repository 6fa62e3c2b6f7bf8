"""``dart-hal identify``: fit the sub-models of the car to recordings."""

from __future__ import annotations

import difflib
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from dart_hal.car.runs import NamedCar, read_any
from dart_hal.cli.common.options import (
    REFERENCE,
    format_reference_option,
    html_option,
    json_option,
    out_option,
    plots_options,
)
from dart_hal.cli.common.output import console, print_json, progress_bar, results
from dart_hal.cli.common.sizes import (
    SizedModel,
    apply_car_sizes,
    load_named_car,
    recorded_car_options,
)
from dart_hal.core.config import ModelFile
from dart_hal.core.errors import UsageError
from dart_hal.core.figures import FIGURE_FORMATS, new_figure, save_figure
from dart_hal.recording.dart import Recording, Reference
from dart_hal.recording.dart.one_car import caution_several_cars, refuse_several_cars
from dart_hal.recording.dart.steering_sign import refuse_reversed_steering
from dart_hal.recording.fetch import find
from dart_hal.vehicle.load import find_model, vehicle_of
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.cli.cluster_option import cluster_option, connect_cluster
from dart_lab.identification.measured import default_model, named_model
from dart_lab.identification.outcome import Identification, identify_jointly, identify_per_recording
from dart_lab.identification.write import SECTIONS, WrittenModel, build_model, write

DEFAULT_OUT = Path("model.toml")


class SubmodelName(click.Choice):  # type: ignore[type-arg]
    """A choice whose error suggests the closest name."""

    def convert(self, value: Any, param: click.Parameter | None,
                ctx: click.Context | None) -> str:
        """Return the name. Raises UsageError with the closest name, or ``all``."""
        if value in self.choices:
            return str(value)
        near = difflib.get_close_matches(str(value), self.choices, n=1)
        raise UsageError("no such sub-model", found=str(value), expected=", ".join(self.choices),
                         remedy=f"dart-hal identify {near[0] if near else 'all'} FILES")


@click.command("identify")
@click.argument("submodel", type=SubmodelName([*SECTIONS, "all"]))
@click.argument("files", nargs=-1, type=click.Path(path_type=Path))
@click.option("--as-paper", "root", type=click.Path(path_type=Path), default=None, metavar="ROOT",
              help="the paper's own preprocessing on its folders 19, 29, 30, 40 and 50 below ROOT, "
              "to compare with its published values; writes only with --out")
@click.option("--base", default=None, metavar="MODEL",
              help="source of all that is not identified: a model.toml or paper, paper-printed, "
              "upstream-2024; measured: the paper's with the calibrated values of the "
              "car of the runs (default: the file of --out if it exists, then measured where "
              "the runs have a calibration, then paper)")
@out_option(".toml", content="the model (default: model.toml; an older one goes to history/)")
@plots_options("data, fit and the paper's curve of one sub-model", "one of each sub-model")
@html_option
@click.option("--reference", type=REFERENCE, default=None, metavar="LX,THETA,LY",
              help="position and yaw of the mocap marker frame: m, rad, m (default: fitted, "
              "but known for the published recordings)")
@click.option("--joint", is_flag=True,
              help="fit all sub-models together on their prediction errors, from recordings with "
              "motion capture; starts at the base")
@click.option("--dry-run", is_flag=True, help="fit and show, write nothing")
@click.option("--full", is_flag=True, help="print every file and every note")
@cluster_option
@recorded_car_options
@json_option
def command(submodel: str, files: tuple[Path, ...], root: Path | None, base: str | None,
            out: Path | None, plot: Path | None, html: Path | None, reference: Reference | None,
            joint: bool, dry_run: bool, full: bool, cluster: str | None, car_name: str | None,
            cars: Path | None, as_json: bool) -> int:
    """Fit friction, motor, steering map, delays and tyres to recordings (files or folders).

    A fit that did not converge or stopped at a bound is reported, never written. Exit status 1:
    nothing could be identified.
    """
    _check_arguments(submodel, files, root, reference, joint)
    if cluster is not None and not joint:
        raise UsageError("a cluster computes the joint fit alone", found="no --joint",
                         expected="identify all --joint FILES, the fit that takes minutes",
                         remedy="add --joint, or leave --cluster out")
    connect_cluster(cluster)
    if plot is not None and plot.suffix in FIGURE_FORMATS and submodel == "all":
        raise UsageError("identify all has a picture of each sub-model", found=f"--plot {plot}",
                         expected="a folder", remedy=f"--plots {plot.with_suffix('')}")
    if plot is not None or html is not None:
        new_figure()  # raises before the fits if matplotlib is missing
    files = tuple(find(files)) if files else ()
    names = SECTIONS if submodel == "all" else (submodel,)
    target = out or (DEFAULT_OUT if root is None else None)
    car = load_named_car(car_name, cars, out)
    start, origin = _load_base(base, target, files)
    typed = _format_command(submodel, files, {"--as-paper": root, "--base": base, "--out": out,
                                              "--reference": reference, "--joint": joint or None,
                                              "--car": car_name})
    # One of three fits: as in the paper, all sub-models jointly, or each sub-model by itself.
    sizes: SizedModel | None = None
    outcome: Identification
    data: Any
    if root is not None:
        from dart_lab.identification.paper import as_paper

        outcome, data = as_paper(root, names, typed)
    else:
        data, skipped = _read_recordings(files, reference, car_name, cars)
        sizes = apply_car_sizes(origin, start, car, data, fitting=True)
        sizes.show_cautions(as_json)
        start = sizes.model
        with progress_bar() as bar:
            task = bar.add_task("joint fit" if joint else "fitting", total=1.0)

            def advance(share: float, text: str) -> None:
                bar.update(task, completed=share, description=text)

            outcome, data = (
                identify_jointly(data, skipped, names, start, typed, reference, advance) if joint
                else identify_per_recording(data, skipped, names, sizes.vehicle, typed, reference,
                                            advance))
    # The model: fitted values where the fit is sound, else those of the base model.
    written = build_model(outcome.fits, outcome.over(start), outcome.source,
                          joint=outcome.joint)
    path = None if dry_run or target is None else write(written, target)
    if not as_json:
        from dart_lab.pages.identify_table import show

        show(outcome, sizes.first_line if sizes else "", full)
        results.print(f"base: {origin}", markup=False, highlight=False)
    _report_written(written, path, target, dry_run)
    # Pictures come last: if drawing fails, the results are printed and the model is written.
    drawn, missing = (_draw_pictures(outcome, data, reference, vehicle_of(start)) if plot or html
                      else ({}, {}))
    pictures = _save_pictures(drawn, missing, plot) if plot else []
    answer = {**outcome.to_json(), "base": origin, "sizes": sizes and sizes.to_json(),
              "model": path, "plots": pictures,
              "report": html, "left_out": dict(written.left_out)}
    if html is not None:
        from dart_lab.pages.identify_page import write_page

        write_page(outcome, drawn, missing, html, command=typed, answer=answer,
                   cautions=sizes.lines if sizes else ())
        console.print(f"report: {html}", markup=False, highlight=False)
    if as_json:
        print_json(answer)
    elif path is not None:
        _print_next_steps(path, data, reference)
    # Exit 1: nothing was identified, or --out was requested and not written.
    out_not_written = out is not None and path is None and not dry_run
    return 1 if out_not_written or not outcome.sound else 0


def _read_recordings(files: Sequence[Path], reference: Reference | None, car_name: str | None,
                     cars: Path | None) -> tuple[list[Recording], list[tuple[str, str]]]:
    with progress_bar() as bar:
        bar.add_task("reading", total=None)
        recordings, skipped = read_any(files, reference=reference,
                                       car=NamedCar(car_name, str(cars) if cars else None))
    # A fit pools its recordings: those of two cars, or of steering with another sign, would give
    # the parameters of no car.
    refuse_several_cars(recordings)
    refuse_reversed_steering(recordings)
    for caution in caution_several_cars(recordings):
        console.print(f"caution: {caution}", style="yellow", markup=False, highlight=False)
    return recordings, skipped


def _check_arguments(submodel: str, files: Sequence[Path], root: Path | None,
                     reference: Reference | None, joint: bool) -> None:
    """Raise UsageError for options that exclude each other, or without recordings."""
    if joint and (submodel != "all" or root is not None):
        raise UsageError("--joint fits all sub-models together, by its own method",
                         found=f"identify {submodel}" + (" --as-paper" if root else ""),
                         expected="identify all --joint FILES",
                         remedy="dart-hal identify all --joint FILES")
    if root is not None and files:
        raise UsageError("--as-paper takes its own folders, no FILES",
                         found=", ".join(map(str, files)), expected="FILES or --as-paper ROOT",
                         remedy="dart-hal identify all --as-paper ROOT")
    if root is not None and reference is not None:
        raise UsageError("--as-paper takes the marker for the centre of mass, as the paper does",
                         found="--reference", remedy="leave --reference out")
    if root is None and not files:
        raise UsageError("no recording named", expected="FILES (recordings or folders of them)",
                         remedy="dart-hal identify all FOLDER")


def _format_command(submodel: str, files: Sequence[Path], options: dict[str, Any]) -> str:
    """Return the command line, for the provenance of the file."""
    words = ["dart-hal", "identify", submodel, *map(str, files)]
    for name, value in options.items():
        words += ([] if value is None else [name] if value is True
                  else [format_reference_option(value)] if isinstance(value, Reference)
                  else [name, str(value)])
    return shlex.join(words)


def _load_base(base: str | None, target: Path | None, files: Sequence[Path]
               ) -> tuple[ModelFile, str]:
    """Return the model with the values of what is not identified, and its name or file.

    In this order: --base, the file that will be replaced, the default for the recordings.
    """
    if base is not None:
        return named_model(base, files)[0], base
    # A fit of one sub-model into the file of another one keeps what was fitted before.
    if target is not None and target.exists():
        return find_model(target)[0], str(target)
    name = default_model(files)
    return named_model(name, files)[0], name


def _draw_pictures(outcome: Identification, data: Any, reference: Reference | None, base: Vehicle
                   ) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the pictures by sub-model, and the reasons for missing ones."""
    from dart_lab.identification.paper.evidence import collect_paper_data
    from dart_lab.identification.plots import collect_data, complete_fits, figures, why_missing

    fits = complete_fits(outcome.fits, base)
    evidence = (collect_data(data, fits, reference, base) if isinstance(data, list)
                else collect_paper_data(data))
    return figures(evidence, fits), why_missing(evidence, fits)


def _save_pictures(drawn: Mapping[str, Any], missing: Mapping[str, str], target: Path
                   ) -> list[Path]:
    """Write the pictures; print their paths, and the reasons for missing ones."""
    from dart_lab.identification.plots import draw

    # Without a suffix of a picture the name is a folder.
    pictures = ([save_figure(figure, target) for figure in list(drawn.values())[:1]]
                if target.suffix in FIGURE_FORMATS else draw(drawn, target))
    for picture in pictures:
        console.print(f"picture: {picture}", markup=False, highlight=False)
    for name, why in missing.items():
        console.print(f"no picture of {name}: {why}", style="yellow", markup=False,
                      highlight=False)
    return pictures


def _print_next_steps(path: Path, data: Any, reference: Reference | None) -> None:
    """Print the commands that follow after a model was written, with the same marker frame."""
    has_mocap = not isinstance(data, list) or any(r.mocap is not None for r in data)
    frame = f"{format_reference_option(reference)} " if reference else ""
    lines = [f"dart-hal evaluate --model {shlex.quote(str(path))} {frame}FILES   "
             "(motion capture that was not used in this fit)"] if has_mocap else []
    if path.parent.parent.name != "cars":
        lines.append("for a car of your own: the same with --car NAME --out cars/NAME/model.toml")
    for line in lines:
        console.print(f"next: {line}", markup=False, highlight=False)


def _report_written(written: WrittenModel, path: Path | None, target: Path | None,
                    dry_run: bool) -> None:
    """Print to standard error which sections were written, and the reasons for the others."""
    for section, why in written.left_out.items():
        console.print(f"not written: {section}: {why}; the values of the base model are kept",
                      style="yellow", markup=False, highlight=False)
    if path is not None:
        console.print(f"written: {path} ({', '.join(written.sections)})", markup=False,
                      highlight=False)
        return
    if dry_run:
        why = "a dry run"
    elif target is None:
        why = "--as-paper compares; --out FILE writes"
    else:
        untouched = f"; {target} is unchanged" if target.exists() else ""
        why = f"no sound fit of a sub-model{untouched}"
    console.print(f"nothing written: {why}", markup=False, highlight=False)
