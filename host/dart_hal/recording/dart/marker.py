"""The marker frame of the mocap on a grid of 0.01 s, and which samples are bad.

Derivatives by Savitzky-Golay, order 2, 15 points (25 for 20 Hz recordings):
centred, so they look 70 ms ahead.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import BoolArray, FloatArray, IntArray

from .mocap import POSITION_STEP, YAW_STEP, longest_step, position_jumps
from .model import RUN, Recording
from .sensors import MAX_MESSAGE_GAP
from .spans import span_index

# Epoch stamps are rounded to 2.4e-7 s.
ARRIVAL_TOLERANCE = 1e-5  # s
# Samples of 10 ms next to a bad one that are bad, too.
MARGIN_SAMPLES = 20
# Median mocap step [s] above which values are interpolated by a spline.
SLOW_STEP = 0.03
# Samples of 10 ms from which a velocity is computed: as published, and of slow mocap.
VELOCITY_POINTS = 15
SLOW_VELOCITY_POINTS = 25
POSITION_STEP_C = 0.08  # m per 10 ms
# False lock: the pose is at rest (m/s) while the encoder counts (m/s; both of a car of 1:10), in
# more than LOCK_MIN of
# LOCK_SPAN samples.
LOCK_SPEED = 0.05
LOCK_ENCODER = 0.25
LOCK_MIN = 15
LOCK_SPAN = 30


@dataclass(frozen=True, slots=True)
class MarkerGrid:
    """Marker frame on the grid, (n,) each: t s, x, y m, yaw rad, derivatives, inputs, bad.

    points: samples from which each derivative was computed.
    """

    t: FloatArray
    x: FloatArray
    y: FloatArray
    yaw: FloatArray
    dx: FloatArray
    dy: FloatArray
    omega: FloatArray
    throttle: FloatArray
    steering: FloatArray
    encoder: FloatArray
    message: IntArray
    bad: BoolArray
    false_lock: BoolArray
    points: int


def savgol_derivative(values: FloatArray, points: int, step: float = SAMPLE) -> FloatArray:
    """Compute the first derivative by a centred Savitzky-Golay filter of order 2.

    For k = -h .. h the derivative is sum k y_k / (step sum k^2). At the ends it is that of a
    parabola through the last ``points`` values.
    """
    half = points // 2
    k = np.arange(-half, half + 1, dtype=np.float64)
    square = k * k
    weights = k / square.sum() / step
    out = np.empty(len(values))
    out[half:len(values) - half] = np.correlate(values, weights, mode="valid")
    # The curvature of the parabola: k^2 without its mean is orthogonal to 1 and k.
    bend = square - square.mean()
    bend /= bend @ square
    for part, ends in ((slice(0, points), slice(0, half)),
                       (slice(len(values) - points, None), slice(half + 1, None))):
        y = values[part]
        out[part][ends] = (2.0 * (bend @ y) / step) * k[ends] + weights @ y
    return out


def turning_share(omega: FloatArray, points: int, step: float = SAMPLE) -> FloatArray:
    """Compute the share (n,) of a velocity that ``savgol_derivative`` keeps as its vector turns.

    In a circle the coordinates are sines of omega t, whose derivative over 2 h + 1 samples is

        sum k sin(omega k dt) / (omega dt sum k^2) = 1 - (omega dt)^2 sum k^4 / (6 sum k^2) + ..

    of the true one: 0.995 at 3 rad/s and 15 points. The velocity of the lever arm of the marker,
    which is subtracted later, is not reduced. Without a correction that was 1 % of the slip of the
    rear tyres.
    """
    k = np.arange(1, points // 2 + 1, dtype=np.float64)
    # sinc(0) = 1: numpy's sinc has a factor pi
    turned = np.sinc(np.multiply.outer(np.asarray(omega) * step, k) / np.pi)
    return np.asarray(turned @ k**2 / np.sum(k**2))


def marker_grid(recording: Recording, *, turning: bool = False) -> MarkerGrid:
    """Compute the motion of the marker frame as measured, without a mounting correction.

    turning: correct velocities for ``turning_share``. Those of runs always are; the published
    evaluation of the other schemas has no correction.

    Errors: RecordingError for schema A and for less than 0.25 s of mocap.
    """
    mocap = recording.mocap
    messages = recording.messages
    if mocap is None:
        raise RecordingError(f"{recording.name}: no motion capture in this recording",
                             found="schema A", expected="vicon columns (schema B or C)",
                             read=str(recording.path),
                             remedy="give a recording with vicon columns")
    n = int(np.ceil(mocap.t[-1] / SAMPLE - 1e-9))
    t: FloatArray = np.arange(n, dtype=np.float64) * SAMPLE
    slow = len(mocap) > 3 and float(np.median(np.diff(mocap.t))) > SLOW_STEP
    points = SLOW_VELOCITY_POINTS if slow else VELOCITY_POINTS
    if len(t) < points:
        raise RecordingError(f"{recording.name}: too short for velocities",
                             read=str(recording.path), found=f"{mocap.t[-1]:.2f} s of mocap",
                             expected="at least 0.25 s", remedy="leave this file out")
    x, y, yaw = (_resample(t, mocap.t, v, slow) for v in (mocap.x, mocap.y, mocap.yaw))
    dx, dy, omega = (savgol_derivative(v, points) for v in (x, y, yaw))
    if turning or recording.schema == RUN:
        share = turning_share(omega, points)
        dx = dx / share
        dy = dy / share
    arrived = np.searchsorted(messages.arrival, t + ARRIVAL_TOLERANCE, side="right") - 1
    last = np.maximum(arrived, 0)
    encoder = messages.speed[last]
    stale = (arrived < 0) | (t - messages.arrival[last] > MAX_MESSAGE_GAP + ARRIVAL_TOLERANCE)
    unmeasured = stale | _in_gap(t, mocap.t)
    lock = np.zeros(len(t), dtype=bool)
    if recording.schema != "C":
        speed = recording.scale.speed
        lock = _false_lock(np.hypot(dx, dy) / speed, encoder / speed, ~unmeasured)
    # The published evaluation of schema C has a longer limit and drops only the sample before.
    if recording.schema == "C":
        jumps = np.append(_jumps(x, y, yaw, POSITION_STEP_C), False)
    else:
        steps = _jumps(x, y, yaw, POSITION_STEP)
        jumps = np.append(steps, False) | np.append(False, steps)
    bad = _widen(lock | unmeasured | jumps) | (span_index(recording.spans, t) < 0)
    throttle = messages.throttle[last]
    steering = messages.steering[last]
    if recording.commands is not None:
        throttle, steering = recording.commands.sample_means(len(t))
    return MarkerGrid(t, x, y, yaw, dx, dy, omega, throttle, steering, encoder, last, bad, lock,
                      points)


def _resample(t: FloatArray, stamp: FloatArray, values: FloatArray, slow: bool) -> FloatArray:
    if not slow:
        return np.asarray(np.interp(t, stamp, values))
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(stamp, values)(t))


def _widen(bad: BoolArray, margin: int = MARGIN_SAMPLES) -> BoolArray:
    return np.asarray(np.convolve(bad, np.ones(2 * margin + 1), mode="same") > 0.5)


def _jumps(x: FloatArray, y: FloatArray, yaw: FloatArray, limit: float) -> BoolArray:
    """Mark the steps (n - 1,) of the grid that are no motion; limit: m per sample."""
    dx = np.diff(x)
    dy = np.diff(y)
    jumps = position_jumps(np.full(len(dx), SAMPLE), dx, dy, limit)
    return np.asarray(jumps | (np.abs(np.diff(yaw)) > YAW_STEP))


def _in_gap(t: FloatArray, stamp: FloatArray) -> BoolArray:
    after = np.clip(np.searchsorted(stamp, t, side="left"), 1, len(stamp) - 1)
    return np.asarray(stamp[after] - stamp[after - 1] > longest_step(stamp))


def _false_lock(speed: FloatArray, encoder: FloatArray, measured: BoolArray) -> BoolArray:
    """Mark the samples (n,) of a false lock; speeds [m/s] of a car of 1:10.

    In a pause of the recording (not ``measured``) the last encoder speed holds, and is no evidence.
    """
    with np.errstate(invalid="ignore"):
        locked = measured & (speed < LOCK_SPEED) & (encoder > LOCK_ENCODER)
    count = np.convolve(locked, np.ones(LOCK_SPAN), mode="same")
    return np.asarray(count > LOCK_MIN)
