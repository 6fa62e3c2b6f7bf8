"""Motor dead band: the throttle at which the motor begins to pull.

    T(tau) = smooth max(0, tau + g - k)
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter
from dart_hal.vehicle.flat import replace_unchecked
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import Vehicle


def vehicle(p: Vehicle, k: Value) -> Vehicle:
    return replace_unchecked(p, {"motor": {"g": p.duty_motor.g - k}})


EFFECT = Effect(
    name="motor_deadband",
    title="begins to pull at more or less throttle than the model",
    signed_titles=(
        "begins to pull at less throttle than the model",
        "begins to pull at more throttle than the model"),
    physics="The neutral of the ESC depends on temperature.",
    stage="actuator",
    duty_only=True,
    acts_along=("throttle", "acceleration"),
    parameters=(Parameter("k", "-", -0.1, 0.1, sizes=(0.005, 0.01, 0.02),
                          meaning="additional throttle at which the motor begins to pull"),),
    confused_with=("motor_gain", "rolling_resistance", "pwm_clock"),
    experiment="Steady speeds at small throttle: it shifts the curve, a gain changes its slope.",
    vehicle=vehicle,
)
