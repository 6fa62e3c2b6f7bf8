"""Recordings of every format as ``Recording``: the DART CSV files and our own runs.

A run (MCAP) is replayed through the decoder and estimators of a live car, then averaged to 10 Hz,
the rate of the DART recordings. Steering and throttle are the commands that correspond to the
pulses at the pins.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import TypeVar

import numpy as np

from dart_hal.car import Car
from dart_hal.car.run_poses import marker_calibration, mocap_from_poses, shift_arrivals
from dart_hal.core.config import CarFiles, load_car
from dart_hal.core.config.car import CarConfig
from dart_hal.core.errors import DartHalError, RecordingError
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import ExternalPose, FloatArray, IntArray, State
from dart_hal.devices.actuation.quantiser import counter_of
from dart_hal.estimation.imu_clock import DEFAULT_GYRO_READ
from dart_hal.estimation.odometry import GYRO_FILTER_DELAY
from dart_hal.recording.dart import (
    RUN,
    AppliedCommands,
    BatteryVoltage,
    Messages,
    Note,
    Recording,
    Reference,
    read,
    with_marker_frames,
)
from dart_hal.recording.dart.model import freeze, freeze_flags, freeze_index, select_voltage
from dart_hal.recording.dart.reader import note_false_lock
from dart_hal.recording.dart.sensors import MAX_MESSAGE_GAP
from dart_hal.recording.dart.stuck import drop_stuck_sensors
from dart_hal.recording.imported import is_imported, read_imported
from dart_hal.recording.run import RunReader

# Frames of 10 ms of which one message is the mean.
FRAMES_PER_MESSAGE = 10
# The same where timing matters: one PWM frame of the commands.
FRAMES_PER_FINE_MESSAGE = 2
# Frames of the shortest run that is used: 1 s.
MIN_FRAMES = 100
# Replayed runs that are kept in memory: an hour of driving is 10 MB.
MAX_CACHED_RUNS = 32
# s by which an acceleration is older than the update of the yaw rate: its own filter of 62.5 Hz,
# and it is read before the gyro.
ACCEL_DELAY = 0.0025 + DEFAULT_GYRO_READ[0]
# Name of the note with the mass of the car: kg and its standard error.
MASS_NOTE = "mass"
# Files of a folder that are read.
SUFFIXES = (".csv", ".csv.gz", ".mcap")


Timed = TypeVar("Timed", AppliedCommands, BatteryVoltage)


@dataclass(frozen=True, slots=True)
class NamedCar:
    """Name of a car, and folder of the cars' files; None: as ``Car.open``."""

    name: str | None = None
    cars: str | None = None


def read_run(path: str | Path, every: int = FRAMES_PER_MESSAGE, *, poses: bool = True,
             car: NamedCar = NamedCar()) -> Recording:
    """Read a run as ``read_unframed``, and fit the marker frame to it if it is not calibrated."""
    return with_marker_frames([read_unframed(path, every, poses=poses, car=car)])[0]


def read_unframed(path: str | Path, every: int = FRAMES_PER_MESSAGE, *, poses: bool = True,
                  car: NamedCar = NamedCar()) -> Recording:
    """Read a run as a Recording: schema "run", 10 Hz; mocap if external poses were recorded.

    With poses, the messages are those of the published recordings: commands, yaw rate and
    acceleration at the time stamp, mean speed of the last 0.1 s, at 50 Hz. Without poses, speed,
    yaw rate, acceleration and steering are means over the period that ends at the time stamp. The
    throttle is that at the time stamp without dithering, with a message before and after each jump.

    every: frames of 10 ms per message, without poses; fewer keep finer timing.
    poses: False ignores the poses.
    car: files for a run that has none.
    Raises RecordingError for a file that is not a run or is shorter than 1 s.
    """
    path = Path(path)
    digest = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
    if path.is_file() and _is_imported(path, digest):
        return _read_imported(path, digest, every, poses, car)
    run = _replay_run(path, digest, car)
    file_notes = [Note(notice, kind="car_files") for notice in run.notices]
    lost = [Note("frames lost on the line", run.lost)] if run.lost else []
    external = mocap_from_poses(run.poses) if poses else None
    if external is not None:
        mocap, start, more = external
        frames = Note(f"{run.frames} frames at 100 Hz, every {FRAMES_PER_FINE_MESSAGE}. used")
        notes = [frames, *file_notes, *lost, *more]
        marker, latency = run.marker or (None, 0.0)
        return note_false_lock(drop_stuck_sensors(Recording(
            path, RUN, shift_arrivals(run.moments, start - latency), mocap, "ok", None, digest,
            tuple(notes), mass=_read_mass(path), marker=marker, car=run.car,
            commands=_shift_times(run.commands, start - latency),
            battery=_shift_times(run.battery, start - latency))))
    notes = [Note(f"{run.frames} frames at 100 Hz, " + (f"means of {every} used" if every > 1
                                                       else "all used")), *file_notes, *lost]
    messages = run.messages[every] if every in run.messages else _messages(
        *_states(path, car)[:2], every)
    return drop_stuck_sensors(Recording(
        path, RUN, messages, None, "ok", None, digest, tuple(notes), mass=_read_mass(path),
        span=every * SAMPLE, car=run.car, battery=run.battery))


@lru_cache(maxsize=MAX_CACHED_RUNS)
def _is_imported(path: Path, digest: str) -> bool:
    return is_imported(path)


@lru_cache(maxsize=MAX_CACHED_RUNS)
def _read_imported(path: Path, digest: str, every: int, poses: bool, car: NamedCar) -> Recording:
    """Read an imported recording once for all uses; digest: of its content."""
    named = load_car(car.name, [Path(car.cars)] if car.cars else None).config if car.name else None
    return read_imported(path, digest, every, poses=poses, car=named)


@dataclass(frozen=True, slots=True)
class _Run:
    """A replayed run.

    messages: by frames per message. moments: messages of the values at the time stamps.
    marker: marker frame and latency [s] of the poses, if calibrated. car: its car.toml.
    notices: about the files that are used. commands: by the times of their writes, None without
    any. battery: None without a voltage, or with gaps.
    """

    frames: int
    lost: int
    messages: Mapping[int, Messages]
    moments: Messages
    poses: tuple[ExternalPose, ...]
    marker: tuple[Reference, float] | None
    car: CarConfig
    notices: tuple[str, ...]
    commands: AppliedCommands | None
    battery: BatteryVoltage | None


@lru_cache(maxsize=MAX_CACHED_RUNS)
def _replay_run(path: Path, digest: str, car: NamedCar) -> _Run:
    """Replay a run once for all uses; digest: of its content."""
    states, files, notices = _states(path, car)
    t, voltage = np.array(list(RunReader(path).battery()), dtype=np.float64).reshape(-1, 2).T
    return _Run(len(states), states[-1].health.lost,
                {every: _messages(states, files, every)
                 for every in (FRAMES_PER_MESSAGE, FRAMES_PER_FINE_MESSAGE)},
                _moments(states, files), tuple(RunReader(path).poses()),
                marker_calibration(files.calibration), files.config, notices,
                _written_commands(path, files),
                select_voltage(t, voltage, states[0].t, states[-1].t))


def _written_commands(path: Path, files: CarFiles) -> AppliedCommands | None:
    """Return the commands at the times of their writes, without the dithering of the steering.

    The ESC follows the dithering of its pulses, so that of the throttle remains.
    """
    applied = list(RunReader(path).applied())
    if not applied:
        return None
    count, _ = _counts(files)
    steering = _command(np.array([a.applied.steering_us for a in applied]), files)
    return AppliedCommands(
        freeze(np.array([a.t for a in applied])),
        freeze(np.array([a.applied.throttle for a in applied])),
        freeze(np.round(remove_dithering(steering, count), 6)))


def _shift_times(series: Timed | None, start: float) -> Timed | None:
    """Return a series on the clock of a mocap that starts at ``start`` [s]."""
    return None if series is None else replace(series, t=freeze(series.t - start))


def _states(path: Path, named: NamedCar) -> tuple[list[State], CarFiles, tuple[str, ...]]:
    """Return (States, files of the car, notices about them). Raises as ``read_run``."""
    try:
        with Car.open(f"replay://{path}", car=named.name, cars=named.cars) as car:
            files = car.files
            notices = tuple(n for n in car.notices if " files of " in n)
            states = list(car.states())
    except RecordingError:
        raise
    except DartHalError as err:
        raise RecordingError(f"{path}: the run cannot be replayed", found=err.what,
                             read=str(path), remedy=err.remedy) from err
    if len(states) < MIN_FRAMES:
        raise RecordingError(f"{path}: the run is too short", found=f"{len(states)} frames",
                             expected="at least 1 s", read=str(path),
                             remedy="leave this file out")
    return states, files, notices


def finer(recording: Recording) -> Recording:
    """Read a run again at 50 Hz, for timing; return any other recording unchanged."""
    coarse = recording.span > 1.5 * FRAMES_PER_FINE_MESSAGE * SAMPLE
    if not coarse:
        return recording
    name = recording.car.name if recording.car is not None else None
    return read_run(recording.path, FRAMES_PER_FINE_MESSAGE, poses=recording.mocap is not None,
                    car=NamedCar(name))


def _read_mass(path: Path) -> tuple[float, float] | None:
    """Return (mass, standard error) [kg] as noted by the experiment; None: not noted."""
    noted = RunReader(path).metadata.get(MASS_NOTE, {})
    try:
        value, std = float(noted["kg"]), float(noted["std"])
    except (KeyError, ValueError):
        return None
    return (value, std) if 0.0 < value < np.inf and 0.0 < std < np.inf else None


def remove_dithering(command: FloatArray, count: float) -> FloatArray:
    """Return the levels (n,) of dithered commands (n,): means of stretches within one count.

    The quantiser alternates between two counts for a pulse between them; the servo follows the
    mean. count: one PCA9685 count as a share of the command.

    1. A stretch continues while the next value is within 0.75 counts of its mean so far.
    2. Each value is replaced by the mean of its stretch.
    """
    out = np.empty_like(command)
    start = 0
    for i in range(1, len(command) + 1):
        if i == len(command) or abs(command[i] - command[start:i].mean()) > 0.75 * count:
            out[start:i] = command[start:i].mean()
            start = i
    return out


def _messages(states: Sequence[State], files: CarFiles, every: int) -> Messages:
    """Return one message per ``every`` frames, and one on both sides of a jump of the throttle."""
    count, share = _counts(files)
    tau, jumps = _throttle(states, share)
    ends = _ends(len(states), every, every, jumps)

    def mean(values: Iterable[float | None]) -> FloatArray:
        table = np.array([np.nan if v is None else v for v in values], dtype=np.float64)
        return np.array([table[e + 1 - every:e + 1].mean() for e in ends])

    command = _command(mean(_steering_pulses(states)), files)
    if every == FRAMES_PER_MESSAGE:  # groups of one level; finer messages keep what the servo got
        command = remove_dithering(command, count)
    t = np.array([s.t for s in states])
    throttle = _mean_between_jumps(tau, jumps, every)
    return _messages_at(ends, t, throttle, command, _speed(states, t, every)[ends], (
        mean(_yaw_rate(states, t)),
        mean(_imu_at_midframe([s.accel_x for s in states], states, t, ACCEL_DELAY)),
        mean(_imu_at_midframe([s.accel_y for s in states], states, t, ACCEL_DELAY))))


def _moments(states: Sequence[State], files: CarFiles) -> Messages:
    """Return messages as the published recordings: values at the stamp, mean speed of 0.1 s."""
    count, share = _counts(files)
    tau, jumps = _throttle(states, share)
    ends = _ends(len(states), FRAMES_PER_FINE_MESSAGE, FRAMES_PER_MESSAGE, jumps)
    command = remove_dithering(_command(_steering_pulses(states), files), count)
    t = np.array([s.t for s in states])
    gyro, a_x, a_y = (
        _imu_at_midframe(values, states, t, latency, 0.0)[ends] for values, latency in (
            ([s.yaw_rate for s in states], GYRO_FILTER_DELAY),
            ([s.accel_x for s in states], ACCEL_DELAY),
            ([s.accel_y for s in states], ACCEL_DELAY)))
    throttle = _mean_between_jumps(tau, jumps, FRAMES_PER_FINE_MESSAGE)
    speed = _speed(states, t, FRAMES_PER_MESSAGE)
    return _messages_at(ends, t, throttle, command[ends], speed[ends], (gyro, a_x, a_y))


def _steering_pulses(states: Sequence[State]) -> FloatArray:
    """Return the servo pulses (n,) [us]. Without pulse (PULSES_OFF) the last one counts.

    Before the first pulse the first one counts.
    """
    # A pulse of 0 means none.
    pulses = np.array([s.applied.steering_us for s in states], dtype=np.float64)
    present = np.flatnonzero(pulses)
    if len(present) in (0, len(pulses)):
        return pulses
    newest = np.searchsorted(present, np.arange(len(pulses)), side="right") - 1
    return pulses[present[np.maximum(newest, 0)]]


def _counts(files: CarFiles) -> tuple[float, float]:
    """Return one count of the PCA9685 as a share of the steering's and of the throttle's span."""
    count = counter_of(files)[1]
    return count / files.config.steering.span_us, count / files.config.throttle.span_us


def _throttle(states: Sequence[State], count: float) -> tuple[FloatArray, IntArray]:
    """Return (throttle (n,), frames after which it jumps)."""
    tau = np.array([s.applied.throttle for s in states])
    return tau, np.flatnonzero(np.abs(np.diff(tau)) > 1.5 * count)


def _ends(frames: int, every: int, first: int, jumps: IntArray) -> list[int]:
    """Return the frames at which a message ends: each ``every``, and both sides of a jump."""
    return sorted({int(i) for i in (*range(first, frames, every), *jumps, *(jumps + 1))
                   if i >= first})


def _command(pulse_us: FloatArray, files: CarFiles) -> FloatArray:
    """Return the steering command in -1..1 of pulses [us]."""
    steering = files.config.steering
    return (pulse_us - steering.center_us) / (steering.direction * steering.span_us)


def _messages_at(ends: list[int], t: FloatArray, throttle: FloatArray, steering: FloatArray,
        speed: FloatArray, imu: tuple[FloatArray, FloatArray, FloatArray]) -> Messages:
    """Return messages at frames ``ends`` (m,) of a run with times t (n,) and throttle (n,)."""
    stamp, tau, (gyro, a_x, a_y) = freeze(t[ends]), freeze(throttle[ends]), imu
    return Messages(
        t=stamp, arrival=stamp, throttle=tau, throttle_raw=tau,
        segment=freeze_index(np.concatenate([[0], np.cumsum(np.diff(stamp) > MAX_MESSAGE_GAP)])),
        steering=freeze(np.round(steering, 6)), gate=freeze_flags(np.ones(len(ends))),
        speed=freeze(speed), yaw_rate=freeze(gyro), accel_x=freeze(a_x), accel_y=freeze(a_y))


def _mean_between_jumps(level: FloatArray, jumps: IntArray, every: int) -> FloatArray:
    """Return the mean (n,) of a period around each frame, never across a jump.

    This averages the dithering.
    """
    edges = [0, *(int(j) + 1 for j in jumps), len(level)]
    out = np.empty_like(level)
    for start, end in pairwise(edges):
        # Means of a sliding window by differences of the cumulative sum.
        total = np.concatenate([[0.0], np.cumsum(level[start:end])])
        at = np.arange(end - start)
        low = np.maximum(at + 1 - every // 2 - every % 2, 0)
        high = np.minimum(at + 1 + every // 2, end - start)
        out[start:end] = (total[high] - total[low]) / (high - low)
    return out


def _speed(states: Sequence[State], t: FloatArray, every: int) -> FloatArray:
    """Return the mean speed (n,) [m/s] over the last ``every`` frames: distance over time.

    Unlike ``State.speed``, which is 10 to 20 ms old and older at low speed, it has no delay.
    """
    # Travelled distance with the sign of the speed, then its difference over ``every`` frames.
    x, y = np.array([(s.pose.x, s.pose.y) for s in states]).T
    sign = np.array([np.copysign(1.0, s.speed) for s in states])
    travel = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)) * sign[1:])])
    out = np.zeros(len(t))
    out[every:] = (travel[every:] - travel[:-every]) / (t[every:] - t[:-every])
    return out


def _yaw_rate(states: Sequence[State], t: FloatArray) -> FloatArray:
    """Return the yaw rate (n,) [rad/s] in the middle of each frame; NaN without a value."""
    return _imu_at_midframe([s.yaw_rate for s in states], states, t, GYRO_FILTER_DELAY)


def _imu_at_midframe(values: Sequence[float | None], states: Sequence[State], t: FloatArray,
            latency: float, lead: float = 0.5 * SAMPLE) -> FloatArray:
    """Interpolate a channel of the IMU to the middle of each frame, (n,); NaN without a value.

    latency: age [s] of a value relative to the update of the yaw rate, to which ``imu_age``
    refers. Encoder and commands have no such age, and a model would have to explain it.
    lead: time [s] from the interpolated moment to the end of the frame.
    """
    # A sample was taken at t - age, and the value is older by the latency. Repeated samples count
    # once, then the channel is interpolated.
    value = np.array([np.nan if v is None else v for v in values], dtype=np.float64)
    age = np.array([s.health.imu_age for s in states])
    known = np.isfinite(value) & np.isfinite(age)
    if not known.any():
        return value
    taken, first = np.unique((t - age)[known], return_index=True)
    interpolated = np.interp(t - lead, taken - latency, value[known][first])
    return np.where(known, interpolated, np.nan)


def read_any(paths: str | Path | Iterable[str | Path], told: Callable[[Path], None] | None = None,
             reference: Reference | None = None, car: NamedCar = NamedCar()
             ) -> tuple[list[Recording], list[tuple[str, str]]]:
    """Read files and folders in name order, of any format, with their marker frames.

    reference: a marker frame for all; None: as ``with_marker_frames`` finds it.
    car: files for runs that have none.
    told: called with each file before it is read.
    Returns (recordings, excluded files as (file, reason)).
    """
    recordings, skipped = read_all_unframed(paths, told, car)
    return with_marker_frames(recordings, reference), skipped


def read_all_unframed(paths: str | Path | Iterable[str | Path],
                      on_file: Callable[[Path], None] | None = None, car: NamedCar = NamedCar()
                      ) -> tuple[list[Recording], list[tuple[str, str]]]:
    """Read as ``read_any`` without marker frames, for a caller that pools several calls.

    A file of a folder that cannot be used is excluded and listed; one that is named itself
    raises RecordingError, as does a folder without any recording. A copy of a file, which would
    count twice, is excluded too.
    """
    recordings: list[Recording] = []
    skipped: list[tuple[str, str]] = []
    resolved: set[Path] = set()
    contents: dict[str, Path] = {}
    for entry in map(Path, [paths] if isinstance(paths, str | Path) else paths):
        files = _in_folder(entry) if entry.is_dir() else [entry]
        usable = 0
        for file in files:
            usable += 1
            if file.resolve() in resolved:
                continue
            resolved.add(file.resolve())
            if on_file is not None:
                on_file(file)
            try:
                found = _read(file, car)
                first = contents.setdefault(found.sha256, file)
                if first is file:
                    recordings.append(found)
                else:
                    skipped.append((str(file), f"a copy of {first}"))
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


def _read(file: Path, car: NamedCar) -> Recording:
    return read_unframed(file, car=car) if file.suffix == ".mcap" else read(file)
