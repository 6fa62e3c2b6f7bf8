"""Tail fin: air at the rear axle resists moving sideways.

    F_yr = F_yr(tyre) - k v_x (v_y - l_r omega)
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Forces, Parameter
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def force(p: Vehicle, f: Namespace, k: Value) -> Callable[[Forces], Forces]:
    """Return what the fin changes in the forces of the model."""
    l_r = p.body.l_r

    def hook(q: Forces) -> Forces:
        sideways = q.v_y - l_r * q.omega  # m/s, of the rear axle
        return q._replace(f_yr=q.f_yr - k * q.v_x * sideways)

    return hook


EFFECT = Effect(
    name="tail_fin",
    title="resists sliding at the rear, more so at speed",
    physics=("A fin above the rear axle meets air from the side when the rear slides. Its force "
             "grows with the speed and with the angle between fin and path."),
    stage="force",
    acts_along=("yaw_rate", "vy"),
    parameters=(Parameter("k", "N s2/m2", 0.0, 20.0, sizes=(0.5, 1.5, 4.0),
                          meaning="side force per speed along and across"),),
    confused_with=("yaw_damping", "rear_saturation"),
    experiment=("Circles of one radius at rising speed: a fin adds to the side force with the "
                "square of the speed, a stiffer tyre at any speed alike."),
    force=force,
)
