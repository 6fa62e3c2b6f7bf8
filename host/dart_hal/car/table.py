"""A recorded run as a table: a row per State, named columns with units, and what was logged."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dart_hal.car.car import Car
from dart_hal.car.identity import Hello
from dart_hal.core.errors import UsageError
from dart_hal.core.process.extras import install_command
from dart_hal.core.types import FloatArray, State
from dart_hal.recording.run import RunReader


class TableColumn(NamedTuple):
    """A column of the table.

    unit: "" without one. of: reads the value from a State. meaning: for the user.
    """

    unit: str
    of: Callable[[State], Any]
    meaning: str


def _names(values: Iterable[object]) -> str:
    return "|".join(sorted(map(str, values)))


def _room_pose(state: State) -> tuple[float | None, float | None, float | None]:
    """Return (x, y, yaw) of the rear axle by external poses; None before the first."""
    estimate = state.external.estimate if state.external is not None else None
    if estimate is None:
        return None, None, None
    return estimate.pose.x, estimate.pose.y, estimate.pose.yaw


# Columns by name. Of several commands or logged values within one row the latest counts.
TABLE_COLUMNS = {
    "t": TableColumn("s", lambda s: s.t, "time of the sample, in the car's clock"),
    "seq": TableColumn("", lambda s: s.seq, "number of the frame"),
    "speed": TableColumn("m/s", lambda s: s.speed, "of the rear axle, forward positive"),
    "speed_std": TableColumn("m/s", lambda s: s.speed_std, "one sigma of it"),
    "yaw_rate": TableColumn("rad/s", lambda s: s.yaw_rate,
                            "left positive; NaN while the IMU is out"),
    "accel_x": TableColumn("m/s2", lambda s: s.accel_x, "forward; NaN while the IMU is out"),
    "accel_y": TableColumn("m/s2", lambda s: s.accel_y, "left; NaN while the IMU is out"),
    "ticks": TableColumn("", lambda s: s.ticks, "encoder edges since boot"),
    "x": TableColumn("m", lambda s: s.pose.x, "of the rear axle, by odometry"),
    "y": TableColumn("m", lambda s: s.pose.y, "of the rear axle, by odometry"),
    "yaw": TableColumn("rad", lambda s: s.pose.yaw, "heading, unwrapped"),
    "steering": TableColumn("rad", lambda s: s.applied.steering, "what the pins carry"),
    "throttle": TableColumn("", lambda s: s.applied.throttle, "what the pins carry, -1..1"),
    "steering_us": TableColumn("us", lambda s: s.applied.steering_us, "pulse at the pin"),
    "throttle_us": TableColumn("us", lambda s: s.applied.throttle_us, "pulse at the pin"),
    "limited": TableColumn("", lambda s: _names(s.applied.limited),
                           "why it differs from the command, by |"),
    "flags": TableColumn("", lambda s: _names(s.health.flags), "flags of the frame, by |"),
    "doubts": TableColumn("", lambda s: _names(s.health.doubts), "what is known against it, by |"),
    "lost": TableColumn("", lambda s: s.health.lost, "frames lost since the opening"),
    "battery": TableColumn("V", lambda s: s.battery, "voltage; no column without a sensor"),
    "room_x": TableColumn("m", lambda s: _room_pose(s)[0],
                          "of the rear axle, by external poses; no column without a source"),
    "room_y": TableColumn("m", lambda s: _room_pose(s)[1],
                          "of the rear axle, by external poses; no column without a source"),
    "room_yaw": TableColumn("rad", lambda s: _room_pose(s)[2],
                            "heading, by external poses; no column without a source"),
    "command_steering": TableColumn("rad", lambda s: None,
                                    "command before the next row, else NaN"),
    "command_throttle": TableColumn("", lambda s: None, "command before the next row, else NaN"),
}

# Columns that are left out of a run in which they have no value.
OPTIONAL_COLUMNS = ("battery", "room_x", "room_y", "room_yaw")
_INTEGER_COLUMNS = ("seq", "ticks", "lost")
_TEXT_COLUMNS = ("limited", "flags", "doubts")


@dataclass(frozen=True, slots=True)
class RunTable:
    """A run as a table.

    columns: arrays (n,) by name, in the order of ``TABLE_COLUMNS``, then ``log/NAME`` each.
    run: reader of the file. hello: identity of the Nano. damaged: number of damaged frames.
    """

    run: RunReader
    hello: Hello
    damaged: int
    columns: dict[str, NDArray[Any]]

    @property
    def units(self) -> dict[str, str]:
        """Return the unit of each column; "" where there is none, or none is known."""
        return {name: TABLE_COLUMNS[name].unit if name in TABLE_COLUMNS else ""
                for name in self.columns}

    def __len__(self) -> int:
        return len(self.columns["t"])


def read_table(path: Path | str) -> RunTable:
    """Replay a run as a table. An element of a logged array is the column ``log/NAME[i,j]``.

    Raises RecordingError for a file that is not a run, and what ``Car.open`` raises.
    """
    run = RunReader(path)
    with Car.open(f"replay://{path}") as car:
        states = list(car.states())
        hello = car.hello
        damaged = car.timing.damaged
    columns = {name: _column(name, [column.of(s) for s in states])
               for name, column in TABLE_COLUMNS.items()}
    for name in OPTIONAL_COLUMNS:
        if np.isnan(columns[name]).all():
            del columns[name]
    for command in run.commands():
        if (row := _row(columns["t"], command.t)) >= 0:
            columns["command_steering"][row] = command.steering
            columns["command_throttle"][row] = command.throttle
    # An element of an array is a column of its own.
    for item in run.logged():
        row = _row(columns["t"], item.t)
        value = np.asarray(item.value)
        for index in np.ndindex(value.shape) if row >= 0 else ():
            name = f"log/{item.name}" + (f"[{','.join(map(str, index))}]" if index else "")
            if name not in columns:
                columns[name] = np.full(len(states), np.nan)
            columns[name][row] = value[index]
    return RunTable(run, hello, damaged, columns)


def _column(name: str, values: list[Any]) -> NDArray[Any]:
    if name in _TEXT_COLUMNS:
        return np.array(values, dtype=object)
    return np.array(values, dtype=np.int64 if name in _INTEGER_COLUMNS else np.float64)


def _row(t: FloatArray, t_query: float) -> int:
    """Return the row of the newest State until time ``t_query`` [s]; -1 before the first."""
    return int(np.searchsorted(t, t_query, side="right")) - 1


def to_dataframe(path: Path | str) -> Any:
    """Replay a run as a pandas DataFrame: a row per State, columns as in ``read_table``.

    ``frame.attrs["units"]`` has the unit of each column. NaN where nothing was measured, commanded
    or logged in that row; ``ffill()`` repeats the last value. Raises UsageError without pandas,
    RecordingError for a file that is not a run.
    """
    try:
        import pandas as pd
    except ImportError as error:
        raise missing_package_error("pandas", "a DataFrame") from error
    table = read_table(path)
    frame = pd.DataFrame(table.columns, copy=False)
    frame.attrs["units"] = table.units
    return frame


def missing_package_error(package: str, what: str, extra: str = "table") -> UsageError:
    """Return the error for a package that is not installed; ``extra``: the extra that has it."""
    return UsageError(f"{what} needs {package}", found=f"{package} is not installed",
                      remedy=install_command(extra))
