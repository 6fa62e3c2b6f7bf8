"""What the actuators did with the logged commands: delay, lag, steering map, effects on them.

All of it runs from the start of a recording, so that a window inherits what
came before it.
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

PARTS = 4  # of a sample, in which an effect with a memory has its mean


def delay_command(command: FloatArray, delay: float, smooth: bool = False) -> FloatArray:
    """The command (n,) ``delay`` [s] later, or below 0 earlier; its ends are held.

    By whole samples, as open-loop evaluation is defined; smooth: linear between samples, so that a
    fit can find a delay below the step of the grid.
    """
    return np.asarray(delay_series(
        command, delay if smooth else SAMPLE * round(delay / SAMPLE), SAMPLE))


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

    smooth: as ``delay_command``. As open-loop evaluation is defined, a lag is what it is
    when a sample starts, an effect with a memory what it has reached when it ends:
    5 ms late, and 5 ms early, where both are held over the sample; sampled "mean":
    the means over it instead. Errors: UsageError for an effect that wants to know
    the motion: it is not known before the rollout.
    """
    p = apply_parameter_effects(p)
    delay, lag = (getattr(p.delay, f"{channel}{part}") for part in ("_s", "_lag_s"))
    lagged = first_order_lag(delay_command(command, delay, smooth), lag, sampled)
    return behind_lag(p, channel, lagged, t, sampled)


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
