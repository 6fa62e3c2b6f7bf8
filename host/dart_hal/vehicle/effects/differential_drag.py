"""Differential drag: wheels that cannot turn at different speeds resist a curve.

    M_z = -k omega / max(|v_x|, 0.3 m/s)
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Forces, Parameter
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle

MIN_TURN_SPEED = 0.3  # m/s; keeps the curvature finite at rest


def force(p: Vehicle, f: Namespace, k: Value) -> Callable[[Forces], Forces]:
    def hook(q: Forces) -> Forces:
        curvature = q.omega / f.fmax(f.fabs(q.v_x), MIN_TURN_SPEED)
        return q._replace(m_z=q.m_z - k * curvature)

    return hook


EFFECT = Effect(
    name="differential_drag",
    title="resists being turned more than the model",
    physics="A stiff differential drives inner and outer wheel at one speed.",
    stage="force",
    acts_along=("steering_angle", "yaw_rate"),
    parameters=(Parameter("k", "N m2", 0.0, 0.5, sizes=(0.01, 0.02, 0.04),
                          meaning="moment against turning per 1/m of curvature"),),
    confused_with=("yaw_damping", "cornering_drag", "steering_gain", "front_grip"),
    experiment="Circles of one command at all speeds. The slow one widens too.",
    force=force,
)
