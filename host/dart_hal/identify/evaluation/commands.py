"""What the actuators did with the logged commands: delay, lag, steering map.

Both run from the start of the recording, so that a window inherits what came
before it.
"""

from __future__ import annotations

import math

import numpy as np

from dart_hal.errors import UsageError
from dart_hal.recording.dart import Grid
from dart_hal.types import FloatArray
from dart_hal.vehicle.compose import settled, signals
from dart_hal.vehicle.effect import Late, Now, Signal, Static
from dart_hal.vehicle.namespace import ARRAY, SCALAR, Value
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering

from .windows import SAMPLE


def delayed(command: FloatArray, delay: float) -> FloatArray:
    """The series (n,) ``delay`` [s] later, by whole samples; before: its first value."""
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


def actuated(p: Vehicle, g: Grid) -> tuple[FloatArray, FloatArray]:
    """(throttle -1..1, road-wheel angle [rad]) of every sample of a recording, (n,) each.

    Effects of the vehicle that change commands or the angle are in it. Errors:
    UsageError for one that wants to know the motion: it is not known before
    the rollout.
    """
    p = settled(p)
    d = p.delay
    throttle = lagged(delayed(g.throttle, d.throttle_s), d.throttle_lag_s)
    steering = lagged(delayed(g.steering, d.steering_s), d.steering_lag_s)
    angle = np.asarray(make_steering(p.steering, ARRAY)(_through(p, "steering", steering, g.t)))
    return _through(p, "throttle", throttle, g.t), _through(p, "angle", angle, g.t)


def _through(p: Vehicle, channel: str, series: FloatArray, t: FloatArray) -> FloatArray:
    """The series (n,) behind the effects on its channel, in their order."""
    for applied, signal in signals(p, channel):
        series = _behind(p, signal, applied.values, series, t)
        if not np.isfinite(series).all():
            raise UsageError(
                f"the effect {applied.name!r} cannot enter an open-loop prediction here",
                found=f"a change of the {channel} that depends on the motion of the car",
                expected="one that depends on the command and on time",
                remedy="evaluate the model without this effect")
    return series


def _behind(p: Vehicle, signal: Signal, values: tuple[Value, ...], series: FloatArray,
            t: FloatArray) -> FloatArray:
    if isinstance(signal, Late):
        return delayed(series, max(float(signal.seconds(*values)), 0.0))
    if isinstance(signal, Static):
        changed = signal.make(p, ARRAY, *values)(series, _unmoved(t))
        return np.asarray(np.broadcast_to(changed, series.shape))
    first, step = signal.make(p, SCALAR, SAMPLE, *values)
    state, out = first(float(series[0])), np.empty(len(series))
    for i, value in enumerate(series.tolist()):
        new = step(value, _unmoved(float(t[i])), *state)
        out[i], state = new[0], new[1:]
    return out


def _unmoved(t: Value) -> Now:
    """A hook that looks at the motion gets NaN, which nobody can overlook."""
    return Now(t, *[math.nan] * (len(Now._fields) - 1))
