"""Throttle lag: the force of the motor follows its command like a first-order filter.

    tau' = (command - tau) / k

In addition to a lag of the model: the time constants add.
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter
from dart_hal.vehicle.flat import replace_unchecked
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import Vehicle


def vehicle(p: Vehicle, k: Value) -> Vehicle:
    return replace_unchecked(p, {"delay": {"throttle_lag_s": p.delay.throttle_lag_s + k}})


EFFECT = Effect(
    name="throttle_lag",
    title="responds to the throttle more slowly than the model",
    physics="The ESC ramps its duty cycle, and inductance delays the current.",
    stage="actuator",
    acts_along=("throttle", "acceleration"),
    parameters=(Parameter("k", "s", 0.0, 0.5, sizes=(0.04, 0.08, 0.16),
                          meaning="additional time constant of the throttle"),),
    confused_with=("throttle_delay", "mass"),
    experiment=(
        "Throttle steps: a lag rounds their start, a delay shifts it, mass changes the "
        "acceleration."),
    vehicle=vehicle,
)
