"""Yaw damping: a moment against the yaw rate.

    M_z = -k omega
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Forces, Parameter
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def force(p: Vehicle, f: Namespace, k: Value) -> Callable[[Forces], Forces]:
    def hook(q: Forces) -> Forces:
        return q._replace(m_z=q.m_z - k * q.omega)

    return hook


EFFECT = Effect(
    name="yaw_damping",
    title="turns more slowly than the model",
    physics=(
        "Tyres resist rotation on the floor; the tyre of the bicycle model is a point."),
    stage="force",
    acts_along=("yaw_rate",),
    parameters=(Parameter("k", "N m s", 0.0, 0.2, sizes=(0.003, 0.01, 0.03),
                          meaning="moment against turning per rad/s of yaw rate"),),
    confused_with=("differential_drag", "yaw_inertia", "front_grip", "rear_saturation"),
    experiment="Steering steps: damping lowers the steady yaw rate, inertia only its rise.",
    force=force,
)
