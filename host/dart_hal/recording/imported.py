"""Recordings of other systems as one MCAP file: poses, commands and sensors in SI units.

``dart-hal data import`` writes these files. Each stream is a channel of
std_msgs/Float64MultiArray, a message is one row, and its stamp is the time of measurement. The
attachment "import" has the map and the sources. A file of this kind is read as a ``Recording`` of
the schema of a run, so every verb on recordings accepts it. It has no bytes of a Nano, so it
cannot be replayed.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from dart_hal.core.config.car import CarConfig, parse_config
from dart_hal.core.errors import RecordingError
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.recording import cdr
from dart_hal.recording.dart.mocap import EPOCH_FROM
from dart_hal.recording.dart.mocap import mocap as read_mocap
from dart_hal.recording.dart.model import (
    MAX_BATTERY_GAP,
    RUN,
    AppliedCommands,
    BatteryVoltage,
    Messages,
    Mocap,
    Note,
    Recording,
    Reference,
    freeze,
    freeze_flags,
    freeze_index,
    select_voltage,
)
from dart_hal.recording.dart.reader import MIN_MOCAP_ROWS, note_false_lock
from dart_hal.recording.dart.schema import MOCAP_COLUMNS
from dart_hal.recording.dart.sensors import MAX_MESSAGE_GAP
from dart_hal.recording.dart.steering_sign import steering_note
from dart_hal.recording.dart.stuck import drop_stuck_sensors
from dart_hal.recording.items import IMPORT_NOTE, JSON, TOML, ZERO
from dart_hal.recording.mcap_records import McapFile, read_mcap
from dart_hal.recording.run_file import make_mcap_writer
from dart_hal.recording.schemas import definition
from dart_hal.vehicle.parameters import MOTOR_FORMS

CAR_FILE = "car.toml"
KIND = "std_msgs/msg/Float64MultiArray"
# Columns of each stream. Steering is -1..1, + to the left; throttle is -1..1, or the commanded
# speed [m/s] of a speed loop; the rest is in m, rad, m/s, rad/s, m/s2 and V.
STREAM_COLUMNS = {
    "poses": ("x", "y", "yaw"),
    "commands": ("steering", "throttle"),
    "encoder": ("speed",),
    "gyro": ("yaw_rate",),
    "accelerometer": ("accel_x", "accel_y"),
    "battery": ("voltage",),
}
SENSORS = ("encoder", "gyro", "accelerometer")
# Streams without which nothing is known of the motion; of the others, "commands" is needed as well.
MEASUREMENTS = ("poses", *SENSORS)
# Time [s] over which a message has the mean speed, as in the published recordings.
SPEED_MEAN_TIME = 0.1
# s between two messages: 50 Hz, as of a run with poses; a slower sensor decides.
MIN_MESSAGE_STEP = 0.02
# Sensors above this rate [Hz] are averaged; of a slower one each sample is a mean of its own.
MIN_AVERAGED_RATE = 20.0


@dataclass(frozen=True, slots=True)
class Stream:
    """Samples of one source: t (n,) s, strictly increasing; values (n, k)."""

    t: FloatArray
    values: FloatArray

    @property
    def period(self) -> float:
        """Median time [s] from sample to sample."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else np.inf


@dataclass(frozen=True, slots=True)
class ImportedData:
    """Content of an imported file.

    streams: by name, see STREAM_COLUMNS; "commands" and at least one of MEASUREMENTS. drive: one of
    MOTOR_FORMS. steering_scale: steering angle [rad] of the command 1, as the map states it; None:
    the log has no angle. marker: pose of the tracked frame on the car; None: unknown, to be fitted.
    facts: name of the map, its text, sources with their SHA-256, changes to the data.
    """

    streams: Mapping[str, Stream]
    drive: str = "duty"
    steering_scale: float | None = None
    marker: Reference | None = None
    car: str | None = None
    facts: Mapping[str, object] = field(default_factory=dict)


def write_imported(data: ImportedData, path: Path) -> None:
    """Write an imported file; nothing remains of it if this fails. Raises OSError."""
    partial = path.with_name(path.name + ".part")
    first = min(float(s.t[0]) for s in data.streams.values())
    # Stamps of a file are not negative.
    shift = max(-math.floor(first), 0)
    zero = round(1e9 * (first + shift))
    marker = data.marker
    note = {**data.facts, "drive": data.drive, "steering_scale": data.steering_scale,
            "marker": None if marker is None else marker.to_json()}
    try:
        with partial.open("wb") as file:
            writer = make_mcap_writer(file)
            kind = writer.register_schema(KIND, "ros2msg", definition(KIND))
            writer.add_attachment(zero, zero, IMPORT_NOTE, JSON, json.dumps(note).encode())
            if data.car is not None:
                writer.add_attachment(zero, zero, CAR_FILE, TOML, data.car.encode())
            for name, stream in data.streams.items():
                channel = writer.register_channel(f"/import/{name}", "cdr", kind,
                                                  {ZERO: str(zero)})
                stamps = np.rint(1e9 * (stream.t + shift)).astype(np.int64).tolist()
                for ns, row in zip(stamps, stream.values, strict=True):
                    writer.add_message(channel, ns, cdr.encode_numbers(row), ns)
            writer.finish()  # type: ignore[no-untyped-call]
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def is_imported(path: Path) -> bool:
    """Return whether a file was written by ``write_imported``. Raises RecordingError."""
    return IMPORT_NOTE in read_mcap(path).metadata


def read_data(path: Path) -> ImportedData:
    """Read an imported file. Raises RecordingError for another or a damaged one."""
    found = read_mcap(path)
    note = found.metadata.get(IMPORT_NOTE)
    if note is None:
        raise RecordingError(f"{path}: is no imported recording", read=str(path),
                             found="no attachment 'import'", expected="a file of dart-hal data "
                             "import", remedy="dart-hal data import FILES --out RUN.mcap")
    try:
        facts = dict(note)
        drive = str(facts.pop("drive"))
        scale = facts.pop("steering_scale")
        frame: object = facts.pop("marker")
        streams = _read_streams(found)
        if (drive not in MOTOR_FORMS or "commands" not in streams
                or not set(streams) & set(MEASUREMENTS)):
            raise ValueError(f"drive {drive}, streams {', '.join(streams) or 'none'}")
        return ImportedData(streams, drive, None if scale is None else float(scale),
                            None if frame is None else _read_marker(frame),
                            found.metadata.get("files", {}).get(CAR_FILE), facts)
    except (LookupError, TypeError, ValueError) as why:
        raise RecordingError(f"{path}: the imported recording is damaged", found=repr(why),
                             read=str(path), remedy="import it again") from why


def _read_streams(found: McapFile) -> dict[str, Stream]:
    """Read the rows of all channels; times [s] in the clock of the file."""
    rows: dict[str, list[tuple[float, FloatArray]]] = {}
    zero = min(found.zeros.values(), default=0)
    for message in found.messages():
        name = message.topic.removeprefix("/import/")
        if name in STREAM_COLUMNS:
            rows.setdefault(name, []).append((1e-9 * message.ns, cdr.decode_numbers(message.data)))
    start = 1e-9 * zero
    return {name: Stream(start + np.array([t for t, _ in rows[name]]),
                         np.array([values for _, values in rows[name]]))
            for name in STREAM_COLUMNS if name in rows}


def _read_marker(frame: object) -> Reference:
    if not isinstance(frame, dict):
        raise TypeError(f"marker frame {frame!r}")
    std = frame["std"]
    errors = None if std is None else tuple(
        np.nan if std[key] is None else float(std[key]) for key in ("lx", "theta", "ly"))
    return Reference(float(frame["lx"]), float(frame["theta"]), float(frame["ly"]),
                     str(frame["source"]), errors)  # type: ignore[arg-type]


def read_imported(path: Path, digest: str, frames: int, *, poses: bool = True,
                  car: CarConfig | None = None) -> Recording:
    """Read an imported file as a Recording of the schema of a run.

    With poses, the messages have the values at their stamps and the mean speed of the last 0.1 s.
    Without, they are means over ``frames`` samples of 10 ms, or the period of a slower sensor.

    digest: SHA-256 of the file. car: named car, for a file that holds none.
    Raises RecordingError for a damaged file and for less than 1 s with commands and sensors.
    """
    data = read_data(path)
    if data.car is not None:
        car = parse_config(data.car, f"{path}: {CAR_FILE}", recorded=True)
    mocap, start, notes = _read_poses(data) if poses else (None, None, [])
    notes = [Note(f"imported with the map {data.facts.get('map', 'unknown')}", kind="imported"),
             *notes]
    zero = float(data.streams["commands"].t[0]) if start is None else start
    # The slowest sensor decides the time between messages: no sample is used twice.
    sensors, skipped = _select_sensors(data)
    notes += skipped
    step = max([MIN_MESSAGE_STEP if mocap is not None else frames * SAMPLE,
                *(s.period for s in sensors.values())])
    span = 0.0 if mocap is not None else step
    messages = _make_messages(path, data.streams["commands"], sensors, zero, step, span)
    encoder = "none"
    if "encoder" in sensors:
        encoder = "ok" if np.any(sensors["encoder"].values) else "zero"
    commands = data.streams["commands"]
    battery = _read_battery(data, zero, messages)
    if battery is None and "battery" in data.streams:
        notes.append(Note("the voltage of the battery is not used: more than "
                          f"{MAX_BATTERY_GAP:g} s pass without a reading", kind="slow_sensor"))
    made = Recording(
        path, RUN, messages, mocap, encoder, None, digest, tuple(notes), marker=data.marker,
        span=span, car=car, drive=data.drive, steering_scale=data.steering_scale, battery=battery,
        commands=None if mocap is None else AppliedCommands(
            freeze(commands.t - zero), freeze(commands.values[:, 1]),
            freeze(commands.values[:, 0])))
    made = drop_stuck_sensors(made)
    if mocap is not None and "encoder" in sensors:
        made = note_false_lock(made)
    return replace(made, notes=(*made.notes, *steering_note(made)))


def _read_battery(data: ImportedData, zero: float, messages: Messages) -> BatteryVoltage | None:
    """Return the voltage from the first to the last message; zero [s]: start of their clock."""
    if "battery" not in data.streams:
        return None
    stream = data.streams["battery"]
    return select_voltage(stream.t - zero, stream.values[:, 0], float(messages.arrival[0]),
                          float(messages.arrival[-1]))


def _read_poses(data: ImportedData) -> tuple[Mocap | None, float | None, list[Note]]:
    """Return (motion capture, time [s] of its first row, notes); None without enough poses."""
    stream = data.streams.get("poses")
    if stream is None or len(stream.t) < MIN_MOCAP_ROWS:
        return None, None, []
    rows = (stream.t, *stream.values.T)
    mocap, _, notes = read_mocap(dict(zip(MOCAP_COLUMNS, rows, strict=True)))
    start = float(stream.t[0])
    return replace(mocap, epoch=start if start > EPOCH_FROM else None), start, notes


def _select_sensors(data: ImportedData) -> tuple[dict[str, Stream], list[Note]]:
    """Return the on-board sensors that are fast enough for messages, and notes on the others."""
    chosen: dict[str, Stream] = {}
    notes = []
    for name in SENSORS:
        stream = data.streams.get(name)
        if stream is None:
            continue
        if stream.period < MAX_MESSAGE_GAP:
            chosen[name] = stream
        else:
            notes.append(Note(f"{name}: a sample each {stream.period:.2f} s, not used; at least "
                              f"one in {MAX_MESSAGE_GAP:g} s is needed", kind="slow_sensor"))
    return chosen, notes


def _make_messages(path: Path, commands: Stream, sensors: Mapping[str, Stream], zero: float,
                   step: float, span: float) -> Messages:
    """Return messages each ``step`` [s]; span [s]: of their means, 0: values at the stamp.

    1. The stamps cover the time with commands and with every sensor, without gaps of a sensor.
    2. The speed is the mean of the last 0.1 s, or of the span.
    3. Gyro and accelerometer are means of one step around the stamp, or of the span before it.
    """
    present = (commands, *sensors.values())
    start = max(float(s.t[0]) for s in present) + max(span, SPEED_MEAN_TIME)
    end = min(float(s.t[-1]) for s in present)
    t = np.arange(start, end, step)
    for stream in sensors.values():
        t = t[_is_covered(t, stream.t)]
    if len(t) < 1.0 / step:
        raise RecordingError(
            f"{path}: less than 1 s has commands and every sensor", read=str(path),
            found=", ".join(f"{name} {s.t[0] - zero:.1f} to {s.t[-1] - zero:.1f} s"
                            for name, s in (("commands", commands), *sensors.items())),
            expected="streams of the same drive", likely="clocks with an offset",
            remedy="state the offset in the map, as delay [s] of a stream, and import again")
    speed = _average(sensors.get("encoder"), t, max(span, SPEED_MEAN_TIME), 0.0)[:, 0]
    width, shift = (span, 0.0) if span else (step, 0.5 * step)
    yaw_rate = _average(sensors.get("gyro"), t, width, shift)[:, 0]
    accel = _average(sensors.get("accelerometer"), t, width, shift, columns=2)
    # A command is held until the next one.
    row = np.maximum(np.searchsorted(commands.t, t, side="right") - 1, 0)
    throttle = freeze(commands.values[row, 1])
    stamp = freeze(t - zero)
    gap = np.diff(stamp) > max(MAX_MESSAGE_GAP, 1.5 * step)
    steering = commands.values[row, 0] if not span else _average(commands, t, span, 0.0)[:, 0]
    return Messages(
        t=stamp, arrival=stamp, segment=freeze_index(np.concatenate([[0], np.cumsum(gap)])),
        throttle=throttle, throttle_raw=throttle, steering=freeze(np.round(steering, 6)),
        gate=freeze_flags(np.ones(len(t))), speed=freeze(speed), yaw_rate=freeze(yaw_rate),
        accel_x=freeze(accel[:, 0]), accel_y=freeze(accel[:, 1]))


def _is_covered(t: FloatArray, stamps: FloatArray) -> BoolArray:
    """Return which times (n,) are not in a gap of the samples."""
    after = np.clip(np.searchsorted(stamps, t), 1, len(stamps) - 1)
    return np.asarray(stamps[after] - stamps[after - 1] < MAX_MESSAGE_GAP)


def _average(stream: Stream | None, t: FloatArray, width: float, shift: float,
             columns: int = 1) -> FloatArray:
    """Return the means (n, k) over [t + shift - width, t + shift]; NaN without a stream.

    The mean is the difference of the integral of the linear interpolation. Of a sensor below
    MIN_AVERAGED_RATE each sample is a mean already, so the newest one at t is returned.
    """
    if stream is None:
        return np.full((len(t), columns), np.nan)
    if stream.period * MIN_AVERAGED_RATE > 1.0:
        # Slow sensor: the newest sample before t.
        newest = np.maximum(np.searchsorted(stream.t, t, side="right") - 1, 0)
        return np.asarray(stream.values[newest])
    zero = stream.t[0]
    at = stream.t - zero
    out = []
    for values in stream.values.T:
        # Integral of the linear interpolation up to each sample, by trapezoids.
        area = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(at) * (values[1:] + values[:-1]))])

        def integral(x: FloatArray, values: FloatArray = values, area: FloatArray = area
                     ) -> FloatArray:
            x = np.clip(x, 0.0, at[-1])
            low = np.clip(np.searchsorted(at, x, side="right") - 1, 0, len(at) - 2)
            # Area up to the sample before x, and the trapezoid from there to x.
            height = np.interp(x, at, values)
            return np.asarray(area[low] + 0.5 * (x - at[low]) * (values[low] + height))

        end = np.clip(t + shift - zero, 0.0, at[-1])
        begin = np.clip(t + shift - width - zero, 0.0, at[-1])
        length = np.maximum(end - begin, 1e-9)
        out.append((integral(end) - integral(begin)) / length)
    return np.stack(out, axis=1)
