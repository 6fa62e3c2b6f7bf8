"""Motor saturation: above a level more throttle brings no more force.

    |tau| <= 1/k
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def limited(p: Vehicle, f: Namespace, k: Value) -> Callable[[Value, Now], Value]:
    def signal(v: Value, now: Now) -> Value:
        return v / f.fmax(1.0, k * f.fabs(v))

    return signal


EFFECT = Effect(
    name="motor_saturation",
    title="does not pull harder above a level of throttle",
    physics=(
        "The ESC limits its current, or a stop of the radio's throttle was taught too "
        "near."),
    stage="actuator",
    acts_along=("throttle", "acceleration"),
    parameters=(Parameter("k", "-", 0.0, 20.0, sizes=(2.8, 3.3, 4.0),
                          meaning="inverse of the throttle above which the force is constant"),),
    confused_with=("motor_gain", "quadratic_drag", "throttle_lag"),
    experiment=(
        "Throttle steps from standstill to rising levels, beyond 0.4: the first "
        "acceleration stops growing; drag shows only once the car is fast."),
    signals={"throttle": Static(limited)},
)
