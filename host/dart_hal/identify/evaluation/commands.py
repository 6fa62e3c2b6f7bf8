"""What the actuators did with the logged commands: delay, lag, steering map.

Both run from the start of the recording, so that a window inherits what came
before it.
"""

from __future__ import annotations

import math

import numpy as np

from dart_hal.recording.dart import Grid
from dart_hal.types import FloatArray
from dart_hal.vehicle.namespace import ARRAY
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
    """(throttle -1..1, road-wheel angle [rad]) of every sample of a recording, (n,) each."""
    d = p.delay
    throttle = lagged(delayed(g.throttle, d.throttle_s), d.throttle_lag_s)
    steering = lagged(delayed(g.steering, d.steering_s), d.steering_lag_s)
    return throttle, np.asarray(make_steering(p.steering, ARRAY)(steering))
