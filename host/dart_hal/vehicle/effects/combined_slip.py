"""Combined slip: a tyre that drives has less force left for the side.

    F_y sqrt(1 - k (F_x / 3 N)^2) at each axle, F_x its drive force; never below a tenth
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Forces, Parameter
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle

REACH = 3.0  # N, about what the front axle has
LEAST = 0.01


def force(p: Vehicle, f: Namespace, k: Value) -> Callable[[Forces], Forces]:
    def hook(q: Forces) -> Forces:
        def left(f_x: Value) -> Value:
            share = f_x / REACH
            return f.sqrt(f.fmax(LEAST, 1.0 - k * share * share))

        return q._replace(f_yf=q.f_yf * left(q.f_xf), f_yr=q.f_yr * left(q.f_xr))

    return hook


EFFECT = Effect(
    name="combined_slip",
    title="holds its line less well under drive force than the model",
    physics=(
        "Friction has one limit for both directions: what a tyre uses to drive or to "
        "brake, it lacks for the side."),
    stage="force",
    acts_along=("lateral_acceleration",),
    parameters=(Parameter("k", "-", 0.0, 4.0, sizes=(0.75, 1.5, 3.0),
                          meaning="share of the squared side force lost at 3 N of drive force"),),
    confused_with=("load_transfer", "rear_saturation", "grip", "cornering_drag"),
    experiment=(
        "A circle at constant speed, then the same circle accelerating and coasting "
        "through the same speed: only the drive force differs; load transfer changes "
        "sign between the two, this does not."),
    force=force,
)
