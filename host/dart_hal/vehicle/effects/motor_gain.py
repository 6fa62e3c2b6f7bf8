"""Motor gain: all forces of the motor are larger or smaller by the same factor.

    F_m = (1 + k) (d - e v) T(tau)      one k for each recording

The forces of a speed loop are scaled in the same way: its gain and its largest force.
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter
from dart_hal.vehicle.flat import replace_unchecked
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import SpeedLoop, Vehicle


def vehicle(p: Vehicle, k: Value) -> Vehicle:
    scale = 1.0 + k
    if isinstance(p.motor, SpeedLoop):
        return replace_unchecked(p, {"motor": {"gain": p.motor.gain * scale,
                                               "max_force": p.motor.max_force * scale}})
    return replace_unchecked(p, {"motor": {"d": p.motor.d * scale, "e": p.motor.e * scale}})


EFFECT = Effect(
    name="motor_gain",
    title="has a stronger or weaker motor than the model",
    signed_titles=("has a weaker motor than the model", "has a stronger motor than the model"),
    physics="Full and half empty batteries differ by 15 %.",
    stage="actuator",
    acts_along=("throttle", "acceleration"),
    parameters=(
        Parameter("k", "relative", -0.5, 0.5, sizes=(0.03, 0.08, 0.15),
                  meaning="change of the motor force", per_recording=True),),
    confused_with=(
        "battery_fade", "quadratic_drag", "rolling_resistance", "mass", "motor_deadband"),
    experiment="Throttle steps and coasting with both. Only drag and mass change coasting.",
    vehicle=vehicle,
)
