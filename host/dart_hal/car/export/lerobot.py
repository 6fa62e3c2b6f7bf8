"""Runs as a data set of LeRobot, an episode each: format v3.0.

Written from the format alone, so that nobody needs LeRobot (and torch) to export:
https://github.com/huggingface/lerobot, ``datasets/utils.py`` and ``lerobot_dataset.py``
of version 0.4.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dart_hal.car.export import lerobot_images as pictures
from dart_hal.car.table import RunTable, missing
from dart_hal.core.errors import UsageError
from dart_hal.core.types import Image

VERSION = "v3.0"
OBSERVED = ("speed", "yaw_rate", "accel_x", "accel_y", "x", "y", "yaw", "steering", "throttle")
"""Columns of ``observation.state``: SI units; steering and throttle are what the pins carry."""
COMMANDED = ("command_steering", "command_throttle")
"""Columns of ``action``: what was asked for [rad, -1..1]."""
HELD = 0.1
"""s: what was measured before that is not of now."""
HELD_IMAGE = 0.5
"""s: the same of an image; a camera of 5 a second that misses one still counts as there."""
_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_DATA, _EPISODES = f"data/{_FILE}", f"meta/episodes/{_FILE}"

Columns = dict[str, NDArray[Any]]


class Written(NamedTuple):
    """What a data set holds; ``held``: frames whose State was older than ``HELD``, or
    whose image had come more than ``HELD_IMAGE`` before."""

    episodes: int
    frames: int
    held: int


def write_lerobot(tables: Sequence[RunTable], path: Path, *, fps: int = 50,
                  task: str = "drive") -> Written:
    """A folder with ``meta``, and ``data`` in Parquet; an episode begins with the first command.

    Runs with a camera have its images, and begin with the first of them where that comes later.
    Errors: UsageError for a run without commands, for runs with and without a camera together,
    or without pandas and pyarrow, with images Pillow; OSError.
    """
    try:
        import pandas as pd
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise missing("pandas and pyarrow", "a data set") from error
    episodes, held, index = [], 0, 0
    for number, (table, images) in enumerate(zip(tables, pictures.images_of(tables), strict=True)):
        columns, old = episode(table, fps, images)
        frames = len(columns["action"])
        columns |= {"frame_index": np.arange(frames), "index": index + np.arange(frames),
                    "episode_index": np.full(frames, number),
                    "task_index": np.zeros(frames, np.int64)}
        episodes.append(columns)
        held, index = held + old, index + frames
    together = {name: np.concatenate([e[name] for e in episodes]) for name in episodes[0]}
    for file, content in (
            (_DATA, pa.table({name: _arrow(pa, c) for name, c in together.items()})),
            (_EPISODES, pa.Table.from_pylist([_about(e, task) for e in episodes]))):
        target = path / file.format(chunk_index=0, file_index=0)
        target.parent.mkdir(parents=True)
        pq.write_table(content, target)
    pd.DataFrame({"task_index": [0]}, index=[task]).to_parquet(path / "meta" / "tasks.parquet")
    _write_json(path / "meta" / "stats.json", {n: statistics(c) for n, c in together.items()})
    _write_json(path / "meta" / "info.json", {
        "codebase_version": VERSION, "robot_type": "dart", "total_episodes": len(episodes),
        "total_frames": index, "total_tasks": 1, "chunks_size": 1000,
        "data_files_size_in_mb": 100, "video_files_size_in_mb": 200, "fps": fps,
        "splits": {"train": f"0:{len(episodes)}"}, "data_path": _DATA, "video_path": None,
        "features": {name: _feature(name, c) for name, c in together.items()}})
    return Written(len(episodes), index, held)


def episode(table: RunTable, fps: int, images: Sequence[Image] = ()) -> tuple[Columns, int]:
    """Columns (n,) or (n, m) of one run on a grid of 1 / fps, and how many frames are held.

    A frame has the newest State until then, the newest command and the newest image that had come;
    what the IMU did not give is held, before its first sample 0. Errors: UsageError for a run
    without commands, or with no image in it while it was driven.
    """
    t = table.columns["t"]
    asked = np.flatnonzero(~np.isnan(table.columns[COMMANDED[0]]))
    if not len(asked):
        raise UsageError(f"{table.run.path}: nobody drove, there is no action to learn",
                         found="no command", expected="a run with commands",
                         remedy="dart-hal drive SCRIPT --record run.mcap")
    begin = max([t[asked[0]], *(image.arrival for image in images[:1])])
    if begin > t[-1]:
        raise UsageError(f"{table.run.path}: its first image came behind its last State",
                         found=f"{begin - t[-1]:.1f} s later", expected="images while it drove")
    grid = begin + np.arange(int((t[-1] - begin) * fps + 1e-6) + 1) / fps
    row = np.searchsorted(t, grid + 1e-9, side="right") - 1
    state, action = (np.stack([_filled(table.columns[n])[row] for n in names], axis=1)
                     for names in (OBSERVED, COMMANDED))
    columns = {"observation.state": state.astype(np.float32), "action": action.astype(np.float32),
               "timestamp": (np.arange(len(grid)) / fps).astype(np.float32)}
    old = grid - t[row] > HELD
    if images:
        shown = pictures.newest(images, grid)
        columns[pictures.NAME] = pictures.column(images, shown)
        old |= grid - np.array([images[n].arrival for n in shown]) > HELD_IMAGE
    return columns, int(np.count_nonzero(old))


def statistics(column: NDArray[Any]) -> dict[str, list[Any]]:
    """What LeRobot normalises by: each (m,), of a column (n, m); a column (n,) has m = 1. Of
    images see there."""
    if column.dtype == object:
        return pictures.statistics(column)
    values = column.reshape(len(column), -1).astype(np.float64)
    quantiles = np.quantile(values, pictures.QUANTILES, axis=0)
    return {"min": values.min(0).tolist(), "max": values.max(0).tolist(),
            "mean": values.mean(0).tolist(), "std": values.std(0).tolist(),
            "count": [len(values)],
            **{f"q{round(100 * q):02d}": row.tolist()
               for q, row in zip(pictures.QUANTILES, quantiles, strict=True)}}


def _filled(column: NDArray[Any]) -> NDArray[Any]:
    """NaN replaced by the last number before it; 0 before the first."""
    last = np.maximum.accumulate(np.where(np.isnan(column), 0, np.arange(len(column))))
    held: NDArray[Any] = np.nan_to_num(column[last], nan=0.0)
    return held


def _about(columns: Columns, task: str) -> dict[str, Any]:
    """The row of an episode."""
    begin, number = int(columns["index"][0]), int(columns["episode_index"][0])
    row = {"episode_index": number, "tasks": [task], "length": len(columns["action"]),
           "data/chunk_index": 0, "data/file_index": 0, "dataset_from_index": begin,
           "dataset_to_index": begin + len(columns["action"]),
           "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
    return row | {f"stats/{name}/{key}": value for name, column in columns.items()
                  for key, value in statistics(column).items()}


def _feature(name: str, column: NDArray[Any]) -> dict[str, Any]:
    if column.dtype == object:
        return pictures.feature(column)
    names = {"observation.state": list(OBSERVED),
             "action": [n.removeprefix("command_") for n in COMMANDED]}.get(name)
    return {"dtype": str(column.dtype), "shape": list(column.shape[1:]) or [1], "names": names}


def _arrow(pa: Any, column: NDArray[Any]) -> Any:
    if column.dtype == object:
        return pictures.arrow(pa, column)
    if column.ndim == 1:
        return pa.array(column)
    return pa.FixedSizeListArray.from_arrays(pa.array(column.ravel()), column.shape[1])


def _write_json(path: Path, value: object) -> None:
    path.write_text(json.dumps(value, indent=4), encoding="utf-8")
