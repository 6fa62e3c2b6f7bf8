"""Motor saturation: above a level of throttle the force is constant.

    |tau| <= 1/k
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def limit_throttle(p: Vehicle, f: Namespace, k: Value) -> Callable[[Value, Now], Value]:
    def signal(v: Value, now: Now) -> Value:
        return v / f.fmax(1.0, k * f.fabs(v))

    return signal


EFFECT = Effect(
    name="motor_saturation",
    title="does not pull harder above a level of throttle",
    physics="The ESC limits its current, or the radio's end point is too low.",
    stage="actuator",
    duty_only=True,
    acts_along=("throttle", "acceleration"),
    parameters=(Parameter("k", "-", 0.0, 20.0, sizes=(2.8, 3.3, 4.0),
                          meaning="inverse of the throttle above which the force is constant"),),
    confused_with=("motor_gain", "quadratic_drag", "throttle_lag"),
    experiment="Throttle steps from standstill beyond 0.4: the first acceleration no longer grows.",
    signals={"throttle": Static(limit_throttle)},
)
