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

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.recording.dart import (
    RUN,
    Grid,
    Messages,
    Recording,
    Reference,
    grid,
    savgol_derivative,
)
from dart_hal.vehicle.compose import signals
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.prediction.commands import message_time, zero_order_hold
from dart_lab.identification.prediction.rollout import states
from dart_lab.identification.prediction.sensors import posed
from dart_lab.identification.prediction.windows import find_windows

from ..policy import USUAL, EvidencePolicy
from .standing import dithered, shaking, standing

POINTS = 7  # of the derivative; 30 ms to each side
HALF = POINTS // 2
SMOOTH = 15  # points of the same in an evaluation
READ_OUTS = (10, 25, 50, 75, 100)  # samples after the start at which a prediction is compared
START_SPACING, WINDOW_SPACING = 50, 100  # samples from start to start; without overlap
CLEAN = READ_OUTS[-1] + 8  # samples from a start on without a bad one
CALM, CALM_SPEED = 5, 7  # samples to each side, over which yaw rate and speed may not bend
BEFORE = (-6, -3, 0, 3)  # samples around a message; it may be older than it says
MESSAGE = 0.1  # s; runs of our own have messages more often
REACH = 0.1  # m from the centre, where turning counts as moving


@dataclass(frozen=True, slots=True)
class Drive:
    """One recording with motion capture, prepared for a base model.

    grid: motion of the centre of mass from POINTS samples, commands at message
    time; starts (n,): first sample of each window; at (m,): time of each usable
    message in samples; read (m, 4): encoder [m/s], gyro [rad/s], acceleration
    a_x, a_y [m/s2], NaN where there is no such sensor. still (m,): the message is
    of a standing car. noise_scale (2,): by how much an accelerometer is noisier while driving.
    """

    recording: Recording
    grid: Grid
    starts: IntArray
    at: FloatArray
    read: FloatArray
    still: BoolArray
    noise_scale: FloatArray

    @property
    def sent(self) -> FloatArray | None:
        """When each message was (m,) [s]; None where none says when a command came."""
        return None if self.recording.schema == "C" else message_time(self.recording.messages)

    def commanded(self, channel: str, at: FloatArray) -> FloatArray:
        """A command that comes with its messages at times (m,) [s].

        To move the series of samples instead would smear a step over two of
        them, more or less at every delay, and the loss would be rough along it.
        """
        return zero_order_hold(at, getattr(self.recording.messages, channel), len(self.grid))

    def without_mocap_effects(self, p: Vehicle, l_r: float) -> Grid:
        """The motion if the mocap had not done to the pose what the effects of p say.

        Small changes: the effect of the measured pose is taken off once.
        """
        g = self.grid
        if not signals(p, "pose"):
            return g
        marker = _marker(g, l_r)
        seen = posed(p, g.t, states(g), marker)
        x, y, yaw = (2.0 * was - is_ for was, is_ in zip(marker, seen, strict=True))
        return _motion(g, x, y, yaw, l_r)


def prepare(recording: Recording, l_r: float, reference: Reference | None = None,
            every: int = START_SPACING, policy: EvidencePolicy = USUAL.evidence) -> Drive:
    """every: samples from start to start. Errors: RecordingError as for ``grid``."""
    coarse = grid(recording, reference, l_r)
    g = _motion(coarse, *_marker(coarse, l_r), l_r)
    messages = recording.messages
    if recording.schema == "C":
        return Drive(recording, g, _starts(g, every, policy.bend), np.empty(0), np.empty((0, 4)),
                     np.empty(0, dtype=np.bool_), np.ones(2))
    sent = message_time(messages)
    g = replace(g, throttle=zero_order_hold(sent, messages.throttle, len(g)),
                steering=zero_order_hold(sent, messages.steering, len(g)))
    at = sent / SAMPLE
    good = _clean(g, at) & ~(messages.speed < policy.wheel)
    if recording.schema == RUN:
        good &= _apart(messages.t)
    turning = _calm_before(g.omega, at, CALM, policy.bend)
    shaken = _calm_before(g.omega, at, CALM, policy.shaken_bend)
    steady = _calm_before(g.v_x, at, CALM_SPEED, policy.speed_bend)
    read = as_read(messages)
    read[~turning, 1] = np.nan
    read[~(shaken & steady), 2] = np.nan
    read[~shaken, 3] = np.nan
    rest = _at_rest(g, messages, at, policy)
    good[rest] = False
    heard = np.flatnonzero(good & shaken & steady)
    return Drive(recording, g, _starts(g, every, policy.bend), np.concatenate([at[good], at[rest]]),
                 np.concatenate([read[good], dithered(as_read(messages), rest)]),
                 np.repeat([False, True], [good.sum(), len(rest)]),
                 shaking(messages, heard, rest, policy))


def as_read(m: Messages) -> FloatArray:
    """What the sensors read in each message, (m, 4), as in ``Drive``."""
    return np.stack([m.speed, m.yaw_rate, m.accel_x, m.accel_y], axis=1)


def _at_rest(g: Grid, m: Messages, at: FloatArray, policy: EvidencePolicy) -> IntArray:
    """Messages of a car that the mocap saw standing."""
    sample = np.arange(len(g))
    moved = np.interp(at, sample, np.hypot(np.hypot(g.v_x, g.v_y), REACH * g.omega) + 1e9 * g.bad)
    return standing(moved < policy.stands, m, np.arange(len(at)), policy.held)


def _marker(g: Grid, l_r: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    return (*g.reference.marker(l_r, g.x, g.y, g.yaw), g.yaw)


def freed_of_mocap(g: Grid, p: Vehicle, l_r: float) -> Grid:
    """A grid of any smoothing without what the effects of p do to poses, to first order.

    The change of the motion, smoothed as an evaluation smooths, is added to it.
    """
    marker = _marker(g, l_r)
    shown = posed(p, g.t, states(g), marker)
    freed = [2.0 * was - is_ for was, is_ in zip(marker, shown, strict=True)]
    before = _motion(g, *marker, l_r, SMOOTH)
    after = _motion(g, freed[0], freed[1], freed[2], l_r, SMOOTH)
    changed = {name: getattr(g, name) + getattr(after, name) - getattr(before, name)
               for name in ("x", "y", "yaw", "v_x", "v_y", "omega")}
    return replace(g, **changed)


def _motion(g: Grid, x: FloatArray, y: FloatArray, yaw: FloatArray, l_r: float,
            points: int = POINTS) -> Grid:
    dx, dy, omega = (savgol_derivative(v, points) for v in (x, y, yaw))
    x, y, v_x, v_y = g.reference.centre(l_r, (x, y, yaw), (dx, dy, omega))
    return replace(g, x=x, y=y, yaw=yaw, v_x=v_x, v_y=v_y, omega=omega)


def _starts(g: Grid, every: int, bend: float) -> IntArray:
    starts = find_windows(g, every, CLEAN, CLEAN).start
    return starts[_bend(g.omega, starts, CALM) < bend]


def _calm_before(x: FloatArray, at: FloatArray, reach: int, bend: float) -> BoolArray:
    """Messages (m,) around which a series is straight, wherever in BEFORE they belong."""
    here = np.rint(at).astype(np.int64)[:, None] + np.array(BEFORE)
    here = np.clip(here, reach, len(x) - 1 - reach)
    return np.asarray((_bend(x, here, reach) < bend).all(axis=1))


def _bend(x: FloatArray, at: IntArray, reach: int) -> FloatArray:
    return np.asarray(np.abs(x[at + reach] - 2.0 * x[at] + x[at - reach]))


def _apart(t: FloatArray) -> BoolArray:
    """Messages (m,) in another 0.1 s than the one before: the encoder's mean spans as much."""
    return np.concatenate([[True], np.diff(np.floor(t / MESSAGE)) > 0])


def _clean(g: Grid, at: FloatArray) -> BoolArray:
    """Messages with good mocap over the window of the encoder and a little beyond."""
    bad = np.concatenate([[0], np.cumsum(g.bad)])
    here = np.rint(at).astype(np.int64)
    inside = (here > 30) & (here < len(g) - 30)
    here = np.clip(here, 30, max(len(g) - 30, 30))
    return np.asarray(inside & (bad[here + 10] == bad[here - 25]))
