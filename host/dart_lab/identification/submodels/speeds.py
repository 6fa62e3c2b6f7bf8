"""Straight driving out of recordings: speed samples in runs, and the throttle before them.

Speed is the mocap's where there is one, else the encoder's. Left out: turning
(the front wheels brake by l_r omega^2, and the sub-models know no turning),
standstill (static friction is no sub-model either), braking, bad mocap.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.recording.dart import Grid, Recording, Reference, grid, rolling_reference
from dart_lab.identification.prediction.commands import Command, step_of, throttle_of
from dart_lab.identification.submodels.report import Ledger

MAX_YAW_RATE = 0.5  # rad/s; the steered wheels brake by l_r omega^2 = 0.024 m/s2 there
MAX_STEERING = 0.25  # of the command
MIN_SPEED = 0.08  # m/s, and two counts of the encoder
MAX_ACCEL = 4.0  # m/s2; harder launches spin the wheels, and a late command costs too much
SETTLE = 0.5  # s before a sample in which the throttle must not have been negative
EVERY = 10  # samples of the mocap grid: 0.1 s, the span of its derivative
MIN_RUN = 4  # samples in a row
TAIL = 8  # samples after a run in which the model may still be moving while the car stands
BLOCK = 2.0  # s; what disturbs a drive is forgotten after it: errors of blocks are independent
WINDOW = 0.1  # s, over which the encoder counts


@dataclass(frozen=True, slots=True)
class Kernel:
    """What a speed sensor reads: sum of weight (j,) [1/s] times the way until t + offset."""

    offset: FloatArray
    weight: FloatArray


def _kernel_mocap(half: int) -> Kernel:
    i = np.arange(-half, half + 1, dtype=np.float64)
    return Kernel(i * SAMPLE, i / float(i @ i) / SAMPLE)


def _kernel_mean(window: float) -> Kernel:
    return Kernel(np.array([-window, 0.0]), np.array([-1.0, 1.0]) / window)


MOCAP, MOCAP_SLOW = _kernel_mocap(7), _kernel_mocap(12)


@dataclass(frozen=True, slots=True)
class Speeds:
    """Straight driving of one recording: t (n,) s, v (n,) m/s, run (n,): samples in a row.

    tail (n,): samples after the end of a run, where the car is slow or stands. Where
    a coast-down ends must not hang on the measured speed: cars that happen to be
    pushed roll longer, and would count for more than those that are held back.
    """

    name: str
    t: FloatArray
    v: FloatArray
    run: IntArray
    tail: BoolArray
    throttle: Command
    kernel: Kernel
    source: str

    def __len__(self) -> int:
        return len(self.t)

    def only(self, rows: IntArray, run: IntArray | None = None) -> Speeds:
        """The samples ``rows``, with other run numbers (len(rows),) if given."""
        return replace(self, t=self.t[rows], v=self.v[rows], tail=self.tail[rows],
                       run=self.run[rows] if run is None else run)


def mocap_grid(recording: Recording, reference: Reference | None) -> Grid | None:
    """The grid for speed and yaw rate, or None without mocap; its v_y may be that of another point.

    Errors: RecordingError as ``grid``.
    """
    if recording.mocap is None:
        return None
    return grid(recording, reference or rolling_reference(recording))


def speeds_of(recording: Recording, reference: Reference | None, ledger: Ledger) -> Speeds | None:
    """Straight driving of one recording; None when there is none, said in the ledger."""
    m = recording.messages
    if recording.mocap is None and recording.encoder in ("dead", "none", "zero"):
        what = ("the car never moved" if recording.encoder == "zero"
                else "no speed: encoder dead, no mocap")
        ledger.add(recording.name, 0, len(m), [what])
        return None
    try:
        motion = mocap_grid(recording, reference)
    except RecordingError as err:
        if recording.encoder != "ok":
            ledger.add(recording.name, 0, len(m), [err.what])
            return None
        motion = None
    found = _from_encoder(recording) if motion is None else _from_mocap(recording, motion)
    keep = np.flatnonzero(found.run >= 0)
    used = int((~found.tail[keep]).sum())
    said = [f"speed from the {found.source}"]
    said += [] if len(keep) else [f"no straight driving (|yaw rate| < {MAX_YAW_RATE} rad/s, "
                                  f"|steering| < {MAX_STEERING}, throttle >= 0)"]
    ledger.add(recording.name, used, len(found) - used, said)
    return found.only(keep) if len(keep) else None


def _from_encoder(recording: Recording) -> Speeds:
    m = recording.messages
    least = max(MIN_SPEED, 2.0 * (recording.quantum or 0.0) - 0.015)
    moves = np.isfinite(m.speed) & (m.speed >= least)
    near = ~moves
    # the window of a first and of a last sample may hold a part of the standstill
    moves = moves & ~np.append(False, near[:-1]) & ~np.append(near[1:], False)
    straight = (np.abs(m.yaw_rate) < MAX_YAW_RATE) & (np.abs(m.steering) < MAX_STEERING)
    usable = (straight & np.isfinite(m.speed) & ~_braked(m.t, m.throttle, m.t)
              & ~_launch(m.t, m.speed))
    run, tail = _runs(moves & usable, usable, np.diff(m.segment) != 0)
    return Speeds(recording.name, m.t, m.speed, run, tail, throttle_of(recording, m.t),
                  _kernel_mean(_window(recording)), "encoder")


def _window(recording: Recording) -> float:
    """Span [s] of a speed value: 0.1 s, where it is a mean the step from message to message."""
    return step_of(recording) if recording.of_means else WINDOW


def _from_mocap(recording: Recording, g: Grid) -> Speeds:
    slow = recording.mocap is not None and float(np.median(np.diff(recording.mocap.t))) > 0.03
    t, v = g.t[::EVERY], g.v_x[::EVERY]
    good = ~np.maximum.reduceat(g.bad, np.arange(0, len(g), EVERY))
    turning = np.maximum.reduceat(np.abs(g.omega), np.arange(0, len(g), EVERY))
    usable = (good & (turning < MAX_YAW_RATE) & (np.abs(g.steering[::EVERY]) < MAX_STEERING)
              & ~_braked(recording.messages.arrival, recording.messages.throttle, t)
              & ~_launch(t, v))
    run, tail = _runs(usable & (v > MIN_SPEED), usable, np.zeros(len(t) - 1, dtype=bool))
    held = throttle_of(recording, recording.messages.arrival)
    return Speeds(recording.name, t, v, run, tail, held,
                  MOCAP_SLOW if slow else MOCAP, "mocap")


def _braked(t: FloatArray, throttle: FloatArray, at: FloatArray) -> BoolArray:
    """Where the throttle was negative within the last 0.5 s: the sub-models know no braking."""
    brake = t[throttle < 0.0]
    before = np.searchsorted(brake, at, side="right")
    last = np.where(before > 0, brake[np.maximum(before - 1, 0)] if len(brake) else -np.inf,
                    -np.inf)
    return np.asarray(at - last < SETTLE)


def _launch(t: FloatArray, v: FloatArray) -> BoolArray:
    """Where the speed changes by more than MAX_ACCEL over the samples before and after."""
    if len(t) < 3:
        return np.ones(len(t), dtype=bool)
    slope = (v[2:] - v[:-2]) / np.maximum(t[2:] - t[:-2], WINDOW)
    return np.asarray(np.abs(np.concatenate([slope[:1], slope, slope[-1:]])) > MAX_ACCEL)


def _runs(moving: BoolArray, usable: BoolArray, cut: BoolArray) -> tuple[IntArray, BoolArray]:
    """(run (n,) of moving samples without a cut between them, -1: none; whether of its tail)."""
    start = moving & ~np.append(False, moving[:-1] & ~cut)
    run = np.where(moving, np.cumsum(start) - 1, -1)
    label, count = np.unique(run[run >= 0], return_counts=True)
    run = np.where(np.isin(run, label[count >= MIN_RUN]), run, -1)
    tail = np.zeros(len(run), dtype=bool)
    for _ in range(TAIL):
        more = (run[1:] < 0) & (run[:-1] >= 0) & usable[1:] & ~cut
        run[1:] = np.where(more, run[:-1], run[1:])
        tail[1:] |= more
    return run, tail
