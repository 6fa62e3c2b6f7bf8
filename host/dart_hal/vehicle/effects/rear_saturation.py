"""Rear saturation: the side force of the rear axle has a limit.

    F_yr / sqrt(1 + (k F_yr)^2)      below 1/k
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Forces, Parameter
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def force(p: Vehicle, f: Namespace, k: Value) -> Callable[[Forces], Forces]:
    def hook(q: Forces) -> Forces:
        divisor = f.sqrt(1.0 + (k * q.f_yr) * (k * q.f_yr))
        return q._replace(f_yr=q.f_yr / divisor)

    return hook


EFFECT = Effect(
    name="rear_saturation",
    title="has less side force at its rear wheels than the model",
    physics="A real rear tyre is limited near friction coefficient times load.",
    stage="force",
    acts_along=("lateral_acceleration",),
    parameters=(Parameter("k", "1/N", 0.0, 2.0, sizes=(0.15, 0.25, 0.40),
                          meaning="inverse of the largest side force of the rear tyres",
                          tops=True),),
    confused_with=("grip", "roll_compliance", "combined_slip", "yaw_damping"),
    experiment="Circles until the rear slides: only the largest forces are smaller.",
    force=force,
)
