"""Recordings of every kind as ``Recording``: the DART CSV files and our own runs.

A run (MCAP) is replayed through the same decoder and estimators as a live
car, then thinned to 10 Hz like the messages of the DART recordings; steering
and throttle are the commands that the pulses on the pins stand for.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from dart_hal.car import Car
from dart_hal.car.run_poses import calibrated, mocap_of, on_clock
from dart_hal.core.config import CarFiles
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
    Messages,
    Note,
    Recording,
    Reference,
    read,
    with_marker_frames,
)
from dart_hal.recording.dart.model import freeze, freeze_flags, freeze_index
from dart_hal.recording.dart.reader import note_false_lock
from dart_hal.recording.dart.sensors import GAP
from dart_hal.recording.run import RunReader

EVERY = 10  # frames of 10 ms
FINE = 2  # where timing is the question: the PWM frame of the commands
SHORTEST = 100  # frames: 1 s
KEPT = 32  # runs whose messages are kept: an hour of driving is 10 MB
ACCEL_DELAY = 0.0025 + DEFAULT_GYRO_READ[0]
"""s by which an acceleration is older than the yaw rate's update: its own filter of 62.5 Hz, and
it is read before the gyro."""
MASS = "mass"  # metadata of a run: kg and std, as weighed
SUFFIXES = (".csv", ".csv.gz", ".mcap")


@dataclass(frozen=True, slots=True)
class NamedCar:
    """A car by its name, and the folder of the cars' files; None: as ``Car.open`` takes it."""

    name: str | None = None
    cars: str | None = None


def read_run(path: str | Path, every: int = EVERY, *, poses: bool = True,
             car: NamedCar = NamedCar()) -> Recording:
    """As ``read_unframed``, with the marker frame fitted to this run where it is not calibrated."""
    return with_marker_frames([read_unframed(path, every, poses=poses, car=car)])[0]


def read_unframed(path: str | Path, every: int = EVERY, *, poses: bool = True,
                  car: NamedCar = NamedCar()) -> Recording:
    """A run as a Recording: schema "run", 10 Hz; mocap where poses from outside were recorded.

    With poses, the messages are what the published recordings have beside theirs:
    commands, yaw rate and acceleration of the moment, speed of the last 0.1 s, at 50 Hz.
    poses False: as if there were none. Without:
    every: frames of 10 ms that one message is made of; fewer keep finer timing.
    Speed, yaw rate, acceleration and steering are means over the step that ends
    at a message's stamp; the throttle is that of the moment, free of dithering,
    with one more message before and after each jump. car: whose files count where the run
    holds none.
    Errors: RecordingError for a file that is no run or holds less than 1 s.
    """
    path = Path(path)
    digest = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
    run = _replayed(path, digest, car)
    said = [Note(notice, kind="car_files") for notice in run.notices]
    lost = [Note("frames lost on the line", run.lost)] if run.lost else []
    seen = mocap_of(run.poses) if poses else None
    if seen is not None:
        mocap, start, more = seen
        notes = [Note(f"{run.frames} frames at 100 Hz, every {FINE}. used"), *said, *lost,
                 *more]
        marker, late = run.marker or (None, 0.0)
        return note_false_lock(Recording(
            path, RUN, on_clock(run.moments, start - late), mocap, "ok", None, digest,
            tuple(notes), mass=_weighed(path), marker=marker, car=run.car,
            commands=_on_clock(run.commands, start - late)))
    notes = [Note(f"{run.frames} frames at 100 Hz, " + (f"means of {every} used" if every > 1
                                                       else "all used")), *said, *lost]
    messages = run.messages[every] if every in run.messages else _messages(
        *_states(path, car)[:2], every)
    return Recording(path, RUN, messages, None, "ok", None, digest, tuple(notes),
                     mass=_weighed(path), span=every * SAMPLE, car=run.car)


@dataclass(frozen=True, slots=True)
class _Run:
    """What is kept of a run: messages by the frames that each is made of, and of the moment;
    marker: where it sat on the car, and latency [s] of its poses, where that was calibrated;
    car: its car file; notices: about the files that were used; commands: at the car's times of
    their writes, None where a run has none."""

    frames: int
    lost: int
    messages: Mapping[int, Messages]
    moments: Messages
    poses: tuple[ExternalPose, ...]
    marker: tuple[Reference, float] | None
    car: CarConfig
    notices: tuple[str, ...]
    commands: AppliedCommands | None


@lru_cache(maxsize=KEPT)
def _replayed(path: Path, digest: str, car: NamedCar) -> _Run:
    """A run, replayed once for all that is asked of it; digest: of its content."""
    states, files, notices = _states(path, car)
    return _Run(len(states), states[-1].health.lost,
                {every: _messages(states, files, every) for every in (EVERY, FINE)},
                _moments(states, files), tuple(RunReader(path).poses()),
                calibrated(files.calibration), files.config, notices, _written(path, files))


def _written(path: Path, files: CarFiles) -> AppliedCommands | None:
    """Commands at the times of their writes, without the dithering of the steering.

    The ESC follows the dithering of its pulses, so that of the throttle stays.
    """
    applied = list(RunReader(path).applied())
    if not applied:
        return None
    count, _ = _counts(files)
    steering = _command(np.array([a.applied.steering_us for a in applied]), files)
    return AppliedCommands(
        freeze(np.array([a.t for a in applied])),
        freeze(np.array([a.applied.throttle for a in applied])),
        freeze(np.round(undithered(steering, count), 6)))


def _on_clock(commands: AppliedCommands | None, start: float) -> AppliedCommands | None:
    """Commands on the clock of a mocap that starts at ``start`` [s]."""
    return None if commands is None else replace(commands, t=freeze(commands.t - start))


def _states(path: Path, named: NamedCar) -> tuple[list[State], CarFiles, tuple[str, ...]]:
    """(states, files of the car, notices about them). Errors: as ``read_run``."""
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
    if len(states) < SHORTEST:
        raise RecordingError(f"{path}: the run is too short", found=f"{len(states)} frames",
                             expected="at least 1 s", read=str(path),
                             remedy="leave this file out")
    return states, files, notices


def finer(recording: Recording) -> Recording:
    """A run read anew at 50 Hz, for timing; any other recording as it is."""
    coarse = recording.span > 1.5 * FINE * SAMPLE
    if not coarse:
        return recording
    name = recording.car.name if recording.car is not None else None
    return read_run(recording.path, FINE, poses=recording.mocap is not None, car=NamedCar(name))


def _weighed(path: Path) -> tuple[float, float] | None:
    """(kg, one sigma) as noted by the experiment; None where nobody has weighed."""
    noted = RunReader(path).metadata.get(MASS, {})
    try:
        value, std = float(noted["kg"]), float(noted["std"])
    except (KeyError, ValueError):
        return None
    return (value, std) if 0.0 < value < np.inf and 0.0 < std < np.inf else None


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


def _messages(states: Sequence[State], files: CarFiles, every: int) -> Messages:
    """One message each ``every`` frames, and one on both sides of a jump of the throttle."""
    count, share = _counts(files)
    tau, jumps = _throttle(states, share)
    ends = _ends(len(states), every, every, jumps)

    def mean(values: Iterable[float | None]) -> FloatArray:
        table = np.array([np.nan if v is None else v for v in values], dtype=np.float64)
        return np.array([table[e + 1 - every:e + 1].mean() for e in ends])

    command = _command(mean(_steering_pulses(states)), files)
    if every == EVERY:  # groups of one level; finer messages keep what the servo got
        command = undithered(command, count)
    t = np.array([s.t for s in states])
    return _at(ends, t, _around(tau, jumps, every), command, _speed(states, t, every)[ends], (
        mean(_yaw_rate(states, t)),
        mean(_sensed([s.accel_x for s in states], states, t, ACCEL_DELAY)),
        mean(_sensed([s.accel_y for s in states], states, t, ACCEL_DELAY))))


def _moments(states: Sequence[State], files: CarFiles) -> Messages:
    """As the published recordings: of the moment of the stamp, the speed of the last 0.1 s."""
    count, share = _counts(files)
    tau, jumps = _throttle(states, share)
    ends = _ends(len(states), FINE, EVERY, jumps)
    command = undithered(_command(_steering_pulses(states), files), count)
    t = np.array([s.t for s in states])
    gyro, a_x, a_y = (_sensed(values, states, t, latency, 0.0)[ends] for values, latency in (
        ([s.yaw_rate for s in states], GYRO_FILTER_DELAY),
        ([s.accel_x for s in states], ACCEL_DELAY), ([s.accel_y for s in states], ACCEL_DELAY)))
    return _at(ends, t, _around(tau, jumps, FINE), command[ends], _speed(states, t, EVERY)[ends],
               (gyro, a_x, a_y))


def _steering_pulses(states: Sequence[State]) -> FloatArray:
    """Pulses of the servo [us]; where it got none (PULSES_OFF) it stays where the last one led,
    before the first one where that leads."""
    pulses = np.array([s.applied.steering_us for s in states], dtype=np.float64)
    present = np.flatnonzero(pulses)
    if len(present) in (0, len(pulses)):
        return pulses
    newest = np.searchsorted(present, np.arange(len(pulses)), side="right") - 1
    return pulses[present[np.maximum(newest, 0)]]


def _counts(files: CarFiles) -> tuple[float, float]:
    """One count of the PCA9685 as a share of the steering's and of the throttle's span."""
    count = counter_of(files)[1]
    return count / files.config.steering.span_us, count / files.config.throttle.span_us


def _throttle(states: Sequence[State], count: float) -> tuple[FloatArray, IntArray]:
    """(throttle (n,), frames behind which it jumps)."""
    tau = np.array([s.applied.throttle for s in states])
    return tau, np.flatnonzero(np.abs(np.diff(tau)) > 1.5 * count)


def _ends(frames: int, every: int, first: int, jumps: IntArray) -> list[int]:
    """Frames at which a message ends: each ``every``, and both sides of a jump."""
    return sorted({int(i) for i in (*range(first, frames, every), *jumps, *(jumps + 1))
                   if i >= first})


def _command(pulse_us: FloatArray, files: CarFiles) -> FloatArray:
    steering = files.config.steering
    return (pulse_us - steering.center_us) / (steering.direction * steering.span_us)


def _at(ends: list[int], t: FloatArray, throttle: FloatArray, steering: FloatArray,
        speed: FloatArray, imu: tuple[FloatArray, FloatArray, FloatArray]) -> Messages:
    """Messages at frames ``ends`` (m,) of a run with times t (n,) and throttle (n,)."""
    stamp, tau, (gyro, a_x, a_y) = freeze(t[ends]), freeze(throttle[ends]), imu
    return Messages(
        t=stamp, arrival=stamp, throttle=tau, throttle_raw=tau,
        segment=freeze_index(np.concatenate([[0], np.cumsum(np.diff(stamp) > GAP)])),
        steering=freeze(np.round(steering, 6)), gate=freeze_flags(np.ones(len(ends))),
        speed=freeze(speed), yaw_rate=freeze(gyro), accel_x=freeze(a_x), accel_y=freeze(a_y))


def _around(level: FloatArray, jumps: IntArray, every: int) -> FloatArray:
    """Mean (n,) of a step around each frame, never across a jump: the dithering is averaged."""
    edges = [0, *(int(j) + 1 for j in jumps), len(level)]
    out = np.empty_like(level)
    for start, end in pairwise(edges):
        total = np.concatenate([[0.0], np.cumsum(level[start:end])])
        at = np.arange(end - start)
        low = np.maximum(at + 1 - every // 2 - every % 2, 0)
        high = np.minimum(at + 1 + every // 2, end - start)
        out[start:end] = (total[high] - total[low]) / (high - low)
    return out


def _speed(states: Sequence[State], t: FloatArray, every: int) -> FloatArray:
    """Mean speed (n,) m/s over the last ``every`` frames: travel between two, free of any lag.

    ``State.speed`` is 10 to 20 ms old, the more the slower the wheel turns.
    """
    x, y = np.array([(s.pose.x, s.pose.y) for s in states]).T
    sign = np.array([np.copysign(1.0, s.speed) for s in states])
    travel = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)) * sign[1:])])
    out = np.zeros(len(t))
    out[every:] = (travel[every:] - travel[:-every]) / (t[every:] - t[:-every])
    return out


def _yaw_rate(states: Sequence[State], t: FloatArray) -> FloatArray:
    """Yaw rate (n,) rad/s in the middle of the frame that ends at t; NaN where there is none."""
    return _sensed([s.yaw_rate for s in states], states, t, GYRO_FILTER_DELAY)


def _sensed(values: Sequence[float | None], states: Sequence[State], t: FloatArray,
            latency: float, before: float = 0.5 * SAMPLE) -> FloatArray:
    """What the IMU tells (n,) of the middle of each frame; NaN where it tells nothing.

    before [s]: by how much the moment asked for precedes the end of the frame.

    latency: by what a value is older than the yaw rate's update [s], from which ``imu_age``
    counts. Encoder and commands have no such age; left in, a model has to explain it.
    """
    value = np.array([np.nan if v is None else v for v in values], dtype=np.float64)
    age = np.array([s.health.imu_age for s in states])
    known = np.isfinite(value) & np.isfinite(age)
    if not known.any():
        return value
    taken, first = np.unique((t - age)[known], return_index=True)
    told = np.interp(t - before, taken - latency, value[known][first])
    return np.where(known, told, np.nan)


def read_any(paths: Iterable[str | Path], told: Callable[[Path], None] | None = None,
             reference: Reference | None = None, car: NamedCar = NamedCar()
             ) -> tuple[list[Recording], list[tuple[str, str]]]:
    """(recordings, skipped as (file, reason)) of files and folders, in name order.

    The recordings carry their marker frames, see ``with_marker_frames``; reference: a given one.
    car: whose files count for runs that hold none.
    told: of each file, before it is read.
    """
    recordings, skipped = read_all_unframed(paths, told, car)
    return with_marker_frames(recordings, reference), skipped


def read_all_unframed(paths: Iterable[str | Path], told: Callable[[Path], None] | None = None,
                      car: NamedCar = NamedCar()
                      ) -> tuple[list[Recording], list[tuple[str, str]]]:
    """As ``read_any`` without marker frames, for a caller that pools several calls.

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
            if told is not None:
                told(file)
            try:
                recordings.append(_read(file, car))
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
