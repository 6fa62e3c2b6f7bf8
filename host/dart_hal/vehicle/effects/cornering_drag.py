"""Cornering drag: turned wheels slow the car.

    D    = -k |delta| tanh(v_x / 0.3 m/s)
    F_x  = (1 - s) D            along the car, at its centre of mass
    F_xf = s D                  along the steered wheels, where it turns the car as well
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Forces, Parameter
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle

DIRECTION_SPEED = 0.3  # m/s, at which the force changes from forward to reverse


def force(p: Vehicle, f: Namespace, k: Value, s: Value) -> Callable[[Forces], Forces]:
    def hook(q: Forces) -> Forces:
        turned = f.fabs(f.atan2(q.sin_d, q.cos_d))
        drag = -k * turned * f.tanh(q.v_x / DIRECTION_SPEED)
        return q._replace(f_x=q.f_x + (1.0 - s) * drag, f_xf=q.f_xf + s * drag)

    return hook


EFFECT = Effect(
    name="cornering_drag",
    title="loses speed with turned wheels more than the model",
    physics="Wheels that do not follow one circle scrub.",
    stage="force",
    acts_along=("steering_angle",),
    parameters=(Parameter("k", "N/rad", 0.0, 10.0, sizes=(0.3, 1.0, 2.0),
                          meaning="drag per radian of steering angle"),
                Parameter("s", "-", 0.0, 1.0, sizes=(0.25, 0.5, 1.0), alone=False,
                          meaning="share of the drag that acts along the steered wheels")),
    confused_with=("differential_drag", "quadratic_drag", "front_grip", "combined_slip"),
    experiment="Coasting on several radii and a straight: the loss depends on the angle.",
    force=force,
)
