"""What the actuators did with the logged commands: delay, lag, steering map, effects on them.

All of it runs from the start of a recording, so that a window inherits what
came before it.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Literal

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Grid
from dart_hal.vehicle import channels
from dart_hal.vehicle.compose import settled, signals
from dart_hal.vehicle.effect import Now, Stateful
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering

BLOCK = 64  # samples of a lag at once
PARTS = 4  # of a sample, in which an effect with a memory has its mean
Sampled = Literal["start", "middle", "mean"]
"""At which moment of a sample, in which the command is held, the output of a lag is taken."""


def delayed(command: FloatArray, delay: float, smooth: bool = False) -> FloatArray:
    """The series (n,) ``delay`` [s] later, or below 0 earlier; beyond its ends what stands there.

    By whole samples, as open-loop evaluation is defined; smooth: linear
    between samples, so that a fit can find a delay below the grid's step.
    """
    if smooth:
        at = np.arange(len(command))
        return np.asarray(np.interp(at - delay / SAMPLE, at, command))
    by = max(-len(command), min(round(delay / SAMPLE), len(command)))
    if by < 0:
        return np.concatenate([command[-by:], np.repeat(command[-1:], -by)])
    return np.concatenate([np.repeat(command[:1], by), command[:len(command) - by]])


def first_order_lag(u: FloatArray, lag: float, sampled: Sampled = "start") -> FloatArray:
    """T y' = u - y of a command u (..., n) held over each sample, T = ``lag`` [s], y_0 = u_0.

    y_i = k y_(i-1) + (1 - k) u_(i-1) with k = exp(-0.01 s / T) as sample i starts. In its
    middle sqrt(k) y_i + (1 - sqrt(k)) u_i; its mean u_i + (y_i - u_i) (1 - k) T / 0.01 s.
    """
    if lag <= 0.0:
        return u
    keep = math.exp(-SAMPLE / lag)
    y = low_pass(u, keep)
    if sampled == "mean":
        return np.asarray(u + (y - u) * (1.0 - keep) * lag / SAMPLE)
    half = math.exp(-0.5 * SAMPLE / lag)
    return np.asarray(half * y + (1.0 - half) * u) if sampled == "middle" else y


def low_pass(u: FloatArray, keep: float) -> FloatArray:
    """y (..., n) with y_0 = u_0 and y_i = keep y_(i-1) + (1 - keep) u_(i-1), u (..., n).

    In blocks, each a product with the same triangle. (scipy's ``lfilter`` does the same;
    its module alone takes longer to import than a recording to evaluate.)
    """
    n, (left, answer) = u.shape[-1], _block(keep)
    padded = np.concatenate([u, np.repeat(u[..., -1:], -n % BLOCK, axis=-1)], axis=-1)
    blocks = padded.reshape(*u.shape[:-1], -1, BLOCK)
    forced = blocks @ answer
    last = keep * forced[..., -1] + (1.0 - keep) * blocks[..., -1]
    begin, over = [u[..., 0]], keep**BLOCK
    # numbers are quicker than arrays of one
    for one in last.tolist() if u.ndim == 1 else np.moveaxis(last, -1, 0):
        begin.append(over * begin[-1] + one)
    # np.stack makes an array of each plain number
    starts = np.array(begin[:-1]) if u.ndim == 1 else np.stack(begin[:-1], axis=-1)
    out = forced + starts[..., None] * left
    return np.asarray(out.reshape(padded.shape)[..., :n])


@lru_cache(maxsize=8)
def _block(keep: float) -> tuple[FloatArray, FloatArray]:
    """Of a lag: what is left of y_0 after each sample of a block, and y (j) by u (i), (i, j)."""
    ahead = np.arange(BLOCK)
    since = ahead[None, :] - 1 - ahead[:, None]  # samples from u_i to y_j
    left = np.asarray(keep**ahead, dtype=np.float64)
    return left, np.where(since >= 0, (1.0 - keep) * left[np.maximum(since, 0)], 0.0)


def actuated(p: Vehicle, g: Grid, *, smooth: bool = False, sampled: Sampled = "start"
             ) -> tuple[FloatArray, FloatArray]:
    """(throttle -1..1, road-wheel angle [rad]) of every sample of a recording, (n,) each."""
    throttle, angle = (behind_actuator(p, channel, command, g.t, smooth=smooth, sampled=sampled)
                       for channel, command in (("throttle", g.throttle),
                                                ("steering", g.steering)))
    return throttle, angle


def behind_actuator(p: Vehicle, channel: str, command: FloatArray, t: FloatArray, *,
                    smooth: bool = False, sampled: Sampled = "start") -> FloatArray:
    """One command (n,) at times t (n,) behind its actuator: "throttle", or of "steering" the angle.

    smooth: as ``delayed``. As open-loop evaluation is defined, a lag is what it is
    when a sample starts, an effect with a memory what it has reached when it ends:
    5 ms late, and 5 ms early, where both are held over the sample; sampled "mean":
    the means over it instead. Errors: UsageError for an effect that wants to know
    the motion: it is not known before the rollout.
    """
    p = settled(p)
    delay, lag = (getattr(p.delay, f"{channel}{part}") for part in ("_s", "_lag_s"))
    return behind_lag(p, channel, first_order_lag(delayed(command, delay, smooth), lag, sampled),
                      t, sampled)


def behind_lag(p: Vehicle, channel: str, series: FloatArray, t: FloatArray,
               sampled: Sampled = "start") -> FloatArray:
    """What is left of ``behind_actuator`` of a settled vehicle after delay and lag (n,)."""
    series = reached(p, channel, series, t, sampled)
    return series if channel == "throttle" else turned(p, series, t, sampled)


def reached(p: Vehicle, channel: str, series: FloatArray, t: FloatArray,
            sampled: Sampled = "start") -> FloatArray:
    """A command (n,) after delay and lag behind the effects on it: where the servo is.

    Of the steering, nothing of the vehicle matters for that but these effects.
    """
    return _through(p, channel, series, t, sampled)


def turned(p: Vehicle, servo: FloatArray, t: FloatArray, sampled: Sampled = "start"
           ) -> FloatArray:
    """Road-wheel angle (n,) [rad] of a settled vehicle with its servo at (n,): map and linkage."""
    return _through(p, "angle", np.asarray(make_steering(p.steering, ARRAY)(servo)), t, sampled)


def _through(p: Vehicle, channel: str, series: FloatArray, t: FloatArray,
             sampled: Sampled) -> FloatArray:
    """The series (n,) behind the effects on its channel, in their order."""
    remembers = any(isinstance(hook, Stateful) for _, hook in signals(p, channel))
    parts = PARTS if sampled == "mean" and remembers else 1
    if parts > 1:
        series = np.repeat(series, parts)
        t = (t[:, None] + np.arange(parts) * SAMPLE / parts).ravel()
    # a hook that looks at the motion gets NaN, which nobody can overlook
    unmoved = Now(t, *[math.nan] * (len(Now._fields) - 1))
    out = np.asarray(channels.through(p, channel, series, unmoved, SAMPLE / parts))
    out = out.reshape(-1, parts).mean(axis=1) if parts > 1 else out
    if not np.isfinite(out).all():
        named = ", ".join(applied.name for applied, _ in signals(p, channel))
        raise UsageError(
            "an effect cannot enter an open-loop prediction",
            found=f"a change of the {channel} that depends on the motion of the car, in {named}",
            expected="one that depends on the command and on time",
            remedy="leave this effect out of the model")
    return out
