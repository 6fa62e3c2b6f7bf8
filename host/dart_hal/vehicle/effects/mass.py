"""Mass: the car is heavier or lighter.

    m (1 + k)

Axle loads change with it for tyres that depend on the load. The paper's tyre forces, and friction,
are absolute and do not change.
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter
from dart_hal.vehicle.flat import replace_unchecked
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import Vehicle


def vehicle(p: Vehicle, k: Value) -> Vehicle:
    return replace_unchecked(p, {"body": {"mass": p.body.mass * (1.0 + k)}})


EFFECT = Effect(
    name="mass",
    title="is heavier or lighter than the model",
    signed_titles=("is lighter than the model", "is heavier than the model"),
    physics=(
        "A battery, sensor or mast was not weighed."),
    stage="motion",
    acts_along=("throttle", "acceleration"),
    parameters=(Parameter("k", "relative", -0.4, 1.0, sizes=(0.05, 0.1, 0.2),
                          meaning="change of the mass"),),
    confused_with=("motor_gain", "rolling_resistance", "grip", "throttle_lag"),
    experiment="Weigh the car. Or coast and accelerate: mass changes both, the motor only one.",
    vehicle=vehicle,
)
