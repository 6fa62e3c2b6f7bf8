"""Rear saturation: the side force of the rear axle bends and ends.

    F_yr / sqrt(1 + (k F_yr)^2): never more than 1/k
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Forces, Parameter
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def force(p: Vehicle, f: Namespace, k: Value) -> Callable[[Forces], Forces]:
    def hook(q: Forces) -> Forces:
        bent = f.sqrt(1.0 + (k * q.f_yr) * (k * q.f_yr))
        return q._replace(f_yr=q.f_yr / bent)

    return hook


EFFECT = Effect(
    name="rear_saturation",
    title="lets its rear wheels slide where the model's hold",
    physics=(
        "The rear tyre of the paper's model is a straight line without end. A real one "
        "gives way: its force has a limit near the grip of the floor times the load."),
    stage="force",
    acts_along=("lateral_acceleration",),
    parameters=(Parameter("k", "1/N", 0.0, 2.0, sizes=(0.15, 0.25, 0.40),
                          meaning="inverse of the largest side force of the rear tyres",
                          tops=True),),
    confused_with=("grip", "roll_compliance", "combined_slip", "yaw_damping"),
    experiment=(
        "Circles at rising speed until the rear slides, and a step of the steering at "
        "high speed: only the largest forces fall short, small ones are those of the "
        "model."),
    force=force,
)
