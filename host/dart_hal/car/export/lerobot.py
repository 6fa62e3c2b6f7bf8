"""Runs as a LeRobot data set of format v3.0, an episode each.

Written by the specification of the format, so that an export does not need LeRobot and torch:
https://github.com/huggingface/lerobot, ``datasets/utils.py`` and ``lerobot_dataset.py`` of
version 0.4.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dart_hal.car.export import lerobot_images as pictures
from dart_hal.car.table import RunTable, missing_package_error
from dart_hal.core.errors import UsageError
from dart_hal.core.types import Image

FORMAT_VERSION = "v3.0"
# Columns of ``observation.state``, SI units; steering and throttle are those at the pins.
OBSERVATION_COLUMNS = ("speed", "yaw_rate", "accel_x", "accel_y", "x", "y", "yaw", "steering",
                       "throttle")
# Voltage of the battery [V], where every run has it.
BATTERY_FEATURE = "observation.battery"
# Columns of ``action``: commands [rad, -1..1].
ACTION_COLUMNS = ("command_steering", "command_throttle")
# s: a State that is older is outdated.
MAX_STATE_AGE = 0.1
# s: the same of an image; a camera with 5 images per second may miss one.
MAX_IMAGE_AGE = 0.5
_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_DATA = f"data/{_FILE}"
_EPISODES = f"meta/episodes/{_FILE}"

Columns = dict[str, NDArray[Any]]


class DatasetSize(NamedTuple):
    """Content of a data set.

    held: frames with a State older than ``MAX_STATE_AGE`` or an image older than ``MAX_IMAGE_AGE``.
    """

    episodes: int
    frames: int
    held: int


def write_lerobot(tables: Sequence[RunTable], path: Path, *, fps: int = 50,
                  task: str = "drive") -> DatasetSize:
    """Write a folder with ``meta`` and ``data`` in Parquet; each run is an episode.

    An episode begins with the first command.

    Where every run has the voltage of the battery, ``observation.battery`` is it.
    Runs with a camera contain its images, and begin with the first image if that is later.
    Raises UsageError for a run without commands, for runs with and without a camera together, or
    without pandas and pyarrow (with images Pillow); OSError.
    """
    try:
        import pandas as pd
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise missing_package_error("pandas and pyarrow", "a data set") from error
    episodes = []
    held = 0
    index = 0
    for number, (table, images) in enumerate(zip(tables, pictures.images_of(tables), strict=True)):
        columns, old = episode(table, fps, images)
        frames = len(columns["action"])
        columns |= {"frame_index": np.arange(frames), "index": index + np.arange(frames),
                    "episode_index": np.full(frames, number),
                    "task_index": np.zeros(frames, np.int64)}
        episodes.append(columns)
        held = held + old
        index = index + frames
    if not all(BATTERY_FEATURE in columns for columns in episodes):
        for columns in episodes:
            columns.pop(BATTERY_FEATURE, None)
    together = {name: np.concatenate([e[name] for e in episodes]) for name in episodes[0]}
    for file, content in (
            (_DATA, pa.table({name: _arrow(pa, c) for name, c in together.items()})),
            (_EPISODES, pa.Table.from_pylist([_episode_row(e, task) for e in episodes]))):
        target = path / file.format(chunk_index=0, file_index=0)
        target.parent.mkdir(parents=True)
        pq.write_table(content, target)
    pd.DataFrame({"task_index": [0]}, index=[task]).to_parquet(path / "meta" / "tasks.parquet")
    _write_json(path / "meta" / "stats.json", {n: statistics(c) for n, c in together.items()})
    _write_json(path / "meta" / "info.json", {
        "codebase_version": FORMAT_VERSION, "robot_type": "dart", "total_episodes": len(episodes),
        "total_frames": index, "total_tasks": 1, "chunks_size": 1000,
        "data_files_size_in_mb": 100, "video_files_size_in_mb": 200, "fps": fps,
        "splits": {"train": f"0:{len(episodes)}"}, "data_path": _DATA, "video_path": None,
        "features": {name: _feature(name, c) for name, c in together.items()}})
    return DatasetSize(len(episodes), index, held)


def episode(table: RunTable, fps: int, images: Sequence[Image] = ()) -> tuple[Columns, int]:
    """Resample one run to a period of 1 / fps: columns (n,) or (n, m), and outdated frames.

    A frame has the newest State, command and image at its time. Missing values of the IMU are
    repeated, 0 before the first. Raises UsageError for a run without commands, or without an image
    while it was driven.
    """
    t = table.columns["t"]
    commanded = np.flatnonzero(~np.isnan(table.columns[ACTION_COLUMNS[0]]))
    if not len(commanded):
        raise UsageError(f"{table.run.path}: the run has no commands to learn from",
                         found="no command", expected="a run with commands",
                         remedy="dart-hal drive SCRIPT --record run.mcap")
    # The episode begins with the first command and the first image.
    begin = max([t[commanded[0]], *(image.arrival for image in images[:1])])
    if begin > t[-1]:
        raise UsageError(f"{table.run.path}: its first image came behind its last State",
                         found=f"{begin - t[-1]:.1f} s later", expected="images while it drove")
    grid = begin + np.arange(int((t[-1] - begin) * fps + 1e-6) + 1) / fps
    # Row of the newest State at each frame of the grid.
    row = np.searchsorted(t, grid + 1e-9, side="right") - 1
    state, action = (np.stack([_fill_nan(table.columns[n])[row] for n in names], axis=1)
                     for names in (OBSERVATION_COLUMNS, ACTION_COLUMNS))
    columns = {"observation.state": state.astype(np.float32), "action": action.astype(np.float32),
               "timestamp": (np.arange(len(grid)) / fps).astype(np.float32)}
    if "battery" in table.columns:
        columns[BATTERY_FEATURE] = _fill_nan(table.columns["battery"])[row].astype(np.float32)
    old = grid - t[row] > MAX_STATE_AGE
    if images:
        newest = pictures.newest(images, grid)
        columns[pictures.IMAGE_FEATURE] = pictures.column(images, newest)
        old |= grid - np.array([images[n].arrival for n in newest]) > MAX_IMAGE_AGE
    return columns, int(np.count_nonzero(old))


def statistics(column: NDArray[Any]) -> dict[str, list[Any]]:
    """Return what LeRobot normalises by: lists of length m, of a column (n, m); (n,) has m = 1."""
    if column.dtype == object:
        return pictures.statistics(column)
    values = column.reshape(len(column), -1).astype(np.float64)
    quantiles = np.quantile(values, pictures.QUANTILES, axis=0)
    return {"min": values.min(0).tolist(), "max": values.max(0).tolist(),
            "mean": values.mean(0).tolist(), "std": values.std(0).tolist(),
            "count": [len(values)],
            **{f"q{round(100 * q):02d}": row.tolist()
               for q, row in zip(pictures.QUANTILES, quantiles, strict=True)}}


def _fill_nan(column: NDArray[Any]) -> NDArray[Any]:
    """Replace NaN by the last number before it; 0 before the first."""
    last = np.maximum.accumulate(np.where(np.isnan(column), 0, np.arange(len(column))))
    held: NDArray[Any] = np.nan_to_num(column[last], nan=0.0)
    return held


def _episode_row(columns: Columns, task: str) -> dict[str, Any]:
    """Return the row of an episode in ``meta/episodes``."""
    begin = int(columns["index"][0])
    number = int(columns["episode_index"][0])
    row = {"episode_index": number, "tasks": [task], "length": len(columns["action"]),
           "data/chunk_index": 0, "data/file_index": 0, "dataset_from_index": begin,
           "dataset_to_index": begin + len(columns["action"]),
           "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
    return row | {f"stats/{name}/{key}": value for name, column in columns.items()
                  for key, value in statistics(column).items()}


def _feature(name: str, column: NDArray[Any]) -> dict[str, Any]:
    if column.dtype == object:
        return pictures.feature(column)
    names = {"observation.state": list(OBSERVATION_COLUMNS),
             "action": [n.removeprefix("command_") for n in ACTION_COLUMNS]}.get(name)
    return {"dtype": str(column.dtype), "shape": list(column.shape[1:]) or [1], "names": names}


def _arrow(pa: Any, column: NDArray[Any]) -> Any:
    if column.dtype == object:
        return pictures.arrow(pa, column)
    if column.ndim == 1:
        return pa.array(column)
    return pa.FixedSizeListArray.from_arrays(pa.array(column.ravel()), column.shape[1])


def _write_json(path: Path, value: object) -> None:
    path.write_text(json.dumps(value, indent=4), encoding="utf-8")
