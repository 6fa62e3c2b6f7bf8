"""Roll: leaning in a curve reduces the grip of both axles.

    F_y (1 - k (a_y / g)^2)      front and rear, the factor not below 0

a_y: from the forces of the model.
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Forces, Parameter
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import GRAVITY, Vehicle


def force(p: Vehicle, f: Namespace, k: Value) -> Callable[[Forces], Forces]:
    per_mass = 1.0 / p.body.mass

    def hook(q: Forces) -> Forces:
        # Newton's law across the car, with the forces that earlier effects have changed.
        a_y = (q.f_yr + q.f_yf * q.cos_d + q.f_xf * q.sin_d + q.f_y) * per_mass
        lean = a_y / GRAVITY
        factor = f.fmax(0.0, 1.0 - k * lean * lean)
        return q._replace(f_yf=q.f_yf * factor, f_yr=q.f_yr * factor)

    return hook


EFFECT = Effect(
    name="roll_compliance",
    title="loses grip in fast curves more than the model",
    physics="Outer wheels gain less grip than inner ones lose.",
    stage="force",
    acts_along=("lateral_acceleration",),
    parameters=(Parameter("k", "-", 0.0, 3.0, sizes=(0.2, 0.5, 1.0),
                          meaning="share of the side force lost at 1 g to the side"),),
    confused_with=("grip", "rear_saturation", "front_grip"),
    experiment="Circles of one radius: the loss grows with the square of the side acceleration.",
    force=force,
)
