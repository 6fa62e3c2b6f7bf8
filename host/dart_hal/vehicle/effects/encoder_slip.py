"""Slip of the driven wheels: under drive force they turn faster than the car moves.

    reading = v (1 + k F / m)      F: force of motor and friction at the wheels
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def add_slip(p: Vehicle, f: Namespace, k: Value) -> Callable[[Value, Now], Value]:
    def signal(v: Value, now: Now) -> Value:
        return v * (1.0 + k * now.drive / p.body.mass)

    return signal


EFFECT = Effect(
    name="encoder_slip",
    title="turns its wheels faster than it moves under drive force",
    physics=(
        "A tyre transmits force only with a small slip, proportional to the force."),
    stage="measurement",
    acts_along=("acceleration", "throttle"),
    parameters=(Parameter("k", "s2/m", 0.0, 0.2, sizes=(0.005, 0.015, 0.04),
                          meaning="slip of the wheels per m/s2 of drive"),),
    confused_with=("encoder_scale", "encoder_latency"),
    experiment="Accelerate and coast: the error changes sign with the force.",
    signals={"wheel": Static(add_slip)},
)
