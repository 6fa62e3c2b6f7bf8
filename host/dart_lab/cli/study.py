"""``dart-hal study``: from recordings to a diagnosed model, in stages."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import click
from rich.progress import Progress, TaskID

from dart_hal.car.runs import NamedCar, read_any
from dart_hal.cli.common.options import (
    REFERENCE,
    PageOption,
    full_option,
    json_option,
    out_folder_option,
)
from dart_hal.cli.common.output import (
    console,
    count_notices,
    print_json,
    print_line,
    print_verdict,
    progress_bar,
)
from dart_hal.cli.common.sizes import apply_car_sizes, load_named_car, recorded_car_options
from dart_hal.core.errors import UsageError
from dart_hal.recording.dart import Reference
from dart_hal.recording.fetch import find
from dart_lab.cli.cluster_option import cluster_option, connect_cluster
from dart_lab.identification.measured import named_model
from dart_lab.study import STAGES, Study, load_results, run_stage, write_study_page
from dart_lab.study.stages import StageResult, describe_validation


@click.command("study")
@click.argument("files", nargs=-1, type=click.Path(path_type=Path))
@out_folder_option("results and page; each stage replaces its own", Path("study"))
@click.option("--stage", type=click.Choice(list(STAGES)), default=None,
              help="repeat one stage alone, with the results that are in the folder")
@click.option("--base", default="paper", show_default=True, metavar="MODEL",
              help="start model: a model.toml, or paper, paper-printed, upstream-2024")
@click.option("--reference", type=REFERENCE, default=None, metavar="LX,THETA,LY",
              help="position and yaw of the mocap marker frame: m, rad, m (default: fitted, "
                   "but known for the published recordings)")
@click.option("--html", cls=PageOption, default=None)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True,
              help="seed of the random draws for intervals and significance")
@full_option
@cluster_option
@recorded_car_options
@json_option
def command(files: tuple[Path, ...], out: Path, stage: str | None, base: str,
            reference: Reference | None, html: Path | None, seed: int, full: bool,
            cluster: str | None, car_name: str | None, cars: Path | None, as_json: bool) -> int:
    """Study a car by its recordings: check, identifiability, fit, validation, diagnosis, next.

    FILES: recordings or folders of them, imported ones too (dart-hal data import). The last third
    of the recordings tests; of a single one, stretches. A study stops at a stage without a sound
    result.
    """
    if not files:
        raise UsageError("no recording named", expected="FILES (recordings or folders of them)",
                         remedy="dart-hal study FOLDER --car NAME --html study.html")
    connect_cluster(cluster)
    recordings, skipped = read_any(find(files), reference=reference,
                                   car=NamedCar(car_name, str(cars) if cars else None))
    # Sizes of the named car replace those of the start model, which fits may then move within their
    # standard errors.
    file, _ = named_model(base, files)
    sizes = apply_car_sizes(base, file, load_named_car(car_name, cars), recordings, fitting=True)
    notes = (*sizes.lines, *(f"{path} was skipped: {why}" for path, why in skipped))
    out.mkdir(parents=True, exist_ok=True)
    study = Study(out, tuple(recordings), sizes.model, notes, seed)
    for name in STAGES if stage is None else (stage,):
        with progress_bar() as bar:
            result = run_stage(study, name, partial(_report_progress, bar,
                                                    bar.add_task(name, total=1.0)))
        # Later stages use this result: they would fail, or mislead.
        if not result.sound:
            break
    # The page also has the stages of earlier calls.
    results = load_results(out)
    page = None
    if html is not None:
        # Without a file, as in version 0.1, the page is next to the results.
        target = html if html.name else out / "index.html"
        page = write_study_page(results, target, car_name or sizes.model.name)
    if as_json:
        print_json({"folder": out, "page": page, "stages": {
            name: {"verdict": r.verdict, "lines": r.lines, "sound": r.sound, "facts": r.facts}
            for name, r in results.items()}})
    else:
        _show(results, full)
        if page is not None:
            console.print(f"report: {page}", markup=False, highlight=False)
    return 0 if all(r.sound for r in results.values()) else 1


def _show(results: Mapping[str, StageResult], full: bool) -> None:
    """Print verdict, errors and first step in three lines, then a line for each stage.

    full: print the sentences of each stage, else their number.
    """
    unsound = next((r for r in results.values() if not r.sound), None)
    last = unsound or results.get("diagnosis") or list(results.values())[-1]
    verdict = (f"The study ends at {unsound.stage}: {unsound.verdict}." if unsound
               else last.verdict)
    validation = results.get("validation")
    print_verdict(verdict, describe_validation(validation) if validation else "",
                  _first_step(results, unsound), "bold" if unsound is None else "bold red")
    for name, result in results.items():
        print_line(f"  {name}: {result.verdict}", "" if result.sound else "red")
    count_notices(tuple(f"{name}: {line}" for name, result in results.items()
                        for line in result.lines), full)


def _first_step(results: Mapping[str, StageResult], unsound: StageResult | None) -> str:
    """Return what to do first: about the stage at which the study ends, or the next drive."""
    if unsound is not None:
        return unsound.lines[0] if unsound.lines else f"repeat it: --stage {unsound.stage}"
    if "next" in results:
        return results["next"].verdict
    missing = next((name for name in STAGES if name not in results), None)
    return f"run the next stage: --stage {missing}" if missing else ""


def _report_progress(bar: Progress, task: TaskID, share: float, text: str) -> None:
    """Show the progress of a stage."""
    bar.update(task, completed=share, description=text)
