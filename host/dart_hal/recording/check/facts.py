"""Figures of a recording, without judgement."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.recording.dart.model import Recording

from .motion import RecordedMotion, windows

Range = tuple[float, float]
# Travel per turn of the drive shaft of DART [m]: 2 pi * gear ratio 11/39 * wheel radius 0.0233 m.
SHAFT_TURN = 0.0412918
# Time over which the recorder counts edges [s].
ENCODER_COUNT_TIME = 0.1
# Largest relative deviation of a quantum from that of a whole number of marks.
MAX_MARKS_ERROR = 0.015
NAME_FORMATS = ((re.compile(r"(\d\d_\d\d_\d{4}_\d\d_\d\d_\d\d)"), "%m_%d_%Y_%H_%M_%S"),
           (re.compile(r"(\d{4}-\d\d-\d\d-\d\d-\d\d-\d\d)"), "%Y-%m-%d-%H-%M-%S"),
           (re.compile(r"(\d{8}-\d{6})"), "%Y%m%d-%H%M%S"))


@dataclass(frozen=True, slots=True)
class MocapFacts:
    """Motion capture: rows, usual step [s], what of it is bad, speeds of good samples.

    gaps above 0.05 s (or two steps, at 20 Hz) and the longest [s]; outliers in
    rows; false_lock and bad as shares of the time; wraps: turns of the yaw
    through +-pi. v_x [m/s] and yaw_rate [rad/s]: range over the good samples.
    """

    rows: int
    step: float
    gaps: int
    longest_gap: float
    outliers: int
    false_lock: float
    bad: float
    wraps: int
    v_x: Range | None
    yaw_rate: Range | None
    windows: int


@dataclass(frozen=True, slots=True)
class RecordingFacts:
    """One recording in figures. Ranges are (least, most), None: no such sensor.

    date in ISO 8601, date_from "mocap clock (UTC)" or "file name (local time)";
    duration [s] without gaps; rows of the table, messages, their usual step [s];
    throttle while the gate was open; speed of the drive shaft [m/s]; yaw_rate of the gyro
    [rad/s]; marks: encoder edges per shaft turn that
    the quantum corresponds to, if the car is known; rounded: sensor values have 2 decimals.
    """

    date: str | None
    date_from: str | None
    duration: float
    rows: int
    messages: int
    step: float
    throttle: Range | None
    steering: Range
    speed: Range | None
    yaw_rate: Range | None
    marks: int | None
    rounded: bool
    mocap: MocapFacts | None


def facts(m: RecordedMotion, false_lock: float = 0.0) -> RecordingFacts:
    """Compute the figures of a recording; false_lock: share of the time, from the marker grid."""
    recording = m.recording
    messages = recording.messages
    date, source = _date(recording)
    step = np.diff(messages.t)
    return RecordingFacts(
        date=date, date_from=source, duration=recording.duration, rows=recording.rows,
        messages=len(messages), step=float(np.median(step)) if len(step) else float("nan"),
        throttle=_range(messages.throttle_raw[messages.gate]),
        steering=_range(messages.steering) or (0.0, 0.0), speed=_range(messages.speed),
        yaw_rate=_range(messages.yaw_rate),
        marks=marks(recording.quantum, _shaft_turn(recording)),
        rounded=_is_rounded(recording), mocap=_mocap(m, false_lock))


def _shaft_turn(recording: Recording) -> float | None:
    """Return the travel [m] per turn of the encoder's shaft; None if the car is not known."""
    if recording.car is not None:
        encoder = recording.car.encoder
        metres = encoder.metres_per_edge
        return metres.value * encoder.edges_per_rev if metres is not None else None
    return SHAFT_TURN if recording.published else None


def marks(quantum: float | None, shaft_turn: float | None = SHAFT_TURN) -> int | None:
    """Return the edges per turn of the drive shaft, None if they are no whole number.

    quantum [m/s per count], shaft_turn: travel per turn [m]. One edge per count time T is
    quantum = shaft_turn / (edges T).
    """
    if not quantum or not shaft_turn:
        return None
    turns = shaft_turn / ENCODER_COUNT_TIME / quantum
    whole = round(turns)
    return whole if whole > 0 and abs(turns / whole - 1.0) < MAX_MARKS_ERROR else None


def _range(values: FloatArray) -> Range | None:
    values = values[np.isfinite(values)]
    return (float(values.min()), float(values.max())) if len(values) else None


def _is_rounded(recording: Recording) -> bool:
    """Return whether the values of the sensors are multiples of 0.01."""
    values = recording.messages.yaw_rate
    values = values[np.isfinite(values) & (values != 0.0)]
    return len(values) > 10 and bool(np.all(np.abs(values * 100 - np.round(values * 100)) < 1e-4))


def _date(recording: Recording) -> tuple[str | None, str | None]:
    when = recording.when
    if when is not None:
        return when.isoformat(timespec="seconds"), "mocap clock (UTC)"
    named = named_time(recording.path)
    return (None, None) if named is None else (named.isoformat(), "file name (local time)")


def named_time(path: Path) -> datetime | None:
    """Return the start of a recording by its name (local time, no zone); None without a date."""
    for pattern, form in NAME_FORMATS:
        found = pattern.search(path.name)
        try:
            if found:
                return datetime.strptime(found[1], form)
        except ValueError:
            continue
    return None


def _mocap(m: RecordedMotion, false_lock: float) -> MocapFacts | None:
    pose = m.recording.mocap
    if pose is None:
        return None
    step = np.diff(pose.t)
    usual = float(np.median(step)) if len(step) else float("nan")
    gaps = step[step > max(0.05, 2.0 * usual)]
    turns = np.floor((pose.yaw[~pose.outlier] + np.pi) / (2.0 * np.pi))
    v_x = yaw_rate = None
    if m.grid is not None:
        v_x = _range(m.grid.v_x[m.good])
        yaw_rate = _range(m.grid.omega[m.good])
    return MocapFacts(
        rows=len(pose), step=usual, gaps=len(gaps),
        longest_gap=float(gaps.max()) if len(gaps) else 0.0, outliers=int(pose.outlier.sum()),
        false_lock=false_lock, bad=float(m.grid.bad.mean()) if m.grid is not None else 1.0,
        wraps=int(np.count_nonzero(np.diff(turns))), v_x=v_x, yaw_rate=yaw_rate,
        windows=len(windows(m.grid)) if m.grid is not None else 0)
