"""``dart-hal replay``: run a recording through the decoder and the estimators of the car."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import click

from dart_hal.car import Car
from dart_hal.car.export.whole import whole
from dart_hal.cli.common.options import json_option, old_spelling, out_option
from dart_hal.cli.common.output import print_json, results, show_notices
from dart_hal.cli.common.outputs import OutputFile
from dart_hal.cli.common.summary import RunSummary
from dart_hal.recording import open_writer


@click.command("replay")
@click.argument("recording", type=click.Path(path_type=Path, dir_okay=False))
@out_option(".csv", content="the States as a table", replaces=True)
@old_spelling("--csv", "--out", OutputFile(".csv"))
@json_option
def command(recording: Path, out: Path | None, as_json: bool) -> None:
    """Decode RECORDING again; the States are identical to those of the run."""
    files = {"recording": recording} | ({"csv": out} if out else {})
    with Car.open(f"replay://{recording}") as car:
        show_notices(car.notices)
        summary = RunSummary(car)
        with ExitStack() as files_open:
            if out is not None:
                writer = files_open.enter_context(open_writer(files_open.enter_context(whole(out))))
                car.on_state(writer.state)
            # States reach the summary and the file by callbacks.
            for _ in car.states():
                pass
        result = summary.as_json(files)
    if as_json:
        print_json(result)
    else:
        pose = result["summary"]["pose"] or {"x": 0.0, "y": 0.0}
        results.print(f"{summary.frames} frames in {summary.duration:.1f} s, {summary.lost} lost; "
                      f"{summary.distance:.2f} m driven, ends at x {pose['x']:.3f} m, "
                      f"y {pose['y']:.3f} m")
