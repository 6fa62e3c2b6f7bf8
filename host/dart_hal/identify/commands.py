"""What the actuators did with the logged commands: delay, lag, steering map, effects on them.

All of it runs from the start of a recording, so that a window inherits what
came before it.
"""

from __future__ import annotations

import math

import numpy as np

from dart_hal.errors import UsageError
from dart_hal.recording.dart import Grid
from dart_hal.types import FloatArray
from dart_hal.vehicle.channels import through
from dart_hal.vehicle.compose import settled, signals
from dart_hal.vehicle.effect import Now, Stateful
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering

SAMPLE = 0.01  # s, step of the grid
BLOCK = 64  # samples of a lag at once
PARTS = 4  # of a sample, in which an effect with a memory has its mean


def delayed(command: FloatArray, delay: float, smooth: bool = False) -> FloatArray:
    """The series (n,) ``delay`` [s] later; before: its first value.

    By whole samples, as open-loop evaluation is defined; smooth: linear
    between samples, so that a fit can find a delay below the grid's step.
    """
    if smooth:
        at = np.arange(len(command))
        return np.asarray(np.interp(at - delay / SAMPLE, at, command))
    by = min(round(delay / SAMPLE), len(command))
    return np.concatenate([np.repeat(command[:1], by), command[:len(command) - by]])


def lagged(command: FloatArray, lag: float, means: bool = False) -> FloatArray:
    """First-order lag of time constant ``lag`` [s] of a series (n,), at rest at its start.

    y_0 = u_0, y_i = y_(i-1) + (1 - exp(-0.01/T)) (u_(i-1) - y_(i-1)): what it is as
    sample i begins; means: its mean while u_i is held, u_i + (y_i - u_i) (1 - exp(-0.01/T)) T/0.01.
    """
    if lag <= 0.0:
        return command
    keep = math.exp(-SAMPLE / lag)
    out = following(command, keep)
    return command + (out - command) * (1.0 - keep) * lag / SAMPLE if means else out


def following(u: FloatArray, keep: float) -> FloatArray:
    """y (..., n) with y_0 = u_0 and y_i = keep y_(i-1) + (1 - keep) u_(i-1), u (..., n).

    In blocks, each a product with the same triangle. (scipy's ``lfilter`` does the same;
    its module alone takes longer to import than a recording to evaluate.)
    """
    n, ahead = u.shape[-1], np.arange(BLOCK)
    padded = np.concatenate([u, np.repeat(u[..., -1:], -n % BLOCK, axis=-1)], axis=-1)
    blocks = padded.reshape(*u.shape[:-1], -1, BLOCK)
    since = ahead[None, :] - 1 - ahead[:, None]  # samples from u_i to y_j
    answer = np.where(since >= 0, (1.0 - keep) * keep**np.maximum(since, 0), 0.0)
    forced = blocks @ answer
    last = keep * forced[..., -1] + (1.0 - keep) * blocks[..., -1]
    begin = np.empty_like(last)
    y = u[..., 0]
    for i in range(begin.shape[-1]):
        begin[..., i] = y
        y = keep**BLOCK * y + last[..., i]
    out = forced + begin[..., None] * keep**ahead
    return np.asarray(out.reshape(padded.shape)[..., :n])


def actuated(p: Vehicle, g: Grid, *, smooth: bool = False, means: bool = False
             ) -> tuple[FloatArray, FloatArray]:
    """(throttle -1..1, road-wheel angle [rad]) of every sample of a recording, (n,) each.

    smooth: as ``delayed``. As open-loop evaluation is defined, a lag is what it is
    when a sample begins, an effect with a memory what it has reached when it ends:
    5 ms late, and 5 ms early, where both are held over the sample. means: the means
    over it instead. Effects of the vehicle that change commands or the angle are in
    it. Errors: UsageError for one that wants to know the motion: it is not known
    before the rollout.
    """
    return (throttle_behind(p, g.throttle, g.t, smooth=smooth, means=means),
            angle_behind(p, g.steering, g.t, smooth=smooth, means=means))


def throttle_behind(p: Vehicle, command: FloatArray, t: FloatArray, *, smooth: bool = False,
                    means: bool = False) -> FloatArray:
    """The first of ``actuated`` by its command (n,) at times t (n,)."""
    p = settled(p)
    d = p.delay
    throttle = lagged(delayed(command, d.throttle_s, smooth), d.throttle_lag_s, means)
    return _through(p, "throttle", throttle, t, means)


def angle_behind(p: Vehicle, command: FloatArray, t: FloatArray, *, smooth: bool = False,
                 means: bool = False) -> FloatArray:
    """The second of ``actuated`` by its command (n,) at times t (n,)."""
    p = settled(p)
    d = p.delay
    steering = lagged(delayed(command, d.steering_s, smooth), d.steering_lag_s, means)
    steering = _through(p, "steering", steering, t, means)
    angle = np.asarray(make_steering(p.steering, ARRAY)(steering))
    return _through(p, "angle", angle, t, means)


def _through(p: Vehicle, channel: str, series: FloatArray, t: FloatArray,
             means: bool) -> FloatArray:
    """The series (n,) behind the effects on its channel, in their order."""
    remembers = any(isinstance(hook, Stateful) for _, hook in signals(p, channel))
    parts = PARTS if means and remembers else 1
    if parts > 1:
        series = np.repeat(series, parts)
        t = (t[:, None] + np.arange(parts) * SAMPLE / parts).ravel()
    # a hook that looks at the motion gets NaN, which nobody can overlook
    unmoved = Now(t, *[math.nan] * (len(Now._fields) - 1))
    out = np.asarray(through(p, channel, series, unmoved, SAMPLE / parts))
    out = out.reshape(-1, parts).mean(axis=1) if parts > 1 else out
    if not np.isfinite(out).all():
        named = ", ".join(applied.name for applied, _ in signals(p, channel))
        raise UsageError(
            "an effect cannot enter an open-loop prediction",
            found=f"a change of the {channel} that depends on the motion of the car, in {named}",
            expected="one that depends on the command and on time",
            remedy="leave this effect out of the model")
    return out
