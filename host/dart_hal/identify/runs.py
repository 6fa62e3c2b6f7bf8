"""Recordings of every kind as ``Recording``: the DART CSV files and our own runs.

A run (MCAP) is replayed through the same decoder and estimators as a live
car, then thinned to 10 Hz like the messages of the DART recordings; steering
and throttle are the commands that the pulses on the pins stand for.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from dart_hal.actuation.quantiser import NOMINAL_HZ, count_us, prescale_for
from dart_hal.car import Car
from dart_hal.config import CarFiles
from dart_hal.errors import DartHalError, RecordingError
from dart_hal.recording.dart import Messages, Note, Recording, read
from dart_hal.recording.dart.model import freeze, freeze_flags, freeze_index
from dart_hal.recording.dart.sensors import GAP
from dart_hal.types import FloatArray, State

EVERY = 10  # frames of 10 ms
RUN = "run"  # Recording.schema of our own runs
SUFFIXES = (".csv", ".csv.gz", ".mcap")


def read_run(path: str | Path) -> Recording:
    """A run as a Recording: schema "run", no mocap, 10 Hz.

    Errors: RecordingError for a file that is no run or holds less than 1 s.
    """
    path = Path(path)
    try:
        with Car.open(f"replay://{path}") as car:
            files = car.files
            states = list(car.states())
    except RecordingError:
        raise
    except DartHalError as err:
        raise RecordingError(f"{path}: the run cannot be replayed", found=err.what,
                             read=str(path), remedy=err.remedy) from err
    if len(states) < 10 * EVERY:
        raise RecordingError(f"{path}: the run is too short", found=f"{len(states)} frames",
                             expected="at least 1 s", read=str(path),
                             remedy="leave this file out")
    lost = states[-1].health.lost
    notes = [Note(f"{len(states)} frames at 100 Hz, means of {EVERY} used")]
    notes += [Note("frames lost on the line", lost)] if lost else []
    return Recording(path, RUN, _messages(states, files), None, "ok", None,
                     hashlib.sha256(path.read_bytes()).hexdigest(), tuple(notes))


def undithered(command: FloatArray, count: float) -> FloatArray:
    """Held levels out of dithered ones, (n,): the mean of every stretch within a count.

    The quantiser alternates between two counts to hold a pulse between them;
    the servo holds its mean. count: one PCA9685 count as a share of the command.
    """
    out = np.empty_like(command)
    start = 0
    for i in range(1, len(command) + 1):
        if i == len(command) or abs(command[i] - command[start:i].mean()) > 0.75 * count:
            out[start:i] = command[start:i].mean()
            start = i
    return out


def _messages(states: Sequence[State], files: CarFiles) -> Messages:
    n = len(states) // EVERY * EVERY
    used = states[:n]

    def mean(values: Iterable[float | None]) -> np.ndarray:
        table = np.array([np.nan if v is None else v for v in values], dtype=np.float64)
        return np.asarray(table.reshape(-1, EVERY).mean(axis=1))

    def last(values: Iterable[float]) -> np.ndarray:
        return np.array(list(values)).reshape(-1, EVERY)[:, -1]

    steering, throttle = files.config.steering, files.config.throttle
    span = steering.direction * steering.span_us
    command = (mean(s.applied.steering_us for s in used) - steering.center_us) / span
    clock, pwm = files.oscillator_hz, files.config.pwm
    count = count_us(prescale_for(pwm.frequency), clock.value if clock else NOMINAL_HZ)
    command = undithered(command, count / steering.span_us)
    tau = (last(s.applied.throttle_us for s in used) - files.neutral_us) / throttle.span_us
    t = last(s.t for s in used)
    segment = np.concatenate([[0], np.cumsum(np.diff(t) > GAP)])
    return Messages(
        t=freeze(t), arrival=freeze(t), segment=freeze_index(segment),
        throttle=freeze(tau), throttle_raw=freeze(tau), steering=freeze(np.round(command, 6)),
        gate=freeze_flags(np.ones(len(t))), speed=freeze(mean(s.speed for s in used)),
        yaw_rate=freeze(mean(s.yaw_rate for s in used)),
        accel_x=freeze(mean(s.accel_x for s in used)),
        accel_y=freeze(mean(s.accel_y for s in used)))


def read_any(paths: Iterable[str | Path]) -> tuple[list[Recording], list[tuple[str, str]]]:
    """(recordings, skipped as (file, reason)) of files and folders, in name order.

    In a folder a file that cannot be used is skipped and listed; a file named
    by itself is refused. Errors: RecordingError, also for a folder without any.
    """
    recordings: list[Recording] = []
    skipped: list[tuple[str, str]] = []
    seen: set[Path] = set()
    for entry in map(Path, paths):
        files = _in_folder(entry) if entry.is_dir() else [entry]
        usable = 0
        for file in files:
            usable += 1
            if file.resolve() in seen:
                continue
            seen.add(file.resolve())
            try:
                recordings.append(_read(file))
            except RecordingError as err:
                if not entry.is_dir():
                    raise
                usable -= 1
                skipped.append((str(file), err.what.removeprefix(f"{file}: ")))
        if not usable:
            raise RecordingError(
                f"{entry}: no usable recording in this folder", read=str(entry),
                found=f"{len(files)} file(s), none usable" if files else "no *.csv and no *.mcap",
                expected="DART CSV files or MCAP runs",
                remedy="check the path; $DART_DATA is the folder of recordings")
    return recordings, skipped


def _in_folder(folder: Path) -> list[Path]:
    return sorted(f for f in folder.rglob("*") if f.is_file() and f.name.endswith(SUFFIXES))


def _read(file: Path) -> Recording:
    return read_run(file) if file.suffix == ".mcap" else read(file)
