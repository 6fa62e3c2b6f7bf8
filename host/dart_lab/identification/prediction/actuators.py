"""Simulation of the actuators: delay, lag, steering map and effects on the logged commands.

It runs from the start of a recording, so that a window begins with the memory of all before it.
"""

from __future__ import annotations

import math

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Grid
from dart_hal.vehicle import channels
from dart_hal.vehicle.compose import apply_parameter_effects, signals
from dart_hal.vehicle.delay import Sampled as Sampled
from dart_hal.vehicle.delay import delay_series, first_order_lag
from dart_hal.vehicle.effect import Now, Stateful
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering

# Parts of a sample over which the output of an effect with a memory is averaged.
PARTS = 4


def delay_command(command: FloatArray, delay: float, smooth: bool = False) -> FloatArray:
    """Delay a command (n,) by ``delay`` [s], below 0: advance it; its ends are held.

    By whole samples, as open-loop evaluation is defined; smooth: linear between samples, so that a
    fit can find a delay below the step of the grid.
    """
    return np.asarray(delay_series(
        command, delay if smooth else SAMPLE * round(delay / SAMPLE), SAMPLE))


def actuator_outputs(p: Vehicle, g: Grid, *, smooth: bool = False, sampled: Sampled = "start"
                     ) -> tuple[FloatArray, FloatArray]:
    """Simulate (throttle -1..1, road-wheel angle [rad]) of a recording, (n,) each."""
    throttle, angle = (behind_actuator(p, channel, command, g, smooth=smooth, sampled=sampled)
                       for channel, command in (("throttle", g.throttle),
                                                ("steering", g.steering)))
    return throttle, angle


def behind_actuator(p: Vehicle, channel: str, command: FloatArray, g: Grid, *,
                    smooth: bool = False, sampled: Sampled = "start") -> FloatArray:
    """Simulate one actuator at the times of g (n,): "throttle", or for "steering" the angle [rad].

    smooth: as ``delay_command``. As open-loop evaluation is defined, a sample holds the output of
    a lag at its start (5 ms old in the mean) and the output of an effect with a memory at its end
    (5 ms early); sampled "mean": the means over the sample instead. Raises UsageError for an
    effect that depends on the motion, which is not known before the rollout.
    """
    p = apply_parameter_effects(p)
    delay, lag = (getattr(p.delay, f"{channel}{part}") for part in ("_s", "_lag_s"))
    lagged = first_order_lag(delay_command(command, delay, smooth), lag, sampled)
    return behind_lag(p, channel, lagged, g, sampled)


def behind_lag(p: Vehicle, channel: str, series: FloatArray, g: Grid,
               sampled: Sampled = "start") -> FloatArray:
    """Simulate ``behind_actuator`` from the output (n,) of delay and lag on.

    p: with its parameter effects applied.
    """
    series = apply_command_effects(p, channel, series, g, sampled)
    return series if channel == "throttle" else road_wheel_angle(p, series, g, sampled)


def apply_command_effects(p: Vehicle, channel: str, series: FloatArray, g: Grid,
                          sampled: Sampled = "start") -> FloatArray:
    """Apply the effects on a command to the output (n,) of delay and lag: the servo's position.

    The steering depends on no other part of the vehicle there.
    """
    return _apply_effects(p, channel, series, g, sampled)


def road_wheel_angle(p: Vehicle, servo: FloatArray, g: Grid, sampled: Sampled = "start"
                     ) -> FloatArray:
    """Compute the road-wheel angle (n,) [rad] from the servo's position (n,): map and linkage."""
    return _apply_effects(p, "angle", np.asarray(make_steering(p.steering, ARRAY)(servo)), g,
                          sampled)


def _apply_effects(p: Vehicle, channel: str, series: FloatArray, g: Grid,
                   sampled: Sampled) -> FloatArray:
    """Apply the effects on a channel to a series (n,), in their order."""
    remembers = any(isinstance(hook, Stateful) for _, hook in signals(p, channel))
    t = g.t
    voltage = g.voltage
    parts = PARTS if sampled == "mean" and remembers else 1
    if parts > 1:
        series = np.repeat(series, parts)
        t = (t[:, None] + np.arange(parts) * SAMPLE / parts).ravel()
        voltage = None if voltage is None else np.repeat(voltage, parts)
    # A hook that reads the motion gets NaN, which is detected below.
    unmoved = Now(t, *[math.nan] * (len(Now._fields) - 1))._replace(voltage=voltage)
    out = np.asarray(channels.transform_signal(p, channel, series, unmoved, SAMPLE / parts))
    out = out.reshape(-1, parts).mean(axis=1) if parts > 1 else out
    if not np.isfinite(out).all():
        named = ", ".join(applied.name for applied, _ in signals(p, channel))
        raise UsageError(
            "an effect cannot enter an open-loop prediction",
            found=f"a change of the {channel} that depends on the motion of the car, in {named}",
            expected="one that depends on the command and on time",
            remedy="leave this effect out of the model")
    return out
