"""Centre of mass: it is further forward or backward than in the model.

    l_f - k,  l_r + k        k > 0: forward

Axle loads change with it for tyres that depend on the load. The paper's tyre forces are absolute
and do not change.
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter
from dart_hal.vehicle.flat import replace_unchecked
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import Vehicle


def vehicle(p: Vehicle, k: Value) -> Vehicle:
    return replace_unchecked(p, {"body": {"l_f": p.body.l_f - k, "l_r": p.body.l_r + k}})


EFFECT = Effect(
    name="centre_of_mass",
    title="has its weight further forward or backward than the model",
    signed_titles=(
        "has its weight further back than the model",
        "has its weight further forward than the model"),
    physics="A battery inserted the other way round moves it by 1 cm.",
    stage="motion",
    acts_along=("lateral_acceleration", "yaw_rate"),
    parameters=(Parameter("k", "m", -0.05, 0.05, sizes=(0.003, 0.006, 0.012),
                          meaning="distance of the centre of mass ahead of the model's"),),
    confused_with=("front_grip", "mocap_offset_x", "yaw_inertia", "grip"),
    experiment=(
        "Weigh both axles. Or circles at rising speed: the balance of front and rear changes."),
    vehicle=vehicle,
)
