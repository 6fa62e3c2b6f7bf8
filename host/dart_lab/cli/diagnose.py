"""``dart-hal diagnose``: what a model gets wrong, the physical cause, the extended model."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import click

from dart_hal.car.runs import NamedCar, read_all_unframed
from dart_hal.cli.common.options import (
    REFERENCE,
    FiniteNumber,
    PathsOption,
    format_reference_option,
    html_option,
    json_option,
    out_option,
)
from dart_hal.cli.common.output import (
    console,
    count_notices,
    print_json,
    print_line,
    progress_bar,
    show_notices,
)
from dart_hal.cli.common.outputs import OutputFile
from dart_hal.cli.common.sizes import apply_car_sizes, load_named_car, recorded_car_options
from dart_hal.core.config import ModelFile
from dart_hal.core.errors import UsageError
from dart_hal.recording.dart import Recording, Reference, with_marker_frames
from dart_hal.recording.fetch import find
from dart_lab.cli.cluster_option import cluster_option, connect_cluster
from dart_lab.cli.evaluate import list_fitted_hashes
from dart_lab.diagnosis.inputs import check_inputs, select_effects
from dart_lab.diagnosis.motion import driving_seconds
from dart_lab.diagnosis.result import Diagnosis
from dart_lab.identification.measured import default_model, named_model

# Fraction of the progress bar for reading. The number of files is unknown, so the bar approaches
# it geometrically: each file leaves UNREAD_FACTOR of the rest.
READING_FRACTION = 0.05
UNREAD_FACTOR = 0.9
# Skipped files that a notice names; more are counted.
MAX_NAMED_FILES = 3
Skipped = list[tuple[str, str]]


@click.command("diagnose")
@click.option("--model", default=None, metavar="M",
              help="a model.toml, or paper, paper-printed, upstream-2024; measured: the paper's "
                   "with the calibrated values of the car of the runs (default: measured where "
                   "the runs have a calibration, else paper)")
@click.option("--train", cls=PathsOption, metavar="FILES..",
              help="recordings to find causes in (files or folders, up to the next option)")
@click.option("--test", cls=PathsOption, metavar="FILES..",
              help="recordings to measure the gain on (default: stretches of each training "
                   "recording, about 40 % of it)")
@click.option("--refit/--no-refit", default=True, show_default=True,
              help="estimate the model's own parameters again before a cause is searched")
@out_option(".toml", content="the extended model (an older one goes to history/)")
@click.option("--out-predictor", type=OutputFile(".toml", replaces=False), default=None,
              metavar="FILE",
              help="look for the best predictor too and write it: every effect that lowers errors "
                   "in training recordings left out of the fit, accepted as a cause or not")
@html_option
@click.option("--only", multiple=True, metavar="EFFECT", help="look for this effect; repeatable")
@click.option("--exclude", multiple=True, metavar="EFFECT",
              help="do not look for this effect; repeatable")
@click.option("--false-alarm", type=FiniteNumber(1e-6, 0.5), default=0.01, show_default=True,
              help="false alarm rate: how often a cause may be named where nothing is wrong")
@click.option("--max-causes", type=click.IntRange(0, 50), default=12, show_default=True,
              help="name at most this many causes")
@click.option("--jobs", type=click.IntRange(1, 256), default=None,
              help="processes (default: every core from five minutes of driving on); the result "
                   "does not depend on it")
@click.option("--reference", type=REFERENCE, default=None, metavar="LX,THETA,LY",
              help="position and yaw of the mocap marker frame: m, rad, m (default: fitted, "
                   "but known for the published recordings)")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True,
              help="seed of the random draws for intervals and significance")
@click.option("--full", is_flag=True,
              help="print every sentence, the errors by model and every notice")
@click.option("--suggest", is_flag=True,
              help="suggest a drive that distinguishes causes which these data cannot")
@click.argument("loose", nargs=-1, metavar="")
@cluster_option
@recorded_car_options
@json_option
def command(model: str | None, train: tuple[Path, ...], test: tuple[Path, ...], refit: bool,
            out: Path | None, out_predictor: Path | None, html: Path | None,
            only: tuple[str, ...], exclude: tuple[str, ...], false_alarm: float, max_causes: int,
            jobs: int | None, reference: Reference | None, seed: int, full: bool, suggest: bool,
            cluster: str | None, loose: tuple[str, ...], car_name: str | None, cars: Path | None,
            as_json: bool) -> None:
    """Find what a model gets wrong on recordings, and the physical cause.

    A cause is an effect of the catalogue (docs/reference/effects.md) that explains the training
    recordings and lowers the errors of the test recordings. Confounded causes and unexplained
    structure are reported. The exit status is 0 for every verdict.
    """
    # 1. Check the arguments, before any file is read.
    _check_arguments(loose, train, test)
    if jobs is not None and cluster is not None:
        raise UsageError("--jobs and --cluster exclude each other", found=f"--jobs {jobs}",
                         expected="as many processes as the cluster has workers",
                         remedy="leave --jobs out")
    names = select_effects(only, exclude)
    connect_cluster(cluster)
    model = model or default_model((*train, *test))
    typed = _format_command(locals())
    car = load_named_car(car_name, cars)
    file, _ = named_model(model, (*train, *test))
    # 2. Read the recordings, and apply the measured sizes of the car to the model.
    with progress_bar() as bar:
        task = bar.add_task("reading", total=1.0)
        number = count(1)
        named = NamedCar(car_name, str(cars) if cars else None)
        recordings, skipped = _read_recordings(
            train, test, reference, named, lambda file: bar.update(
                task, completed=READING_FRACTION * (1.0 - UNREAD_FACTOR**next(number)),
                description=f"reading {file.name}"))
        sizes = apply_car_sizes(model, file, car, [*recordings[0], *recordings[1]], fitting=False)
        file = sizes.model
        vehicle = sizes.vehicle
        inputs = check_inputs(*recordings, vehicle, list_fitted_hashes(file))
        # 3. Diagnose. These modules take long to import, so errors of step 1 and 2 come first.
        from dart_hal.core.process.jobs import choose_processes
        from dart_lab.diagnosis import diagnose

        d = diagnose(file, vehicle, inputs.train, inputs.test, refit=refit, only=names,
                     false_alarm=false_alarm, max_causes=max_causes,
                     jobs=jobs or choose_processes(sum(map(driving_seconds, inputs.train))),
                     reference=reference, seed=seed, predictor=out_predictor is not None,
                     progress=lambda share, text: bar.update(
                         task, description=text,
                         completed=READING_FRACTION + (1.0 - READING_FRACTION) * share))
    sizes.show_cautions(as_json)
    d = _add_context(d, model, skipped, (*sizes.lines, *inputs.notes))
    # 4. Write the extended model, the predictor and the page, then print the results.
    if out is not None:
        from dart_lab.diagnosis.write import write_model

        d = replace(d, written=str(write_model(d, out, file, inputs.train, typed)))
    if out_predictor is not None:
        from dart_lab.diagnosis.write import write_predictor

        d = replace(d, predictor_written=str(
            write_predictor(d, out_predictor, file, inputs.train, typed)))
    suggestions, drives = _suggest_drives(d, file, seed) if suggest else ((), ())
    answer = {**d.to_json(), "sizes": sizes.to_json(), "report": html,
              **({"suggestions": [s.to_json() for s in suggestions],
                  "parameter_drives": [s.to_json() for s in drives]} if suggest else {})}
    if html is not None:
        from dart_lab.diagnosis.report import write_page

        write_page(d, html, command=typed, answer=answer,
                   suggestions=suggestions if suggest else None, drives=drives)
    notes = tuple(note for note in d.notes if note not in sizes.lines)
    if as_json:
        show_notices(notes)
        print_json(answer)
        return
    from dart_lab.pages.diagnose_table import show, show_full

    (show_full if full else show)(d)
    if sizes.first_line:
        print_line(sizes.first_line, "yellow")
    count_notices(notes, full)
    if suggest:
        from dart_lab.pages.diagnose_suggest import show_suggestions

        show_suggestions(suggestions, drives)
    _print_next_steps(d, html, test, reference)


def _check_arguments(loose: Sequence[str], train: Sequence[Path], test: Sequence[Path]) -> None:
    """Check the arguments before any file is read. Raises UsageError."""
    if loose:
        raise UsageError(f"{loose[0]} follows no option", found=shlex.join(loose),
                         expected="--train before recordings to find causes in, --test before "
                                  "others, one --only before each effect",
                         remedy=f"dart-hal diagnose --train {shlex.join(loose)}")
    if not train:
        raise UsageError("no recording to train on", expected="--train FILES (or folders of them)",
                         remedy="dart-hal diagnose --model paper --train FOLDER --html report.html")
    models = [p for p in (*train, *test) if p.suffix == ".toml"]
    if models:
        raise UsageError(f"{models[0]} is a model, no recording", found=str(models[0]),
                         expected="recordings or folders of them",
                         remedy=f"dart-hal diagnose --model {models[0]} --train FILES")


def _read_recordings(train: tuple[Path, ...], test: tuple[Path, ...], reference: Reference | None,
          car: NamedCar, on_file: Callable[[Path], None]
          ) -> tuple[tuple[list[Recording], list[Recording]], Skipped]:
    """Read (training recordings, test recordings), and list the skipped files.

    Both sets share the marker frames: they are fitted to all recordings of a car together.
    """
    first, skipped = read_all_unframed(find(train), on_file, car)
    second, more = read_all_unframed(find(test), on_file, car) if test else ([], [])
    both = with_marker_frames([*first, *second], reference)
    return (both[:len(first)], both[len(first):]), [*skipped, *more]


def _add_context(d: Diagnosis, model: str, skipped: Skipped, first: Sequence[str]) -> Diagnosis:
    """Return the diagnosis with the requested model, the skipped files and all notices."""
    unread = {file: {"used": 0, "why": [reason]} for file, reason in skipped}
    messages = tuple(f"{file} was skipped: {reason}" for file, reason in skipped[:MAX_NAMED_FILES])
    if len(skipped) > len(messages):
        messages += (f"{len(skipped) - len(messages)} more file(s) were skipped, see the report",)
    return replace(d, model=model, files={**d.files, **unread},
                   notes=tuple(dict.fromkeys((*first, *d.notes, *_list_limits(d),
                                             *messages))))


def _list_limits(d: Diagnosis) -> tuple[str, ...]:
    """List what recordings without motion capture cannot show."""
    from dart_lab.identification.evidence.onboard import OnboardEvidence, list_limits

    return (tuple(f"cannot be known from these recordings: {limit}"
                  for limit in list_limits(d.evidence))
            if isinstance(d.evidence, OnboardEvidence) else ())


def _suggest_drives(d: Diagnosis, file: ModelFile, seed: int) -> tuple[Sequence[Any],
                                                                       Sequence[Any]]:
    """Simulate drives; return those that separate causes and those that improve parameters."""
    # Imported here, because only --suggest needs the simulation.
    from dart_lab.diagnosis.suggest import suggest, suggest_parameter_drives

    with progress_bar() as bar:
        task = bar.add_task("simulating drives", total=2.0)

        def show_progress(share: float, text: str, done: float = 0.0) -> None:
            bar.update(task, completed=done + share, description=text)

        return (suggest(d, seed=seed, model=file, progress=show_progress),
                suggest_parameter_drives(d, model=file,
                                         progress=partial(show_progress, done=1.0)))


def _print_next_steps(d: Diagnosis, html: Path | None, test: Sequence[Path],
                      reference: Reference | None) -> None:
    """Print the files that were written and the next command, with the same marker frame."""
    lines = [f"report: {html}"] if html is not None else []
    if d.written is not None:
        model = shlex.quote(d.written)
        where = shlex.join(map(str, test)) if test else "FILES"
        frame = f"{format_reference_option(reference)} " if reference else ""
        # Without motion capture there is no path to compare a prediction with.
        evaluate = f"next: dart-hal evaluate --model {model} {frame}{where}"
        repeat = ("next: drive and record again, then dart-hal diagnose --no-refit "
                  f"--model {model} --train NEW")
        lines += [f"written: {d.written}", evaluate if d.evidence.has_mocap else repeat]
    if d.predictor_written is not None:
        lines.append(f"best predictor: {d.predictor_written}")
    for line in lines:
        console.print(line, markup=False, highlight=False)


def _format_command(given: dict[str, Any]) -> str:
    """Return the command line, for report and provenance."""
    words = ["dart-hal", "diagnose", "--model", given["model"]]
    for name in ("train", "test"):
        words += [f"--{name}", *map(str, given[name])] if given[name] else []
    words += [] if given["refit"] else ["--no-refit"]
    for name in ("only", "exclude"):
        words += [word for value in given[name] for word in (f"--{name}", value)]
    for name in ("out", "out_predictor", "html", "false_alarm", "max_causes", "seed"):
        if given[name] is not None:
            words += [f"--{name.replace('_', '-')}", str(given[name])]
    r = given["reference"]
    return shlex.join(words + ([] if r is None else [format_reference_option(r)]))

