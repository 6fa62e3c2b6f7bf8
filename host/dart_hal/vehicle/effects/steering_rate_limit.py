"""Steering rate limit: the servo has a top speed.

    |ds/dt| <= 1/k      s: position of the servo, as a command
"""

from __future__ import annotations

import math
from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Now, Parameter, Stateful
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def limit_rate(p: Vehicle, f: Namespace, dt: Value, k: Value) -> tuple[
        Callable[[Value], tuple[Value]], Callable[[Value, Now, Value], tuple[Value, Value]]]:
    def step(v: Value, now: Now, reached: Value) -> tuple[Value, Value]:
        error = v - reached
        # reached + clip(error, -dt / k, dt / k), written so that k = 0 gives exactly v
        out = v - (error - error / f.fmax(1.0, f.fabs(error) * k / dt))
        return out, out

    return lambda v: (v,), step


def slack(dt: float, k: float) -> float:
    """Return the largest change of the command in one step that the servo follows."""
    return dt / k if k > 0.0 else math.inf


EFFECT = Effect(
    name="steering_rate_limit",
    title="turns its wheels no faster than a limit",
    physics=(
        "A servo has a top speed, lower with a weak supply."),
    stage="actuator",
    acts_along=("steering_rate",),
    parameters=(Parameter("k", "s", 0.0, 2.0, sizes=(0.125, 0.25, 0.5),
                          meaning="time from straight ahead to full lock"),),
    confused_with=("steering_lag", "steering_delay"),
    experiment="Steering steps: the time grows with the step; a lag's is constant.",
    signals={"steering": Stateful(limit_rate, blind=True, slack=slack)},
)
