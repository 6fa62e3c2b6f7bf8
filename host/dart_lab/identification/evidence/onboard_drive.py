"""A recording without motion capture, prepared for the diagnosis.

Between two gaps of the messages the motion follows from the sensors on the clock of the messages:
speed from the encoder, yaw rate from the gyro, heading from the yaw rate since the gap. The
position is unknown. Windows start at messages. At rest, gyro and accelerometer show their bias.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.car.runs import FRAMES_PER_MESSAGE as FRAMES
from dart_hal.car.runs import finer, read_run
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.recording.dart import RUN, Grid, Messages, Recording, Reference
from dart_hal.recording.dart.spans import span_index
from dart_lab.identification.prediction.commands import message_time, zero_order_hold
from dart_lab.identification.prediction.windows import MIN_FORWARD_THROTTLE, MIN_WINDOW_SPEED

from .drive import RecordedDrive, stack_readings
from .policy import USUAL_EVIDENCE, EvidencePolicy
from .standing import add_dither, driving_noise_scale, find_rest_messages

NO_MOCAP_FRAME = Reference(0.0, 0.0, 0.0, "no motion capture")
ENCODER_MEAN_S = 0.1  # s over which an encoder reading is the mean
STATE_MESSAGES = 2  # messages up to the start, which determine the state there
MESSAGES_AHEAD = 10  # messages after the start at which a prediction is compared
START_SPACING = 0.5  # s from start to start: half a window, so each message is predicted twice
MAX_JITTER_S = 0.03  # s; a message further from its place in the 10 Hz grid is a lost one
ACCEL_READ_OUTS = (3, 8)  # read-outs at which the accelerometer is judged: each message once
END_MESSAGES = 4  # at the begin of a stretch; the state at a start needs messages to both sides
FINE_SPAN_S = 0.8 * ENCODER_MEAN_S  # s; messages of a run closer than this are joined


@dataclass(frozen=True, slots=True)
class OnboardStretch(RecordedDrive):
    """One stretch without gaps of a recording, prepared without motion capture.

    grid: v_x and omega as measured (v_y 0), yaw since the beginning of the stretch, x and y 0.
    window_starts (n,): time of each start [samples]. past_offsets (STATE_MESSAGES, n) and
    message_offsets (MESSAGES_AHEAD, n): times of the messages up to a start and after it, relative
    to the start [samples]. past_readings (2, STATE_MESSAGES, n) and window_readings
    (2, MESSAGES_AHEAD, n): encoder [m/s] and gyro [rad/s] in these messages. mean_s: time over
    which gyro and accelerometer were averaged [s]. ``readings`` while driving hold only the
    accelerometer, ACCEL_READ_OUTS[1] - ACCEL_READ_OUTS[0] messages of each window.
    """

    window_starts: FloatArray
    past_offsets: FloatArray
    past_readings: FloatArray
    message_offsets: FloatArray
    window_readings: FloatArray
    mean_s: float


def prepare_stretches(recording: Recording, policy: EvidencePolicy = USUAL_EVIDENCE
                      ) -> list[OnboardStretch]:
    """Prepare the stretches of a recording that have windows or messages at rest, in order."""
    commands = recording.messages
    mean_s = 0.0
    if recording.schema == RUN:
        recording, commands = _read_run_messages(recording)
        mean_s = ENCODER_MEAN_S
    m = recording.messages
    sent = message_time(m)
    commanded = message_time(commands)
    stretches = []
    for segment in np.unique(m.segment):
        rows = np.flatnonzero(m.segment == segment)
        if sent[rows[-1]] - sent[rows[0]] < (MESSAGES_AHEAD + 2) * ENCODER_MEAN_S:
            continue
        stretch = _prepare_stretch(recording, rows, sent, (commanded, commands), mean_s, policy)
        if len(stretch.starts) or len(stretch.message_samples):
            stretches.append(stretch)
    return stretches


def _read_run_messages(recording: Recording) -> tuple[Recording, Messages]:
    """Return a run in messages of 0.1 s, and its finest messages that carry commands."""
    coarse = (recording if recording.span > FINE_SPAN_S
              else replace(read_run(recording.path, FRAMES, poses=False), spans=recording.spans,
                           battery=recording.battery))
    fine = finer(coarse).messages
    # A run logs a command with the end of its time, but here it must have the begin.
    begun = np.concatenate([2.0 * fine.t[:1] - fine.t[1:2], fine.t[:-1]])
    return coarse, replace(fine, t=begun, arrival=begun)


def _prepare_stretch(recording: Recording, rows: IntArray, sent: FloatArray,
                     commands: tuple[FloatArray, Messages], mean_s: float, policy: EvidencePolicy
                     ) -> OnboardStretch:
    """Prepare the messages ``rows``; commands: their times [s], and the messages that hold them."""
    m = recording.messages
    zero = sent[rows[0]]
    samples = (sent[rows] - zero) / SAMPLE
    g = _integrate_sensors(m, rows, samples, zero - sent[0], mean_s)
    commanded, c = commands
    battery = recording.battery
    voltage = (None if battery is None
               else battery.interpolate(zero + np.arange(len(g)) * SAMPLE))
    g = replace(g, scale=recording.scale, voltage=voltage,
                throttle=zero_order_hold(commanded - zero, c.throttle, len(g)),
                steering=zero_order_hold(commanded - zero, c.steering, len(g)))
    span = span_index(recording.spans, sent[rows])
    first, near = _find_windows(m, rows, samples, g, MIN_FORWARD_THROTTLE, span)
    index = rows[near[:, STATE_MESSAGES:]]
    offsets = (samples[near] - samples[first][:, None]).T
    readings = np.stack([m.speed[rows][near], m.yaw_rate[rows][near]]).swapaxes(1, 2)
    rest = find_rest_messages(m.speed[rows] == 0.0, m, rows, policy.max_rest_yaw_rate)
    rest = rows[rest[span[rest] >= 0]]
    accel_rows = index[:, ACCEL_READ_OUTS[0]:ACCEL_READ_OUTS[1]].ravel()
    stacked = stack_readings(m)
    quiet = add_dither(stacked, rest)
    driving = stacked[accel_rows]
    driving[:, :2] = np.nan
    times = np.concatenate([sent[accel_rows], sent[rest]]) - zero
    at_rest = np.repeat([False, True], [len(accel_rows), len(rest)])
    return OnboardStretch(recording, g, np.rint(samples[first]).astype(np.int64), times / SAMPLE,
                          np.concatenate([driving, quiet]), at_rest,
                          driving_noise_scale(m, accel_rows, rest, policy), samples[first],
                          offsets[:STATE_MESSAGES], readings[:, :STATE_MESSAGES],
                          offsets[STATE_MESSAGES:], readings[:, STATE_MESSAGES:], mean_s)


def _integrate_sensors(m: Messages, rows: IntArray, samples: FloatArray, since: float,
                       mean_s: float) -> Grid:
    """Return the motion by the sensors; since [s]: from the start of the recording.

    A mean over a time belongs to the middle of that time.
    """
    index = np.arange(int(np.ceil(samples[-1])) + 2, dtype=np.float64)
    half = 0.5 / SAMPLE
    speed = _interpolate(index, samples - ENCODER_MEAN_S * half, m.speed[rows])
    omega = _interpolate(index, samples - mean_s * half, m.yaw_rate[rows])
    yaw = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1]) * SAMPLE)])
    none = np.zeros(len(index))
    return Grid(since + index * SAMPLE, none, none, yaw, speed, none, omega, none, none,
                speed, np.zeros(len(index), dtype=np.bool_), NO_MOCAP_FRAME)


def _interpolate(index: FloatArray, samples: FloatArray, value: FloatArray) -> FloatArray:
    """Interpolate readings to all samples; 0 without any, and then no window starts."""
    known = np.isfinite(value)
    if not known.any():
        return np.zeros(len(index))
    return np.asarray(np.interp(index, samples[known], value[known]))


def _find_windows(m: Messages, rows: IntArray, samples: FloatArray, g: Grid,
                  backwards: float, span: IntArray) -> tuple[IntArray, IntArray]:
    """Find windows: messages (n,) at which they start, (n, STATE_MESSAGES + MESSAGES_AHEAD) rows.

    1. Expect messages at 10 Hz around each one, and find the nearest message to each of these.
    2. Accept a start if none is missing, the car moves forward, all messages have encoder and
       gyro, and all are in the same span.
    3. Choose starts at least START_SPACING apart.

    span (messages,): number of the span in which each is judged, -1 outside.
    """
    expected = (samples[:, None]
                + ENCODER_MEAN_S / SAMPLE * np.arange(1 - STATE_MESSAGES, MESSAGES_AHEAD + 1))
    after = np.clip(np.searchsorted(samples, expected), 1, len(samples) - 1)
    near = np.where(expected - samples[after - 1] < samples[after] - expected, after - 1, after)
    whole = (np.abs(samples[near] - expected) < MAX_JITTER_S / SAMPLE).all(axis=1)
    sensed = np.isfinite(m.speed[rows]) & np.isfinite(m.yaw_rate[rows])
    least = MIN_WINDOW_SPEED * g.scale.speed
    moving = np.interp(samples, np.arange(len(g)), g.v_x) > least
    forward = np.minimum.accumulate(m.throttle[rows][near], axis=1)[:, -1] > backwards
    judged = (span[near] == span[:, None]).all(axis=1) & (span >= 0)
    good = judged & whole & moving & forward & sensed & sensed[near].all(axis=1)
    good[:END_MESSAGES] = False
    good[-1:] = False
    chosen: list[int] = []
    for i in np.flatnonzero(good):
        if (not chosen or samples[i] - samples[chosen[-1]]
                > START_SPACING / SAMPLE - MAX_JITTER_S / SAMPLE):
            chosen.append(int(i))
    first = np.array(chosen, dtype=np.int64)
    return first, near[first]


def count_windows(stretches: Sequence[OnboardStretch]) -> tuple[int, int, int]:
    """Count windows, messages while driving and messages at rest."""
    at_rest = sum(int(d.at_rest.sum()) for d in stretches)
    messages = sum(len(d.message_samples) for d in stretches)
    return sum(len(d.starts) for d in stretches), messages - at_rest, at_rest
