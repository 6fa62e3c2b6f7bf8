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
from dart_hal.vehicle.compose import settled, signals
from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.signals import through
from dart_hal.vehicle.steering import make_steering

SAMPLE = 0.01  # s, step of the grid


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


def lagged(command: FloatArray, lag: float) -> FloatArray:
    """First-order lag of time constant ``lag`` [s] of a series (n,), at rest at its start.

    y_0 = u_0, y_i = y_(i-1) + (1 - exp(-0.01/T)) (u_(i-1) - y_(i-1)).
    """
    from scipy.signal import lfilter

    if lag <= 0.0:
        return command
    keep = math.exp(-SAMPLE / lag)
    out, _ = lfilter([0.0, 1.0 - keep], [1.0, -keep], command, zi=command[:1])
    return np.asarray(out)


def actuated(p: Vehicle, g: Grid, *, smooth: bool = False) -> tuple[FloatArray, FloatArray]:
    """(throttle -1..1, road-wheel angle [rad]) of every sample of a recording, (n,) each.

    Effects of the vehicle that change commands or the angle are in it. Errors:
    UsageError for one that wants to know the motion: it is not known before
    the rollout.
    """
    p = settled(p)
    d = p.delay
    throttle = lagged(delayed(g.throttle, d.throttle_s, smooth), d.throttle_lag_s)
    steering = lagged(delayed(g.steering, d.steering_s, smooth), d.steering_lag_s)
    angle = np.asarray(make_steering(p.steering, ARRAY)(_through(p, "steering", steering, g.t)))
    return _through(p, "throttle", throttle, g.t), _through(p, "angle", angle, g.t)


def _through(p: Vehicle, channel: str, series: FloatArray, t: FloatArray) -> FloatArray:
    """The series (n,) behind the effects on its channel, in their order."""
    # a hook that looks at the motion gets NaN, which nobody can overlook
    unmoved = Now(t, *[math.nan] * (len(Now._fields) - 1))
    out = np.asarray(through(p, channel, series, unmoved, SAMPLE))
    if not np.isfinite(out).all():
        named = ", ".join(applied.name for applied, _ in signals(p, channel))
        raise UsageError(
            "an effect cannot enter an open-loop prediction",
            found=f"a change of the {channel} that depends on the motion of the car, in {named}",
            expected="one that depends on the command and on time",
            remedy="leave this effect out of the model")
    return out
