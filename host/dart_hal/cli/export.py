"""``dart-hal export``: convert recordings to tables, ROS bags or LeRobot data sets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from dart_hal.car.export.bags import write_ros1, write_ros2
from dart_hal.car.export.lerobot import MAX_IMAGE_AGE, MAX_STATE_AGE, write_lerobot
from dart_hal.car.export.tables import write_csv, write_parquet
from dart_hal.car.export.whole import whole
from dart_hal.car.table import read_table
from dart_hal.cli.common.options import json_option
from dart_hal.cli.common.output import print_json, results, show_notices
from dart_hal.core.config import check_writable
from dart_hal.core.errors import UsageError
from dart_hal.recording.run import RunReader

Facts = dict[str, Any]
TABLE_WRITERS = {"csv": write_csv, "parquet": write_parquet}
BAG_WRITERS = {"ros2": write_ros2, "ros1": write_ros1}
EXPORT_KINDS = (*TABLE_WRITERS, *BAG_WRITERS, "lerobot")


@click.command("export")
@click.argument("kind", type=click.Choice(EXPORT_KINDS), metavar="|".join(EXPORT_KINDS))
@click.argument("run", type=click.Path(path_type=Path), nargs=-1, required=True)
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="PATH",
              help="csv, parquet: the file, replaced if it exists. ros1: a new .bag file. "
                   "ros2, lerobot: a new folder")
@click.option("--fps", type=click.IntRange(1, 100), default=50, show_default=True,
              help="lerobot: frames per second")
@click.option("--task", default="drive", show_default=True, help="lerobot: description of the task")
@json_option
def command(kind: str, run: Sequence[Path], out: Path, fps: int, task: str,
            as_json: bool) -> None:
    """Convert RUN for other programs; one car of a fleet's recording: fleet.mcap?car=NAME.

    csv, parquet: one row for each State, with commands and logged values; Parquet has units. A cell
    without a value is empty (NaN in Parquet).
    ros2, ros1: every message of every channel with its definition, plus LaserScan and /tf.
    lerobot: each RUN is one episode of observation.state, action and camera images if recorded;
    several RUNs are possible.

    Parquet and LeRobot need the extra table, with images also camera, bags the extra ros:
    pip install -e '.[table,camera,ros]' in the checkout.
    """
    _check_export(kind, run, out)
    if kind in TABLE_WRITERS:
        facts, text = _write_table(TABLE_WRITERS[kind], run[0], out)
    elif kind in BAG_WRITERS:
        facts, text = _write_bag(BAG_WRITERS[kind], run[0], out)
    else:
        facts, text = _write_data_set(run, out, fps, task)
    if as_json:
        print_json(facts)
    else:
        results.print(f"{out}: {text}", markup=False, highlight=False)


def _check_export(kind: str, runs: Sequence[Path], out: Path) -> None:
    """Raise UsageError if the export is impossible or would replace a recording or a folder."""
    if len(runs) > 1 and kind != "lerobot":
        raise UsageError(f"export {kind} takes one recording", found=f"{len(runs)} recordings",
                         expected="one", remedy=f"dart-hal export {kind} {runs[0]} --out {out}")
    # The same file may have two names, by links or relative paths.
    if any(out.exists() and run.exists() and out.samefile(run) for run in runs):
        raise UsageError("the export would replace its recording", found=str(out),
                         expected="another name after --out",
                         remedy=f"--out {runs[0].stem}.{kind}")
    if kind == "ros1" and out.suffix != ".bag":
        raise UsageError(f"{out}: the name of a ROS 1 bag must end in .bag", found=out.name,
                         expected=f"{out.stem}.bag", remedy=f"--out {out.with_suffix('.bag')}")
    check_writable(out.parent)
    if kind in TABLE_WRITERS and out.is_file():
        show_notices((f"{out} is replaced",))
    # A table is quickly made again and may be replaced; bags and data sets may not.
    if out.is_dir() if kind in TABLE_WRITERS else out.exists():
        raise UsageError(f"{out} exists already", expected="a path that does not exist",
                         remedy=f"mv {out} {out}.old")


def _write_table(write: Callable[..., None], run: Path, out: Path) -> tuple[Facts, str]:
    table = read_table(run)
    show_notices((*table.run.notices, *_describe_omitted(table.run)))
    with whole(out) as part:
        write(table, part)
    return ({"recording": run, "table": out, "rows": len(table), "columns": table.units},
            f"{len(table)} rows, {len(table.columns)} columns")


def _describe_omitted(run: RunReader, *, images: bool = True) -> tuple[str, ...]:
    """Return a notice about recorded data that the export omits; images: it omits images too."""
    kinds = [("images of the camera", run.images)] if images else []
    # The first message shows that there are any: the others need not be read.
    omitted = [name for name, messages in (*kinds, ("scans of the lidar", run.scans))
               if next(messages(), None) is not None]
    return (f"{run.path}: {' and '.join(omitted)} are not exported; export ros2 and ros1 keep them",
            ) if omitted else ()


def _write_bag(write: Callable[[RunReader, Path], int], run: Path, out: Path) -> tuple[Facts, str]:
    reader = RunReader(run)
    show_notices(reader.notices)
    with whole(out) as part:
        count = write(reader, part)
    return {"recording": run, "bag": out, "messages": count}, f"{count} messages"


def _write_data_set(runs: Sequence[Path], out: Path, fps: int, task: str) -> tuple[Facts, str]:
    tables = [read_table(run) for run in runs]
    for table in tables:
        show_notices((*table.run.notices, *_describe_omitted(table.run, images=False)))
    with whole(out) as part:
        made = write_lerobot(tables, part, fps=fps, task=task)
    if made.held:
        show_notices((f"{made.held} frames repeat a State older than {MAX_STATE_AGE:g} s, or an "
                      f"image older than {MAX_IMAGE_AGE:g} s: the link or the camera was "
                      "interrupted",))
    return ({"recordings": runs, "data_set": out, **made._asdict()},
            f"{made.episodes} episodes, {made.frames} frames at {fps} per second")
