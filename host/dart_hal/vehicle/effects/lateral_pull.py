"""Lateral pull: a moment that turns the moving car to one side.

    M_z = k tanh(v_x / 0.3 m/s)      zero at rest, opposite sign in reverse
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Forces, Parameter
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle

PULL_SPEED = 0.3  # m/s, at which the moment reaches 76 %


def force(p: Vehicle, f: Namespace, k: Value) -> Callable[[Forces], Forces]:
    def hook(q: Forces) -> Forces:
        return q._replace(m_z=q.m_z + k * f.tanh(q.v_x / PULL_SPEED))

    return hook


EFFECT = Effect(
    name="lateral_pull",
    title="pulls to one side",
    signed_titles=("pulls to the right", "pulls to the left"),
    physics=(
        "One wheel drags, or the tyres differ between left and right."),
    stage="force",
    acts_along=("speed",),
    parameters=(Parameter("k", "N m", -0.2, 0.2, sizes=(0.003, 0.01, 0.03),
                          meaning="moment that turns the moving car to the left"),),
    confused_with=("steering_trim", "gyro_bias", "mocap_yaw", "road_slope_x", "road_slope_y"),
    experiment=(
        "Straight drives in both directions. A slope keeps its side of the hall; a trim acts at "
        "walking pace too."),
    force=force,
)
