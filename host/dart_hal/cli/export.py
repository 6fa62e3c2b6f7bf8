"""``dart-hal export``: a recorded run for other programs: tables, ROS bags, LeRobot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from dart_hal.car.export.bags import write_ros1, write_ros2
from dart_hal.car.export.lerobot import HELD, HELD_IMAGE, write_lerobot
from dart_hal.car.export.tables import write_csv, write_parquet
from dart_hal.car.export.whole import whole
from dart_hal.car.table import read_table
from dart_hal.cli.common.options import json_option
from dart_hal.cli.common.output import notices, print_json, results
from dart_hal.core.config import check_writable
from dart_hal.core.errors import UsageError
from dart_hal.recording.run import RunReader

Facts = dict[str, Any]
TABLES = {"csv": write_csv, "parquet": write_parquet}
BAGS = {"ros2": write_ros2, "ros1": write_ros1}
KINDS = (*TABLES, *BAGS, "lerobot")


@click.command("export")
@click.argument("kind", type=click.Choice(KINDS), metavar="|".join(KINDS))
@click.argument("run", type=click.Path(path_type=Path), nargs=-1, required=True)
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="PATH",
              help="csv, parquet: the table; replaces a file that is there. ros1: a new .bag. "
                   "ros2, lerobot: a new folder")
@click.option("--fps", type=click.IntRange(1, 100), default=50, show_default=True,
              help="lerobot: frames per second")
@click.option("--task", default="drive", show_default=True, help="lerobot: what was to be done")
@json_option
def command(kind: str, run: Sequence[Path], out: Path, fps: int, task: str,
            as_json: bool) -> None:
    """Write RUN for other programs; of a fleet's recording one car: fleet.mcap?car=NAME.

    csv, parquet: a row per State, commands, and what the program logged; Parquet has the unit of
    each column. An empty cell, in Parquet NaN, is what was not measured, asked or logged there.
    ros2, ros1: every message of every channel, with its definition; LaserScan and /tf besides.
    lerobot: each RUN is an episode of observation.state, action and the camera's images, where
    there are; several may be named.

    Parquet and LeRobot need the extra table, with images also camera, bags the extra ros:
    pip install -e '.[table,camera,ros]' in the checkout.
    """
    _check(kind, run, out)
    if kind in TABLES:
        facts, text = _table(TABLES[kind], run[0], out)
    elif kind in BAGS:
        facts, text = _bag(BAGS[kind], run[0], out)
    else:
        facts, text = _data_set(run, out, fps, task)
    if as_json:
        print_json(facts)
    else:
        results.print(f"{out}: {text}", markup=False, highlight=False)


def _check(kind: str, runs: Sequence[Path], out: Path) -> None:
    """Raises UsageError where the export could not be, or would replace what it should not."""
    if len(runs) > 1 and kind != "lerobot":
        raise UsageError(f"export {kind} takes one run", found=f"{len(runs)} runs",
                         expected="one", remedy=f"dart-hal export {kind} {runs[0]} --out {out}")
    if any(out.exists() and run.exists() and out.samefile(run) for run in runs):
        raise UsageError("the export would replace its recording", found=str(out),
                         expected="another name after --out",
                         remedy=f"--out {runs[0].stem}.{kind}")
    if kind == "ros1" and out.suffix != ".bag":
        raise UsageError(f"{out}: a bag of ROS 1 ends in .bag", found=out.name,
                         expected=f"{out.stem}.bag", remedy=f"--out {out.with_suffix('.bag')}")
    check_writable(out.parent)
    if kind in TABLES and out.is_file():
        notices((f"{out} is replaced",))
    if out.is_dir() if kind in TABLES else out.exists():
        raise UsageError(f"{out} is there already", expected="a name that is free",
                         remedy=f"mv {out} {out}.old")


def _table(write: Callable[..., None], run: Path, out: Path) -> tuple[Facts, str]:
    table = read_table(run)
    notices((*table.run.notices, *_left_out(table.run)))
    with whole(out) as part:
        write(table, part)
    return ({"recording": run, "table": out, "rows": len(table), "columns": table.units},
            f"{len(table)} rows, {len(table.columns)} columns")


def _left_out(run: RunReader, *, images: bool = True) -> tuple[str, ...]:
    """What is no number of a State; images: they are left out, too."""
    kinds = [("images of the camera", run.images)] if images else []
    there = [name for name, messages in (*kinds, ("scans of the lidar", run.scans))
             if next(messages(), None) is not None]
    return (f"{run.path}: the {' and '.join(there)} are left out; export ros2 and ros1 keep them",
            ) if there else ()


def _bag(write: Callable[[RunReader, Path], int], run: Path, out: Path) -> tuple[Facts, str]:
    reader = RunReader(run)
    notices(reader.notices)
    with whole(out) as part:
        count = write(reader, part)
    return {"recording": run, "bag": out, "messages": count}, f"{count} messages"


def _data_set(runs: Sequence[Path], out: Path, fps: int, task: str) -> tuple[Facts, str]:
    tables = [read_table(run) for run in runs]
    for table in tables:
        notices((*table.run.notices, *_left_out(table.run, images=False)))
    with whole(out) as part:
        made = write_lerobot(tables, part, fps=fps, task=task)
    if made.held:
        notices((f"{made.held} frames repeat a State that is older than {HELD:g} s, or an image "
                 f"older than {HELD_IMAGE:g} s: link or camera were interrupted there",))
    return ({"recordings": runs, "data_set": out, **made._asdict()},
            f"{made.episodes} episodes, {made.frames} frames at {fps} per second")
