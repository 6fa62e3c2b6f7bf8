"""Steering lag: the servo follows its command like a first-order filter.

    s' = (command - s) / k

In addition to a lag of the model: the time constants add.
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter
from dart_hal.vehicle.flat import replace_unchecked
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import Vehicle


def vehicle(p: Vehicle, k: Value) -> Vehicle:
    return replace_unchecked(p, {"delay": {"steering_lag_s": p.delay.steering_lag_s + k}})


EFFECT = Effect(
    name="steering_lag",
    title="turns its wheels more slowly than the model",
    physics="The position loop of the servo and elasticity behind it.",
    stage="actuator",
    acts_along=("steering_rate",),
    parameters=(Parameter("k", "s", 0.0, 0.5, sizes=(0.03, 0.06, 0.12),
                          meaning="additional time constant of the steering"),),
    confused_with=("steering_delay", "steering_rate_limit", "yaw_inertia"),
    experiment=(
        "Steering steps: a lag has one shape for all sizes, a rate limit has not. Yaw inertia "
        "acts only at speed."),
    vehicle=vehicle,
)
