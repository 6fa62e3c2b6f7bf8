"""Load transfer: forward acceleration moves load from the front to the rear axle.

    F_yf (1 - k a_x / g),  F_yr (1 + k a_x / g)      neither factor below 0

a_x: from the forces of the model.
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Forces, Parameter
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import GRAVITY, Vehicle


def force(p: Vehicle, f: Namespace, k: Value) -> Callable[[Forces], Forces]:
    per_mass = 1.0 / p.body.mass

    def hook(q: Forces) -> Forces:
        # Newton's law along the car, with the forces that earlier effects have changed.
        a_x = (q.f_xr + q.f_xf * q.cos_d - q.f_yf * q.sin_d + q.f_x) * per_mass
        share = k * a_x / GRAVITY
        return q._replace(f_yf=q.f_yf * f.fmax(0.0, 1.0 - share),
                          f_yr=q.f_yr * f.fmax(0.0, 1.0 + share))

    return hook


EFFECT = Effect(
    name="load_transfer",
    title="shifts grip between its axles when it speeds up or slows down",
    physics="A load of a_x m h / l moves between the axles; k is nearly 2 h / l.",
    stage="force",
    acts_along=("acceleration",),
    parameters=(Parameter("k", "-", 0.0, 3.0, sizes=(0.2, 0.4, 0.8),
                          meaning="share of the side force that 1 g moves to the rear axle"),),
    confused_with=("combined_slip", "front_grip", "yaw_damping"),
    experiment="One circle with acceleration and coasting: the radius grows, then shrinks.",
    force=force,
)
