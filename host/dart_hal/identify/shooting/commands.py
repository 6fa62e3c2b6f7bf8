"""From logged commands to what the actuators do: delay, lag, steering map, and effects on them."""

from __future__ import annotations

import math

import numpy as np

from dart_hal.types import FloatArray
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.signals import through
from dart_hal.vehicle.steering import make_steering

SAMPLE = 0.01  # s, step of the grid


def delayed(command: FloatArray, delay: float) -> FloatArray:
    """The series (n,) ``delay`` [s] later, linear between samples, first value held before.

    Smooth in the delay, so that a fit can find it below the grid's step.
    """
    steps = np.arange(len(command)) - delay / SAMPLE
    return np.asarray(np.interp(steps, np.arange(len(command)), command))


def lagged(command: FloatArray, lag: float) -> FloatArray:
    """First-order lag of time constant ``lag`` [s], from the first value on; (n,)."""
    from scipy.signal import lfilter

    if lag <= 0.0:
        return command
    keep = math.exp(-SAMPLE / lag)
    before = np.concatenate([command[:1], command[:-1]])
    out, _ = lfilter([1.0 - keep], [1.0, -keep], before, zi=[keep * command[0]])
    return np.asarray(out)


def shaped(throttle: FloatArray, steering: FloatArray, p: Vehicle) -> tuple[FloatArray, FloatArray]:
    """(throttle as the motor has it, road-wheel angle [rad]), (n,) each, from the commands.

    throttle behind the safety gate, -1..1; on a grid of 0.01 s. Run it over a
    whole recording: delay and lag need what came before.
    """
    p, now = settled(p), Now(t=np.arange(len(throttle)) * SAMPLE)
    tau = lagged(delayed(throttle, p.delay.throttle_s), p.delay.throttle_lag_s)
    command = lagged(delayed(steering, p.delay.steering_s), p.delay.steering_lag_s)
    command = through(p, "steering", command, now, SAMPLE)
    angle = np.asarray(make_steering(p.steering, ARRAY)(command))
    return through(p, "throttle", tau, now, SAMPLE), through(p, "angle", angle, now, SAMPLE)
