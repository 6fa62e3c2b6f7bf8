"""Combined slip: a tyre under drive force has less side force.

    F_y sqrt(1 - k (F_x / 3 N)^2)      at each axle, F_x its drive force

This is the friction ellipse with half-axis 3 N / sqrt(k). The factor is at least 0.1.
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Forces, Parameter
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle

FORCE_SCALE = 3.0  # N, about the largest side force of the front axle
MIN_SQUARED_SHARE = 0.01  # square of the smallest factor, 0.1


def force(p: Vehicle, f: Namespace, k: Value) -> Callable[[Forces], Forces]:
    def hook(q: Forces) -> Forces:
        def side_factor(f_x: Value) -> Value:
            # Friction ellipse: (F_y / F_y0)^2 + k (F_x / 3 N)^2 = 1, F_y0 without drive force.
            share = f_x / FORCE_SCALE
            return f.sqrt(f.fmax(MIN_SQUARED_SHARE, 1.0 - k * share * share))

        return q._replace(f_yf=q.f_yf * side_factor(q.f_xf),
                          f_yr=q.f_yr * side_factor(q.f_xr))

    return hook


EFFECT = Effect(
    name="combined_slip",
    title="holds its line less well under drive force than the model",
    physics="A driving or braking tyre has less side force.",
    stage="force",
    acts_along=("lateral_acceleration",),
    parameters=(Parameter("k", "-", 0.0, 4.0, sizes=(0.75, 1.5, 3.0),
                          meaning="share of the squared side force lost at 3 N of drive force",
                          scales_as="1/N2"),),
    confused_with=("load_transfer", "rear_saturation", "grip", "cornering_drag"),
    experiment="One circle with acceleration and coasting. Load transfer changes its sign.",
    force=force,
)
