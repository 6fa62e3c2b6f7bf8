"""Grip: the side forces of both axles are larger or smaller by the same factor.

    (1 + k) F_y      front and rear
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter
from dart_hal.vehicle.flat import replace_unchecked
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import AxleTyres, Vehicle


def vehicle(p: Vehicle, k: Value) -> Vehicle:
    t = p.tyres
    factor = 1.0 + k
    if isinstance(t, AxleTyres):
        return replace_unchecked(p, {"tyres": {"front_D": t.front_D * factor,
                                       "rear_D": t.rear_D * factor}})
    stiffness = t.rear_cornering_stiffness * factor
    return replace_unchecked(p, {"tyres": {"front_D": t.front_D * factor,
                                           "rear_max": t.rear_max * factor,
                                           "rear_cornering_stiffness": stiffness}})


EFFECT = Effect(
    name="grip",
    title="has more or less grip than the model",
    signed_titles=("has less grip than the model", "has more grip than the model"),
    physics="Another floor, dust, or tyres that are worn or warm.",
    stage="force",
    acts_along=("lateral_acceleration",),
    parameters=(Parameter("k", "relative", -0.6, 0.6, sizes=(0.05, 0.1, 0.2),
                          meaning="change of the side force of all tyres"),),
    confused_with=("front_grip", "roll_compliance", "yaw_inertia", "steering_gain"),
    experiment=(
        "Circles of one command at rising speed. With less front grip the rear keeps its line."),
    vehicle=vehicle,
)
