"""Maps: which column of a log is which quantity, in which unit, with which sign."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Literal

import msgspec

from dart_hal.core.config.parse import parse
from dart_hal.core.config.quantity import FileTable, Quantity
from dart_hal.core.errors import ConfigError
from dart_hal.core.text_file import decode_text

MAP_SCHEMA = "dart-hal/import/1"
# Factors to SI units; "1" for a number without unit.
UNITS = {
    "1": 1.0, "%": 0.01,
    "m": 1.0, "cm": 1e-2, "mm": 1e-3,
    "rad": 1.0, "deg": 0.017453292519943295,
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9,
    "m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "km/h": 1.0 / 3.6,
    "rad/s": 1.0, "deg/s": 0.017453292519943295, "rpm": 0.10471975511965977,
    "m/s2": 1.0, "g": 9.80665, "mg": 9.80665e-3,
    "V": 1.0, "mV": 1e-3,
}

LENGTH_UNITS = ("1", "m", "cm", "mm")
ACCELERATION_UNITS = ("1", "m/s2", "g", "mg")
# Units of each key. A command may be of any kind, and "1" needs a scale.
UNITS_BY_KEY = {
    ("poses", "x"): LENGTH_UNITS, ("poses", "y"): LENGTH_UNITS,
    ("poses", "yaw"): ("1", "rad", "deg"),
    ("encoder", "speed"): ("1", "m/s", "cm/s", "mm/s", "km/h", "rad/s", "deg/s", "rpm"),
    ("gyro", "yaw_rate"): ("1", "rad/s", "deg/s", "rpm"),
    ("accelerometer", "x"): ACCELERATION_UNITS, ("accelerometer", "y"): ACCELERATION_UNITS,
    ("battery", "voltage"): ("1", "V", "mV"),
}


class Column(FileTable, frozen=True, kw_only=True):
    """A column of a log. Its value in SI units is sign x scale x unit x (column - zero).

    column: name, or path in a message of a bag. zero is in the unit of the column.
    """

    column: str
    unit: str = "1"
    sign: Literal[-1, 1] = 1
    scale: float = 1.0
    zero: float = 0.0


class StreamColumns(FileTable, frozen=True, kw_only=True):
    """Keys of every stream.

    table: file or topic, * and ? as in file names; needed if there are several tables. time: column
    of the times of measurement. changes: column whose change marks a new row, where a log repeats
    values. delay [s]: time by which the stamps are later than those of the other streams.
    """

    table: str | None = None
    time: str | Column | None = None
    changes: str | None = None
    delay: float = 0.0


class Frame(FileTable, frozen=True, kw_only=True):
    """Position [m] of the tracked frame before and left of the rear axle, and its yaw [rad]."""

    lx: Quantity
    ly: Quantity
    theta: Quantity


class PoseColumns(StreamColumns, frozen=True, kw_only=True):
    """Poses. frame: of the tracked point on the car; without it, it is fitted."""

    x: str | Column
    y: str | Column
    yaw: str | Column
    frame: Frame | None = None


class SteeringColumns(StreamColumns, frozen=True, kw_only=True):
    """Steering commands, + to the left.

    kind "command": -1..1. kind "angle": road-wheel angle; full_scale [rad] is the angle of the
    command 1. kind "pulse": width of the servo pulse; zero and full_scale [s] are its middle and
    its half range.
    """

    value: str | Column
    kind: Literal["command", "angle", "pulse"] = "command"
    full_scale: float | None = None


class ThrottleColumns(StreamColumns, frozen=True, kw_only=True):
    """Throttle commands.

    kind "duty": -1..1. kind "speed": speed of a speed loop; limit [m/s]: largest speed that the
    controller admits. kind "pulse": width of the ESC pulse; zero and full_scale [s] are its neutral
    and its half range. gate: column that is 0 where the command does not reach the motor.
    """

    value: str | Column
    kind: Literal["duty", "speed", "pulse"] = "duty"
    full_scale: float | None = None
    gate: str | None = None
    limit: float | None = None


class EncoderColumns(StreamColumns, frozen=True, kw_only=True):
    """Speed of the wheels or of the motor. A motor speed needs its scale."""

    speed: str | Column


class GyroColumns(StreamColumns, frozen=True, kw_only=True):
    """Yaw rate, + to the left."""

    yaw_rate: str | Column


class AccelerometerColumns(StreamColumns, frozen=True, kw_only=True):
    """Acceleration forward and to the left, with gravity."""

    x: str | Column
    y: str | Column


class BatteryColumns(StreamColumns, frozen=True, kw_only=True):
    """Voltage of the battery. Logs without the table are imported without it."""

    voltage: str | Column


class ImportMap(FileTable, frozen=True, kw_only=True):
    """A map of a log. table and time are those of every stream that states none."""

    schema: str = MAP_SCHEMA
    name: str
    table: str | None = None
    time: str | Column | None = None
    steering: SteeringColumns
    throttle: ThrottleColumns
    poses: PoseColumns | None = None
    encoder: EncoderColumns | None = None
    gyro: GyroColumns | None = None
    accelerometer: AccelerometerColumns | None = None
    battery: BatteryColumns | None = None


# Tables of a map, in the order in which they are written.
MAP_STREAMS = ("poses", "steering", "throttle", "encoder", "gyro", "accelerometer", "battery")


def list_shipped_maps() -> dict[str, str]:
    """Return the text of each shipped map by its name."""
    folder = files("dart_lab.importing") / "maps"
    return {entry.name.removesuffix(".toml"): entry.read_text(encoding="utf-8")
            for entry in sorted(folder.iterdir(), key=lambda e: e.name)
            if entry.name.endswith(".toml")}


def load_map(source: str) -> tuple[ImportMap, str]:
    """Return (map, its text) of a TOML file or of the name of a shipped map.

    Raises ConfigError for an unknown name, an unreadable file, or a key that is not known.
    """
    shipped = list_shipped_maps()
    if source in shipped:
        return parse_map(shipped[source], f"map {source}"), shipped[source]
    try:
        text = decode_text(Path(source).read_bytes())
    except (OSError, ValueError) as why:
        raise ConfigError(f"{source}: no such map", found=str(why), read=source,
                          expected=f"a TOML file, or one of {', '.join(shipped)}",
                          remedy="dart-hal data import FILES --guess proposes one") from why
    return parse_map(text, source), text


def parse_map(text: str, origin: str) -> ImportMap:
    """Return the map of a text. Raises ConfigError, which names ``origin`` and the key."""
    made = parse(text, ImportMap, origin)
    for name in MAP_STREAMS:
        stream = getattr(made, name)
        for key in () if stream is None else stream.__struct_fields__:
            column = getattr(stream, key)
            allowed = UNITS_BY_KEY.get((name, key), tuple(UNITS))
            if isinstance(column, Column) and column.unit not in allowed:
                raise ConfigError(f"{origin}: {name}.{key} has an unknown unit", read=origin,
                                  found=repr(column.unit), expected=", ".join(allowed),
                                  remedy="choose one of these, and give the rest as scale")
    for name, stream in (("steering", made.steering), ("throttle", made.throttle)):
        needs = stream.kind in ("angle", "pulse")
        full = stream.full_scale
        if needs and (full is None or full <= 0.0):
            raise ConfigError(
                f"{origin}: {name}.full_scale is missing for kind {stream.kind!r}", read=origin,
                found=repr(full), expected="the value [rad or s] of the command 1, above 0",
                remedy="the largest steering angle of the car, or half the range of the pulses")
    limit = made.throttle.limit
    if limit is not None and (made.throttle.kind != "speed" or limit <= 0.0):
        raise ConfigError(
            f"{origin}: throttle.limit has no meaning here", read=origin,
            found=f"limit = {limit!r}, kind = {made.throttle.kind!r}",
            expected='a speed [m/s] above 0, with kind "speed"',
            remedy='delete limit, or write kind = "speed" into [throttle]')
    return made


def column_of(entry: str | Column) -> Column:
    """Return an entry of a map as a Column."""
    return msgspec.convert({"column": entry}, Column) if isinstance(entry, str) else entry
