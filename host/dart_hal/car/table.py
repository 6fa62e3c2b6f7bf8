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


class Column(NamedTuple):
    """What a column holds: its unit, "" where it has none, how it is read from a State, why."""

    unit: str
    of: Callable[[State], Any]
    meaning: str


def _names(values: Iterable[object]) -> str:
    return "|".join(sorted(map(str, values)))


COLUMNS = {
    "t": Column("s", lambda s: s.t, "time of the sample, in the car's clock"),
    "seq": Column("", lambda s: s.seq, "number of the frame"),
    "speed": Column("m/s", lambda s: s.speed, "of the rear axle, forward positive"),
    "speed_std": Column("m/s", lambda s: s.speed_std, "one sigma of it"),
    "yaw_rate": Column("rad/s", lambda s: s.yaw_rate, "left positive; NaN while the IMU is out"),
    "accel_x": Column("m/s2", lambda s: s.accel_x, "forward; NaN while the IMU is out"),
    "accel_y": Column("m/s2", lambda s: s.accel_y, "left; NaN while the IMU is out"),
    "ticks": Column("", lambda s: s.ticks, "encoder edges since boot"),
    "x": Column("m", lambda s: s.pose.x, "of the rear axle, by odometry"),
    "y": Column("m", lambda s: s.pose.y, "of the rear axle, by odometry"),
    "yaw": Column("rad", lambda s: s.pose.yaw, "heading, unwrapped"),
    "steering": Column("rad", lambda s: s.applied.steering, "what the pins carry"),
    "throttle": Column("", lambda s: s.applied.throttle, "what the pins carry, -1..1"),
    "steering_us": Column("us", lambda s: s.applied.steering_us, "pulse at the pin"),
    "throttle_us": Column("us", lambda s: s.applied.throttle_us, "pulse at the pin"),
    "limited": Column("", lambda s: _names(s.applied.limited), "why not what was asked, by |"),
    "flags": Column("", lambda s: _names(s.health.flags), "flags of the frame, by |"),
    "doubts": Column("", lambda s: _names(s.health.doubts), "what is known against it, by |"),
    "lost": Column("", lambda s: s.health.lost, "frames lost since the opening"),
    "command_steering": Column("rad", lambda s: None, "asked for until the next row, else NaN"),
    "command_throttle": Column("", lambda s: None, "asked for until the next row, else NaN"),
}
"""By name. Of two commands, or values logged, within one row the later counts."""

_WHOLE, _TEXT = ("seq", "ticks", "lost"), ("limited", "flags", "doubts")


@dataclass(frozen=True, slots=True)
class RunTable:
    """``columns``: arrays (n,) by name, in the order of ``COLUMNS``, then ``log/NAME`` each;
    ``units`` by name. ``run`` is what was read, ``hello`` who answered; ``damaged``: frames."""

    run: RunReader
    hello: Hello
    damaged: int
    columns: dict[str, NDArray[Any]]

    @property
    def units(self) -> dict[str, str]:
        """Of each column; "" where there is none, or nobody has said it."""
        return {name: COLUMNS[name].unit if name in COLUMNS else "" for name in self.columns}

    def __len__(self) -> int:
        return len(self.columns["t"])


def read_table(path: Path | str) -> RunTable:
    """A run, replayed. An element of a logged array is the column ``log/NAME[i,j]``.

    Errors: RecordingError for a file that is no run, and those of ``Car.open``.
    """
    run = RunReader(path)
    with Car.open(f"replay://{path}") as car:
        states = list(car.states())
        hello, damaged = car.hello, car.timing.damaged
    columns = {name: _column(name, [column.of(s) for s in states])
               for name, column in COLUMNS.items()}
    for command in run.commands():
        if (row := _row(columns["t"], command.t)) >= 0:
            columns["command_steering"][row] = command.steering
            columns["command_throttle"][row] = command.throttle
    for item in run.logged():
        row, value = _row(columns["t"], item.t), np.asarray(item.value)
        for index in np.ndindex(value.shape) if row >= 0 else ():
            name = f"log/{item.name}" + (f"[{','.join(map(str, index))}]" if index else "")
            if name not in columns:
                columns[name] = np.full(len(states), np.nan)
            columns[name][row] = value[index]
    return RunTable(run, hello, damaged, columns)


def _column(name: str, values: list[Any]) -> NDArray[Any]:
    if name in _TEXT:
        return np.array(values, dtype=object)
    return np.array(values, dtype=np.int64 if name in _WHOLE else np.float64)


def _row(t: FloatArray, at: float) -> int:
    """Of the newest State until then; -1 before the first."""
    return int(np.searchsorted(t, at, side="right")) - 1


def to_dataframe(path: Path | str) -> Any:
    """A run as a pandas DataFrame: a row per State, the columns of ``COLUMNS`` and of the logs.

    ``frame.attrs["units"]`` holds the unit of each column. NaN where nothing was measured,
    asked or logged in that row; ``ffill()`` holds the last. Errors: UsageError without
    pandas, RecordingError for a file that is no run.
    """
    try:
        import pandas as pd
    except ImportError as error:
        raise missing("pandas", "a DataFrame") from error
    table = read_table(path)
    frame = pd.DataFrame(table.columns, copy=False)
    frame.attrs["units"] = table.units
    return frame


def missing(package: str, what: str, extra: str = "table") -> UsageError:
    """What is said where an extra is not installed."""
    return UsageError(f"{what} needs {package}", found=f"{package} is not installed",
                      remedy=install_command(extra))
