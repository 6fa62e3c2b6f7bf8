"""Apply a map to tables: streams in SI units, sorted, without repeated rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fnmatch import fnmatchcase

import numpy as np

from dart_hal.core.config.model import MOTOR_VOLTAGE_RANGE
from dart_hal.core.errors import RecordingError
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart.model import Reference
from dart_hal.recording.dart.ranges import MAX_PAUSE
from dart_hal.recording.imported import MEASUREMENTS, ImportedData, Stream

from .maps import UNITS, Column, Frame, ImportMap, StreamColumns, column_of
from .tables import Table, quote_names

# Rows with an empty cell that are dropped; more are an error.
MAX_BAD_SHARE = 0.05
# s: rows that are out of order by less are sorted; a larger step back is another run.
MAX_DISORDER = 0.1
# Median periods, below which the unit of the time is wrong.
MAX_PAUSE_PERIODS = 1000.0
# s between two rows, in the median: slower sensors determine nothing, faster ones are in no car.
MIN_PERIOD = 5e-5
MAX_PERIOD = 1.0
# Rows of a stream below which nothing can be done with it.
MIN_ROWS = 30
# The voltage is interpolated between two readings.
MIN_BATTERY_ROWS = 2
# Streams of which a row holds until the next one, and may be rare.
HELD_STREAMS = ("steering", "throttle", "battery")
# Commands beyond -1..1, by rounding.
COMMAND_TOLERANCE = 1.0 + 1e-6
# rad: no small car steers its wheels by more.
MAX_LOCK = 1.2
# Columns of a bag that are tried where a map states no time.
TIME_COLUMNS = ("stamp", "arrival")

Columns = Mapping[str, str | Column]
# Reads the columns of a stream, by its name and its part of the map.
ReadStream = Callable[[str, StreamColumns, Columns], Stream]


def convert_tables(tables: Sequence[Table], mapping: ImportMap, text: str = "",
                   car: str | None = None) -> ImportedData:
    """Convert tables to streams in SI units.

    text: of the map; car: text of the car.toml; both are stored in the file.
    Raises RecordingError, which states what was found, what was expected and what to write in the
    map: a column or topic that is not there, text in a number, too many empty cells, a time that
    steps back, commands beyond -1..1, streams that do not overlap.
    """
    changes = [f"{table.name}: the last line, {table.cut_line}, which is cut off"
               for table in tables if table.cut_line]
    used: dict[str, str] = {}

    def read(name: str, stream: StreamColumns, columns: Columns) -> Stream:
        table = _find_table(tables, mapping, name, stream)
        used[table.source[0] or table.name] = table.source[1]
        return _read_stream(table, mapping, name, stream, columns, changes)

    streams: dict[str, Stream] = {}
    if mapping.poses is not None:
        place = mapping.poses
        streams["poses"] = read("poses", place, {"x": place.x, "y": place.y, "yaw": place.yaw})
    streams["commands"] = _merge(_read_steering(mapping, read), _read_throttle(mapping, read))
    if mapping.encoder is not None:
        streams["encoder"] = read("encoder", mapping.encoder, {"speed": mapping.encoder.speed})
    if mapping.gyro is not None:
        streams["gyro"] = read("gyro", mapping.gyro, {"yaw_rate": mapping.gyro.yaw_rate})
    if mapping.accelerometer is not None:
        axes = mapping.accelerometer
        streams["accelerometer"] = read("accelerometer", axes, {"x": axes.x, "y": axes.y})
    if len(streams) < 2:
        raise RecordingError("the map has no measurement, only commands", found=mapping.name,
                             expected=f"at least one of {', '.join(MEASUREMENTS)}",
                             remedy="add the table [poses], or [encoder] and [gyro], to the map")
    battery = mapping.battery
    if battery is not None and _has_table(tables, battery.table or mapping.table, changes):
        streams["battery"] = read("battery", battery, {"voltage": battery.voltage})
        _check_voltage(streams["battery"].values)
    _check_overlap(streams)
    frame = mapping.poses.frame if mapping.poses is not None else None
    return ImportedData(
        streams, "speed" if mapping.throttle.kind == "speed" else "duty",
        mapping.steering.full_scale if mapping.steering.kind == "angle" else None,
        None if frame is None else _make_reference(frame), car,
        {"map": mapping.name, "map_text": text, "sources": used, "changes": changes})


def _make_reference(frame: Frame) -> Reference:
    return Reference(frame.lx.value, frame.theta.value, frame.ly.value, "map of the import",
                     (frame.lx.std, frame.theta.std, frame.ly.std))


def _read_steering(mapping: ImportMap, read: ReadStream) -> Stream:
    m = mapping.steering
    stream = read("steering", m, {"value": m.value})
    if m.kind == "angle" and m.full_scale is not None:
        _check_angles(stream.values, m.full_scale)
    values = stream.values if m.full_scale is None else stream.values / m.full_scale
    _check_commands("steering", values, m.kind, m.full_scale)
    return Stream(stream.t, values)


def _read_throttle(mapping: ImportMap, read: ReadStream) -> Stream:
    m = mapping.throttle
    columns: dict[str, str | Column] = {"value": m.value} | ({"gate": m.gate} if m.gate else {})
    stream = read("throttle", m, columns)
    values = stream.values[:, :1] if m.full_scale is None else stream.values[:, :1] / m.full_scale
    if m.kind != "speed":
        _check_commands("throttle", values, m.kind, m.full_scale)
    if m.limit is not None:
        values = np.clip(values, -m.limit, m.limit)
    if m.gate:
        values = np.where(stream.values[:, 1:] != 0.0, values, 0.0)
    return Stream(stream.t, values)


def _has_table(tables: Sequence[Table], pattern: str | None, changes: list[str]) -> bool:
    """Return whether a table has the voltage, which not every car of a shipped map logs."""
    if pattern is None or any(fnmatchcase(table.name, pattern) for table in tables):
        return True
    changes.append(f"battery: there is no table {pattern!r}, so the recording has no voltage")
    return False


def _check_voltage(values: FloatArray) -> None:
    """Raise RecordingError for the voltage of no battery of a small car."""
    middle = float(np.median(values))
    low, high = MOTOR_VOLTAGE_RANGE
    if not low <= middle <= high:
        milli = low <= 1e-3 * middle <= high
        raise RecordingError(
            "[battery] is no voltage of a small car", found=f"median {middle:.4g} V",
            expected=f"{low:g} to {high:g} V", likely="a voltage in mV" if milli
            else "the voltage behind a divider, a charge in per cent, or another quantity",
            remedy='state unit = "mV" of voltage in [battery]' if milli
            else "state its scale, or name another column; without the table [battery] the log is "
            "imported without a voltage")


def _check_angles(angles: FloatArray, full_scale: float) -> None:
    worst = float(np.max(np.abs(angles)))
    if worst > COMMAND_TOLERANCE * full_scale:
        raise RecordingError(
            "the steering angles exceed full_scale",
            found=f"largest angle {worst:.4g} rad, full_scale = {full_scale:g}",
            expected="full_scale of at least the largest angle",
            likely="a map of a car with a smaller lock" if worst < MAX_LOCK
            else "an angle in degrees, or of the steering wheel",
            remedy=f"copy the map and write full_scale = {math.ceil(1e4 * worst) / 1e4:g} or more "
                   "into [steering]"
            if worst < MAX_LOCK else 'state unit = "deg" or the scale of the value of [steering]')


def _check_commands(name: str, values: FloatArray, kind: str, full_scale: float | None) -> None:
    worst = float(np.max(np.abs(values)))
    if worst > COMMAND_TOLERANCE:
        raise RecordingError(
            f"the {name} commands leave -1..1", found=f"largest magnitude {worst:.6g}",
            expected="at most 1 after unit, scale and full_scale",
            likely="another unit: per cent, degrees, microseconds, or an angle or a speed",
            remedy=f"state unit, kind and full_scale of [{name}] in the map (kind is {kind!r}"
            + (f", and full_scale = {full_scale:g} divides it: leave it out for a command)"
               if full_scale else ")"))


def _merge(steering: Stream, throttle: Stream) -> Stream:
    """Return both commands at the union of their times, each held until its next value."""
    t = np.union1d(steering.t, throttle.t)
    t = t[t >= max(steering.t[0], throttle.t[0])]
    if not len(t):
        raise _disjoint({"steering": steering, "throttle": throttle})
    held = [s.values[np.searchsorted(s.t, t, side="right") - 1, 0] for s in (steering, throttle)]
    return Stream(t, np.stack(held, axis=1))


def _find_table(tables: Sequence[Table], mapping: ImportMap, name: str, stream: StreamColumns
                ) -> Table:
    """Return the table that a stream names, or the only one."""
    pattern = stream.table or mapping.table
    names = [table.name for table in tables]
    found = (list(tables) if pattern is None else
             [table for table in tables if fnmatchcase(table.name, pattern)])
    if len(found) == 1:
        return found[0]
    raise RecordingError(
        f"[{name}] of the map fits {len(found) or 'no'} table{'s' if len(found) != 1 else ''}",
        found=f"{'no table named' if pattern is None else repr(pattern)}; there are "
              f"{quote_names(names)}", expected="one file or topic",
        remedy=f'write table = "..." into [{name}] of the map; import runs one by one')


def _read_stream(table: Table, mapping: ImportMap, name: str, stream: StreamColumns,
                 columns: Columns, changes: list[str]) -> Stream:
    """Read the columns of one stream; ``changes`` receives what was dropped."""
    time = stream.time or mapping.time or next(
        (column for column in TIME_COLUMNS if column in table.columns), None)
    if time is None:
        raise RecordingError(f"[{name}] of the map states no time", found=table.name,
                             expected=f"one of {quote_names(table.columns)}",
                             remedy=f'write time = "..." into the map or into [{name}]')
    t = _read_column(table, column_of(time), name, "time") - stream.delay
    values = [_read_column(table, column_of(c), name, key) for key, c in columns.items()]
    rows = np.stack(values, axis=1)
    fresh = np.ones(len(t), dtype=np.bool_)
    if stream.changes is not None:
        mark = _read_column(table, column_of(stream.changes), name, "changes")
        fresh[1:] = np.diff(mark) != 0.0
        # Rows before the first sample of the source, and those that repeat a sample.
        fresh[:1] = mark[:1] != 0.0
        changes.append(f"{name}: {int((~fresh).sum())} rows that repeat {stream.changes!r}")
    t = t[fresh]
    rows = rows[fresh]
    if name == "poses":
        yaw = rows[:, 2]
        good = np.isfinite(yaw)
        rows[good, 2] = np.unwrap(yaw[good])
    good = np.isfinite(t) & np.isfinite(rows).all(axis=1)
    bad = int((~good).sum())
    # A log may fill the column of a slow sensor in some rows only; the voltage is one.
    if bad > MAX_BAD_SHARE * len(t) and name != "battery":
        cells = {column_of(time).column: int((~np.isfinite(t)).sum())} | {
            column_of(c).column: int((~np.isfinite(values)).sum())
            for c, values in zip(columns.values(), rows.T, strict=True)}
        raise RecordingError(
            f"[{name}]: {bad} of {len(t)} rows have an empty or non-finite cell",
            found=f"{table.name}: " + ", ".join(f"{count} in {column!r}"
                                                for column, count in cells.items() if count),
            expected=f"at most {MAX_BAD_SHARE:.0%}", read=table.source[0],
            likely="a column that is filled in some rows only",
            remedy=f'write changes = "..." into [{name}], or export each source by itself')
    if bad:
        changes.append(f"{name}: {bad} rows with an empty or non-finite cell")
    return _order(t[good], rows[good], name, table, changes)


def _order(t: FloatArray, rows: FloatArray, name: str, table: Table, changes: list[str]) -> Stream:
    """Sort rows that are slightly out of order, drop repeated times, refuse a step back."""
    back = np.maximum.accumulate(t) - t if len(t) else t
    if len(t) and float(back.max()) > MAX_DISORDER:
        row = int(np.argmax(back))
        raise RecordingError(
            f"[{name}]: the time steps back by {back[row]:.6g} s", read=table.source[0],
            found=f"row {row + 1} of {table.name}", expected="a time that increases",
            likely="two runs in one file, or a clock that was set",
            remedy="split the file there, and import the parts one by one")
    if np.any(back > 0.0):
        changes.append(f"{name}: {int(np.sum(back > 0.0))} rows up to {float(back.max()):.3g} s "
                       "out of order, sorted")
    order = np.argsort(t, kind="stable")
    t = t[order]
    # A grid over a clock that was set would fill the memory.
    pause = np.diff(t, prepend=t[:1])
    if len(t) and float(pause.max()) > max(MAX_PAUSE, MAX_PAUSE_PERIODS * float(np.median(pause))):
        row = int(np.argmax(pause))
        raise RecordingError(
            f"[{name}]: the time steps forward by {pause[row]:.6g} s", read=table.source[0],
            found=f"row {order[row] + 1} of {table.name}",
            expected=f"steps of at most {MAX_PAUSE:g} s",
            likely="a clock that was set after the start, or two runs in one file",
            remedy="remove the rows before it, or import the parts one by one")
    rows = rows[order]
    fresh = np.concatenate([[True], np.diff(t) > 0.0])[:len(t)]
    if not fresh.all():
        changes.append(f"{name}: {int((~fresh).sum())} rows with the time of the row before")
    least = MIN_BATTERY_ROWS if name == "battery" else MIN_ROWS
    if int(fresh.sum()) < least:
        raise RecordingError(f"[{name}]: too few rows", found=f"{int(fresh.sum())} rows with a "
                             f"time of their own in {table.name}", read=table.source[0],
                             expected=f"at least {least}", likely="a map for another file, or a "
                             "time column that does not advance",
                             remedy=f"check time and changes of [{name}] in the map")
    made = Stream(t[fresh], rows[fresh])
    _check_time_unit(made.period, name, table)
    return made


def _check_time_unit(period: float, name: str, table: Table) -> None:
    """Refuse rows at a rate that no log has; see HELD_STREAMS."""
    if period < MIN_PERIOD or (period > MAX_PERIOD and name not in HELD_STREAMS):
        unit = next((unit for unit in ("ms", "us", "ns")
                     if MIN_PERIOD <= UNITS[unit] * period <= MAX_PERIOD), "s")
        raise RecordingError(
            f"[{name}]: the rows are {period:.3g} s apart", read=table.source[0],
            found=f"{1.0 / period:.3g} rows a second in {table.name}",
            expected=f"{1.0 / MAX_PERIOD:g} to {1.0 / MIN_PERIOD:g}", likely="another unit of time",
            remedy=f'write time = {{column = "...", unit = "{unit}"}} into the map, or into '
                   f"[{name}]")


def _read_column(table: Table, column: Column, name: str, key: str) -> FloatArray:
    """Return a column in SI units. Raises RecordingError for one that is absent or text."""
    if column.column in table.text_columns:
        line, cell = table.text_columns[column.column]
        raise RecordingError(
            f"{table.name}: line {line}, column {column.column!r} is not a number",
            found=repr(cell), expected=f"a number for {name}.{key}", read=table.source[0],
            remedy=f"repair that line, or name another column for {name}.{key} in the map")
    if column.column not in table.columns:
        raise RecordingError(
            f"{table.name} has no column {column.column!r}, which the map names for {name}.{key}",
            found=quote_names(table.columns), expected=repr(column.column), read=table.source[0],
            likely="a map for another file", remedy=f"name the column of {name}.{key} in the map; "
            "dart-hal data import FILES --guess proposes a map")
    raw = table.columns[column.column]
    return np.asarray(column.sign * column.scale * UNITS[column.unit] * (raw - column.zero))


def _check_overlap(streams: Mapping[str, Stream]) -> None:
    start = max(float(s.t[0]) for s in streams.values())
    end = min(float(s.t[-1]) for s in streams.values())
    longest = max(float(s.t[-1] - s.t[0]) for s in streams.values())
    if longest < 1.0:
        raise RecordingError("the log is too short", found=f"{longest:.2f} s",
                             expected="at least 1 s, for a fit a minute",
                             likely="a cut log, or another unit of time",
                             remedy="import a longer log, or state the unit of time in the map")
    if end - start < 1.0:
        raise _disjoint(streams)


def _disjoint(streams: Mapping[str, Stream]) -> RecordingError:
    zero = min(float(s.t[0]) for s in streams.values())
    return RecordingError(
        "the streams do not cover the same time: they have two clocks",
        found="; ".join(f"{name} from {s.t[0] - zero:.2f} to {s.t[-1] - zero:.2f} s"
                        for name, s in streams.items()),
        expected="at least 1 s that all streams share",
        likely="one stream counts from its start, or in another unit of time",
        remedy="name another time column in the map, state its unit, or its offset as delay [s]")
