"""Straight driving in recordings: speed samples in runs, and the throttle before them.

The speed is the mocap's if there is one, else the encoder's. Excluded are turning (the front
wheels brake by l_r omega^2, which the sub-models do not have), standstill (nor static friction),
braking, launches and bad mocap.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.recording.dart import Grid, Recording, Reference, grid, rolling_reference
from dart_lab.identification.prediction.commands import LoggedCommand, message_step, throttle_of
from dart_lab.identification.prediction.windows import THROTTLE_MEMORY
from dart_lab.identification.submodels.report import Ledger

# [rad/s] of a car of 1:10. The steered wheels brake by l_r omega^2 = 0.024 m/s2 there.
MAX_YAW_RATE = 0.5
# [command]
MAX_STEERING = 0.25
# [m/s] of a car of 1:10. Also at least two counts of the encoder.
MIN_MOVING_SPEED = 0.08
# [m/s2] Harder launches spin the wheels, and an error of the delay costs too much.
MAX_ACCEL = 4.0
# Samples of the mocap grid from one speed to the next: 0.1 s, the span of its derivative.
MOCAP_STRIDE = 10
# Samples of the shortest run.
MIN_RUN = 4
# Samples after a run: the model may still move while the car is at rest.
TAIL_SAMPLES = 8
# [s] Disturbances of a drive are independent after this time, so errors are taken over blocks.
BLOCK_LENGTH = 2.0
# [s] The encoder counts over this time.
ENCODER_WINDOW = 0.1


@dataclass(frozen=True, slots=True)
class Kernel:
    """Reading of a speed sensor: sum over j of weight (j,) [1/s] times distance(t + offset_j)."""

    offset: FloatArray
    weight: FloatArray


def _derivative_kernel(half: int) -> Kernel:
    i = np.arange(-half, half + 1, dtype=np.float64)
    return Kernel(i * SAMPLE, i / float(i @ i) / SAMPLE)


def _mean_kernel(window: float) -> Kernel:
    return Kernel(np.array([-window, 0.0]), np.array([-1.0, 1.0]) / window)


MOCAP_KERNEL = _derivative_kernel(7)
SLOW_MOCAP_KERNEL = _derivative_kernel(12)


@dataclass(frozen=True, slots=True)
class Speeds:
    """Straight driving of one recording.

    t (n,) [s], v (n,) [m/s]; run (n,): number of the run of consecutive samples; tail (n,):
    samples after the end of a run, where the car is slow or at rest. The end of a coast-down must
    not depend on the measured speed: cars that are pushed by chance roll longer, and would count
    more than those that are slowed down.
    """

    name: str
    t: FloatArray
    v: FloatArray
    run: IntArray
    tail: BoolArray
    throttle: LoggedCommand
    kernel: Kernel
    source: str

    def __len__(self) -> int:
        return len(self.t)

    def select(self, rows: IntArray, run: IntArray | None = None) -> Speeds:
        """Select the samples ``rows``, with other run numbers (len(rows),) if given."""
        return replace(self, t=self.t[rows], v=self.v[rows], tail=self.tail[rows],
                       run=self.run[rows] if run is None else run)


def mocap_grid(recording: Recording, reference: Reference | None) -> Grid | None:
    """Return the grid for speed and yaw rate, None without mocap.

    Its v_y may be that of another point. Raises RecordingError as ``grid``.
    """
    if recording.mocap is None:
        return None
    return grid(recording, reference or rolling_reference(recording))


def read_speeds(recording: Recording, reference: Reference | None, ledger: Ledger) -> Speeds | None:
    """Read the straight driving of one recording; None (reason in the ledger) without any."""
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
    reasons = [f"speed from the {found.source}"]
    reasons += [] if len(keep) else [f"no straight driving (|yaw rate| < "
                                     f"{MAX_YAW_RATE * recording.scale.yaw_rate:.2g} rad/s, "
                                     f"|steering| < {MAX_STEERING}, throttle >= 0)"]
    ledger.add(recording.name, used, len(found) - used, reasons)
    return found.select(keep) if len(keep) else None


def _from_encoder(recording: Recording) -> Speeds:
    m = recording.messages
    least = max(MIN_MOVING_SPEED * recording.scale.speed, 2.0 * (recording.quantum or 0.0) - 0.015)
    moves = np.isfinite(m.speed) & (m.speed >= least)
    slow = ~moves
    # The windows of the first and the last sample of a run may contain a part of the standstill.
    moves = moves & ~np.append(False, slow[:-1]) & ~np.append(slow[1:], False)
    straight = (np.abs(m.yaw_rate) < MAX_YAW_RATE * recording.scale.yaw_rate)
    straight &= (np.abs(m.steering) < MAX_STEERING)
    usable = (straight & np.isfinite(m.speed) & ~_is_braking(m.t, m.throttle, m.t)
              & ~_is_launch(m.t, m.speed))
    run, tail = _find_runs(moves & usable, usable, np.diff(m.segment) != 0)
    return Speeds(recording.name, m.t, m.speed, run, tail, throttle_of(recording, m.t),
                  _mean_kernel(_speed_window(recording)), "encoder")


def _speed_window(recording: Recording) -> float:
    """Return the span [s] of a speed value: 0.1 s, or the step of messages that are means."""
    return message_step(recording) if recording.of_means else ENCODER_WINDOW


def _from_mocap(recording: Recording, g: Grid) -> Speeds:
    slow = recording.mocap is not None and float(np.median(np.diff(recording.mocap.t))) > 0.03
    t = g.t[::MOCAP_STRIDE]
    v = g.v_x[::MOCAP_STRIDE]
    good = ~np.maximum.reduceat(g.bad, np.arange(0, len(g), MOCAP_STRIDE))
    turning = np.maximum.reduceat(np.abs(g.omega), np.arange(0, len(g), MOCAP_STRIDE))
    usable = (good & (turning < MAX_YAW_RATE * g.scale.yaw_rate)
              & (np.abs(g.steering[::MOCAP_STRIDE]) < MAX_STEERING)
              & ~_is_braking(recording.messages.arrival, recording.messages.throttle, t)
              & ~_is_launch(t, v))
    run, tail = _find_runs(usable & (v > MIN_MOVING_SPEED * g.scale.speed), usable,
                           np.zeros(len(t) - 1, dtype=bool))
    throttle = throttle_of(recording, recording.messages.arrival)
    return Speeds(recording.name, t, v, run, tail, throttle,
                  SLOW_MOCAP_KERNEL if slow else MOCAP_KERNEL, "mocap")


def _is_braking(t: FloatArray, throttle: FloatArray, sample_times: FloatArray) -> BoolArray:
    """Return whether the throttle was negative within the last 0.5 s of each sample time."""
    brake = t[throttle < 0.0]
    before = np.searchsorted(brake, sample_times, side="right")
    last = np.where(before > 0, brake[np.maximum(before - 1, 0)] if len(brake) else -np.inf,
                    -np.inf)
    return np.asarray(sample_times - last < THROTTLE_MEMORY)


def _is_launch(t: FloatArray, v: FloatArray) -> BoolArray:
    """Return whether the acceleration between the neighbours of a sample exceeds MAX_ACCEL."""
    if len(t) < 3:
        return np.ones(len(t), dtype=bool)
    slope = (v[2:] - v[:-2]) / np.maximum(t[2:] - t[:-2], ENCODER_WINDOW)
    return np.asarray(np.abs(np.concatenate([slope[:1], slope, slope[-1:]])) > MAX_ACCEL)


def _find_runs(moving: BoolArray, usable: BoolArray, cut: BoolArray) -> tuple[IntArray, BoolArray]:
    """Number the runs; return (run (n,), -1 outside of runs; whether a sample is in a tail)."""
    # 1. A run starts at a moving sample after a slow one or after a cut.
    start = moving & ~np.append(False, moving[:-1] & ~cut)
    run = np.where(moving, np.cumsum(start) - 1, -1)
    # 2. Short runs are dropped.
    label, count = np.unique(run[run >= 0], return_counts=True)
    run = np.where(np.isin(run, label[count >= MIN_RUN]), run, -1)
    # 3. Each run grows by its tail, one sample at a time, while samples are usable.
    tail = np.zeros(len(run), dtype=bool)
    for _ in range(TAIL_SAMPLES):
        more = (run[1:] < 0) & (run[:-1] >= 0) & usable[1:] & ~cut
        run[1:] = np.where(more, run[:-1], run[1:])
        tail[1:] |= more
    return run, tail
