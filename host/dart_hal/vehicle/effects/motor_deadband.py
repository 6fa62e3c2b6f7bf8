"""Motor dead band: the throttle at which the motor begins to pull.

    T(tau) = smooth max(0, tau + g - k)
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter
from dart_hal.vehicle.flat import unchecked
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import Vehicle


def vehicle(p: Vehicle, k: Value) -> Vehicle:
    return unchecked(p, {"motor": {"g": p.motor.g - k}})


EFFECT = Effect(
    name="motor_deadband",
    title="begins to pull at more or less throttle than the model",
    signed_titles=(
        "begins to pull at less throttle than the model",
        "begins to pull at more throttle than the model"),
    physics=(
        "Neutral of the ESC drifts with temperature and with how it was taught; brushes "
        "and gears stick until the torque suffices."),
    stage="actuator",
    acts_along=("throttle", "acceleration"),
    parameters=(Parameter("k", "-", -0.1, 0.1, sizes=(0.005, 0.01, 0.02),
                          meaning="additional throttle at which the motor begins to pull"),),
    confused_with=("motor_gain", "rolling_resistance", "pwm_clock"),
    experiment=(
        "Steady speeds on a straight at many levels of throttle, small ones above all: "
        "a dead band shifts the curve of speed over throttle sideways, a gain tilts it."),
    vehicle=vehicle,
)
