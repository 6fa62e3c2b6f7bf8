"""A recording as the diagnosis sees it: less smoothed, and on the time of its own messages.

Where a model is wrong shows within tens of milliseconds of a command, so two
things are finer here than in an open-loop evaluation: velocities come from
seven mocap samples instead of fifteen (and what is predicted is averaged in
the same way), and commands change when the message that carried them was
sent, not when the next mocap row was written.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dart_hal.recording.dart import Grid, Messages, Recording, Reference, grid, savgol_derivative
from dart_hal.types import FloatArray
from dart_hal.vehicle.channels import through
from dart_hal.vehicle.compose import signals
from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.parameters import Vehicle

from .standing import dithered, shaking, standing

STEP = 0.01  # s
POINTS = 7  # of the derivative; 30 ms to each side
HALF = POINTS // 2
READ = (10, 25, 50, 75, 100)  # samples after the start at which a prediction is compared
EVERY, MANY, APART = 50, 300.0, 100
"""Samples from start to start; s of recordings in all from which on windows do not overlap."""
WARM_UP, MARGIN = 20, 8
SLOWEST = 0.3  # m/s at the start of a window
CALM, CALM_BEND = 5, 0.1
"""Samples to each side, and rad/s: where the yaw rate bends more, a smoothed derivative is off
it, and a wrong start looks like a car with less yaw inertia."""
SHAKEN_BEND = 0.4
"""rad/s; the same for an accelerometer, which shakes more than a derivative can be off."""
CALM_SPEED, CALM_SPEED_BEND = 7, 0.08
"""The same for the speed [m/s], where an accelerometer is held against its derivative."""
BEFORE = (-6, -3, 0, 3)  # samples around a message; it may be older than it says
STANDS, REACH = 0.03, 0.1  # m/s; m from the centre that turning moves: noise of a pose is a third
TURNING_WHEEL = 0.2  # m/s; below it an encoder counts too little to be judged
PROMPT = 0.02  # quantile of the delay between sending and arrival that stands for "at once"


@dataclass(frozen=True, slots=True)
class Drive:
    """One recording with motion capture, prepared for a base model.

    grid: motion of the centre of mass from POINTS samples, commands at message
    time; starts (n,): first sample of each window; at (m,): time of each usable
    message in samples; read (m, 4): encoder [m/s], gyro [rad/s], acceleration
    a_x, a_y [m/s2], NaN where there is no such sensor. still (m,): the message is
    of a standing car. felt (2,): by how much an accelerometer is noisier while driving.
    """

    recording: Recording
    grid: Grid
    starts: NDArray[np.int64]
    at: FloatArray
    read: FloatArray
    still: NDArray[np.bool_]
    felt: FloatArray

    def commanded(self, channel: str, later: float) -> FloatArray | None:
        """A command that comes so much later [s]; None where no message says when it came.

        To move the series of samples instead would smear a step over two of
        them, more or less at every delay, and the loss would be rough along it.
        """
        if self.recording.schema == "C":
            return None
        m = self.recording.messages
        return held(message_time(m) + later, getattr(m, channel), len(self.grid))

    def without_mocap_effects(self, p: Vehicle, l_r: float) -> Grid:
        """The motion if the mocap had not done to the pose what the effects of p say.

        Small changes: the effect of the measured pose is taken off once.
        """
        g = self.grid
        if not signals(p, "pose"):
            return g
        marker = _marker(g, l_r)
        seen = through(p, "pose", marker, Now(g.t, g.v_x, g.v_y, g.omega, g.yaw), STEP)
        x, y, yaw = (2.0 * was - is_ for was, is_ in zip(marker, seen, strict=True))
        return _motion(g, x, y, yaw, l_r)


def prepare(recording: Recording, l_r: float, reference: Reference | None = None,
            every: int = EVERY) -> Drive:
    """every: samples from start to start. Errors: RecordingError as for ``grid``."""
    coarse = grid(recording, reference, l_r)
    g = _motion(coarse, *_marker(coarse, l_r), l_r)
    messages = recording.messages
    if recording.schema == "C":
        return Drive(recording, g, _starts(g, every), np.empty(0), np.empty((0, 4)),
                     np.empty(0, dtype=np.bool_), np.ones(2))
    sent = message_time(messages)
    g = replace(g, throttle=held(sent, messages.throttle, len(g)),
                steering=held(sent, messages.steering, len(g)))
    at = sent / STEP
    good = _clean(g, at) & ~(messages.speed < TURNING_WHEEL)
    turning = _calm_before(g.omega, at, CALM, CALM_BEND)
    shaken = _calm_before(g.omega, at, CALM, SHAKEN_BEND)
    steady = _calm_before(g.v_x, at, CALM_SPEED, CALM_SPEED_BEND)
    read = as_read(messages)
    read[~turning, 1] = np.nan
    read[~(shaken & steady), 2] = np.nan
    read[~shaken, 3] = np.nan
    rest = _at_rest(g, messages, at)
    good[rest] = False
    heard = np.flatnonzero(good & shaken & steady)
    return Drive(recording, g, _starts(g, every), np.concatenate([at[good], at[rest]]),
                 np.concatenate([read[good], dithered(as_read(messages), rest)]),
                 np.repeat([False, True], [good.sum(), len(rest)]),
                 shaking(messages, heard, rest))


def as_read(m: Messages) -> FloatArray:
    """What the sensors read in each message, (m, 4), as in ``Drive``."""
    return np.stack([m.speed, m.yaw_rate, m.accel_x, m.accel_y], axis=1)


def _at_rest(g: Grid, m: Messages, at: FloatArray) -> NDArray[np.int64]:
    """Messages of a car that the mocap saw standing."""
    sample = np.arange(len(g))
    moved = np.interp(at, sample, np.hypot(np.hypot(g.v_x, g.v_y), REACH * g.omega) + 1e9 * g.bad)
    return standing(moved < STANDS, m, np.arange(len(at)))


def message_time(m: Messages) -> FloatArray:
    """When each message was sent (m,) [s], on the clock of the mocap.

    The sensor node's own stamps are steady; arrival waits for the line, the
    loop and the next mocap row. The promptest arrivals tie the two clocks.
    """
    return np.asarray(m.t + np.quantile(m.arrival - m.t, PROMPT))


def held(t: FloatArray, value: FloatArray, n: int) -> FloatArray:
    """Mean of a command over each sample (n,), held from message (m,) to message."""
    since = np.concatenate([[min(t[0], 0.0) - 1.0], t[1:]])
    total = np.concatenate([[0.0], np.cumsum(np.diff(since) * value[:-1])])
    edges = np.arange(n + 1) * STEP
    integral = np.interp(edges, since, total) + np.maximum(edges - since[-1], 0.0) * value[-1]
    return _level(np.diff(integral) / STEP)


def spread_over(command: FloatArray, spread: float) -> FloatArray:
    """A series (n,) that comes up to ``spread`` [s] earlier or later: what it is in the mean."""
    return _blurred(command, spread / STEP) if 2.0 * spread > STEP else command


def between(series: FloatArray, at: FloatArray) -> FloatArray:
    """A series (n,) at times (k,) in samples: cubic through four samples (Catmull-Rom).

    Straight lines would be off by what a signal bends within a sample, more or
    less of it at every age of the messages, and the loss rough along that age.
    """
    last = len(series) - 1
    at = np.minimum(np.maximum(at, 0.0), last)
    i = np.minimum(at.astype(np.int64), last - 1)
    u = at - i
    a, b, c, d = series[np.maximum(i - 1, 0)], series[i], series[i + 1], series[
        np.minimum(i + 2, last)]
    return np.asarray(b + 0.5 * u * (c - a + u * (2.0 * a - 5.0 * b + 4.0 * c - d
                                                  + u * (3.0 * (b - c) + d - a))))


def _marker(g: Grid, l_r: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    ref, c, s = g.reference, np.cos(g.yaw), np.sin(g.yaw)
    forward = ref.lx - l_r
    return (g.x + forward * c - ref.ly * s, g.y + forward * s + ref.ly * c, g.yaw)


def _motion(g: Grid, x: FloatArray, y: FloatArray, yaw: FloatArray, l_r: float) -> Grid:
    ref, c, s = g.reference, np.cos(yaw), np.sin(yaw)
    dx, dy, omega = (savgol_derivative(v, POINTS, STEP) for v in (x, y, yaw))
    forward = ref.lx - l_r
    return replace(g, x=x - forward * c + ref.ly * s, y=y - forward * s - ref.ly * c, yaw=yaw,
                   v_x=c * dx + s * dy + omega * ref.ly,
                   v_y=-s * dx + c * dy - omega * forward, omega=omega)


def _starts(g: Grid, every: int) -> NDArray[np.int64]:
    starts = np.arange(WARM_UP, max(len(g) - READ[-1] - MARGIN, WARM_UP), every)
    bad = np.concatenate([[0], np.cumsum(g.bad)])
    clean = bad[starts + READ[-1] + MARGIN] == bad[starts - MARGIN]
    calm = _bend(g.omega, starts, CALM) < CALM_BEND
    return np.asarray(starts[clean & (g.v_x[starts] > SLOWEST) & calm])


def _calm_before(x: FloatArray, at: FloatArray, reach: int, bend: float) -> NDArray[np.bool_]:
    """Messages (m,) around which a series is straight, wherever in BEFORE they belong."""
    here = np.rint(at).astype(np.int64)[:, None] + np.array(BEFORE)
    here = np.clip(here, reach, len(x) - 1 - reach)
    return np.asarray((_bend(x, here, reach) < bend).all(axis=1))


def _bend(x: FloatArray, at: NDArray[np.int64], reach: int) -> FloatArray:
    return np.asarray(np.abs(x[at + reach] - 2.0 * x[at] + x[at - reach]))


def _clean(g: Grid, at: FloatArray) -> NDArray[np.bool_]:
    """Messages with good mocap over the window of the encoder and a little beyond."""
    bad = np.concatenate([[0], np.cumsum(g.bad)])
    here = np.rint(at).astype(np.int64)
    inside = (here > 30) & (here < len(g) - 30)
    here = np.clip(here, 30, max(len(g) - 30, 30))
    return np.asarray(inside & (bad[here + 10] == bad[here - 25]))


def _blurred(series: FloatArray, reach: float) -> FloatArray:
    """Mean of a series (n,) over ``reach`` samples to each side of the middle of each."""
    total = np.concatenate([[0.0], np.cumsum(series)])
    middle = np.arange(len(series)) + 0.5
    low, high = (np.clip(middle + r, 0.0, len(series)) for r in (-reach, reach))
    edges = np.arange(len(total), dtype=np.float64)
    return _level((np.interp(high, edges, total) - np.interp(low, edges, total)) / (high - low))


def _level(command: FloatArray) -> FloatArray:
    """What stands still does so to the last bit: differences of sums do not."""
    return np.round(command, 9)
