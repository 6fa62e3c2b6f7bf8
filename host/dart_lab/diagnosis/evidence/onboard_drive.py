"""A recording without motion capture as the diagnosis sees it: what its own sensors told.

Between two gaps of the messages the car is followed on the clock of its
messages: speed from the encoder, turning from the gyro, heading from the turning
since the gap, place unknown. Windows start at messages; where the car stands,
its gyro and accelerometer say what they read of nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.car.runs import EVERY as FRAMES
from dart_hal.car.runs import finer, read_run
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.recording.dart import RUN, Grid, Messages, Recording, Reference
from dart_hal.recording.dart.spans import span_index
from dart_lab.identification.prediction.commands import message_time, zero_order_hold
from dart_lab.identification.prediction.windows import MIN_SPEED

from ..policy import USUAL, EvidencePolicy
from .drive import Drive, as_read
from .standing import dithered, shaking, standing

NOWHERE = Reference(0.0, 0.0, 0.0, "no motion capture")
ENCODER_SPAN = 0.1  # s over which a speed is the mean
PAST = 2  # messages up to the start, which set the state at it
MESSAGES_AHEAD = 10  # messages after the start at which a prediction is compared
START_SPACING = 0.5  # s from start to start: half a window, so every message is predicted twice
MAX_JITTER = 0.03  # s; a message further from its place in the 10 Hz is a lost one
ACCEL_READ_OUTS = (3, 8)  # read-outs at which the accelerometer is judged: every message once


@dataclass(frozen=True, slots=True)
class Session(Drive):
    """One stretch without gaps of a recording, prepared without motion capture.

    grid: v_x and omega as measured (v_y 0), yaw since the stretch began, x and y
    0. begin (n,): samples, when each window starts; spots (MESSAGES_AHEAD, n): samples from
    there to the messages in it, said (2, MESSAGES_AHEAD, n): encoder [m/s] and gyro [rad/s]
    in them; past (PAST, n), last (2, PAST, n): the same of the messages up to the
    start. Messages of the driving car come in the order of the windows, ACCEL_READ_OUTS[1] -
    ACCEL_READ_OUTS[0] of each, ``read`` without encoder and gyro. means [s]: over how long
    gyro and accelerometer were averaged.
    """

    begin: FloatArray
    past: FloatArray
    last: FloatArray
    spots: FloatArray
    said: FloatArray
    means: float


def sessions(recording: Recording, policy: EvidencePolicy = USUAL.evidence) -> list[Session]:
    """Stretches of a recording that say anything, in order; none where nothing can be used."""
    commands = recording.messages
    means = 0.0
    if recording.schema == RUN:
        recording, commands = _of_run(recording)
        means = ENCODER_SPAN
    m = recording.messages
    sent, commanded = message_time(m), message_time(commands)
    stretches = []
    for segment in np.unique(m.segment):
        rows = np.flatnonzero(m.segment == segment)
        if sent[rows[-1]] - sent[rows[0]] < (MESSAGES_AHEAD + 2) * ENCODER_SPAN:
            continue
        session = _session(recording, rows, sent, (commanded, commands), means, policy)
        if len(session.starts) or len(session.at):
            stretches.append(session)
    return stretches


def _of_run(recording: Recording) -> tuple[Recording, Messages]:
    """(a run in messages of 0.1 s, the same in the finest that carry its commands)."""
    coarse = (recording if recording.span > 0.8 * ENCODER_SPAN
              else replace(read_run(recording.path, FRAMES, poses=False), spans=recording.spans))
    fine = finer(coarse).messages
    # a run says what was commanded up to a stamp, and here a command holds from its stamp on
    begun = np.concatenate([2.0 * fine.t[:1] - fine.t[1:2], fine.t[:-1]])
    return coarse, replace(fine, t=begun, arrival=begun)


def _session(recording: Recording, rows: IntArray, sent: FloatArray,
             commands: tuple[FloatArray, Messages], means: float, policy: EvidencePolicy
             ) -> Session:
    m, zero = recording.messages, sent[rows[0]]
    at = (sent[rows] - zero) / SAMPLE
    g = _grid(m, rows, at, zero - sent[0], means)
    commanded, c = commands
    g = replace(g, throttle=zero_order_hold(commanded - zero, c.throttle, len(g)),
                steering=zero_order_hold(commanded - zero, c.steering, len(g)))
    span = span_index(recording.spans, sent[rows])
    first, reads = _windows(m, rows, at, g, policy.backwards, span)
    index = rows[reads[:, PAST:]]
    spots = (at[reads] - at[first][:, None]).T
    said = np.stack([m.speed[rows][reads], m.yaw_rate[rows][reads]]).swapaxes(1, 2)
    rest = standing(m.speed[rows] == 0.0, m, rows, policy.held)
    rest = rows[rest[span[rest] >= 0]]
    heard = index[:, ACCEL_READ_OUTS[0]:ACCEL_READ_OUTS[1]].ravel()
    read = as_read(m)
    quiet = dithered(read, rest)
    driven = read[heard]
    driven[:, :2] = np.nan
    when = np.concatenate([sent[heard], sent[rest]]) - zero
    still = np.repeat([False, True], [len(heard), len(rest)])
    return Session(recording, g, np.rint(at[first]).astype(np.int64), when / SAMPLE,
                  np.concatenate([driven, quiet]), still, shaking(m, heard, rest, policy),
                  at[first], spots[:PAST], said[:, :PAST], spots[PAST:], said[:, PAST:], means)


def _grid(m: Messages, rows: IntArray, at: FloatArray, since: float,
          means: float) -> Grid:
    """The motion as the sensors tell it. since [s]: from the start of the recording."""
    sample = np.arange(int(np.ceil(at[-1])) + 2, dtype=np.float64)
    back = 0.5 / SAMPLE
    speed = _between(sample, at - ENCODER_SPAN * back, m.speed[rows])
    omega = _between(sample, at - means * back, m.yaw_rate[rows])
    yaw = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1]) * SAMPLE)])
    none = np.zeros(len(sample))
    return Grid(since + sample * SAMPLE, none, none, yaw, speed, none, omega, none, none,
                speed, np.zeros(len(sample), dtype=np.bool_), NOWHERE)


def _between(sample: FloatArray, at: FloatArray, value: FloatArray) -> FloatArray:
    """A reading at every sample; 0 where there never was one, and then no window starts."""
    known = np.isfinite(value)
    if not known.any():
        return np.zeros(len(sample))
    return np.asarray(np.interp(sample, at[known], value[known]))


def _windows(m: Messages, rows: IntArray, at: FloatArray, g: Grid,
             backwards: float, span: IntArray) -> tuple[IntArray, IntArray]:
    """Messages (n,) at which windows start, those (n, PAST + MESSAGES_AHEAD) around: rows.

    span (messages,): number of the stretch in which each may be judged, -1 outside of all.
    """
    wanted = at[:, None] + ENCODER_SPAN / SAMPLE * np.arange(1 - PAST, MESSAGES_AHEAD + 1)
    after = np.clip(np.searchsorted(at, wanted), 1, len(at) - 1)
    near = np.where(wanted - at[after - 1] < at[after] - wanted, after - 1, after)
    whole = (np.abs(at[near] - wanted) < MAX_JITTER / SAMPLE).all(axis=1)
    sensed = np.isfinite(m.speed[rows]) & np.isfinite(m.yaw_rate[rows])
    moving = np.interp(at, np.arange(len(g)), g.v_x) > MIN_SPEED
    forward = np.minimum.accumulate(m.throttle[rows][near], axis=1)[:, -1] > backwards
    judged = (span[near] == span[:, None]).all(axis=1) & (span >= 0)
    good = judged & whole & moving & forward & sensed & sensed[near].all(axis=1)
    good[:4] = good[-1:] = False  # the state at the start takes messages to both sides
    chosen: list[int] = []
    for i in np.flatnonzero(good):
        if not chosen or at[i] - at[chosen[-1]] > START_SPACING / SAMPLE - MAX_JITTER / SAMPLE:
            chosen.append(int(i))
    first = np.array(chosen, dtype=np.int64)
    return first, near[first]


def counted(drives: Sequence[Session]) -> tuple[int, int, int]:
    """(windows, messages while driving, messages at rest)."""
    still = sum(int(d.still.sum()) for d in drives)
    return sum(len(d.starts) for d in drives), sum(len(d.at) for d in drives) - still, still
