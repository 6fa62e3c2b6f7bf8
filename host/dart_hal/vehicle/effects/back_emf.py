"""Back EMF at every throttle: force that the motor loses with speed, not only at much throttle.

    F_m - k v     while the motor pulls forward, at least 0;     F_m: force of the model's motor

The model's motor loses e v T(tau), in proportion to the throttle, as one whose current the ESC
sets. A motor whose voltage the ESC sets loses the same at every throttle.
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Forces, Parameter
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def force(p: Vehicle, f: Namespace, k: Value) -> Callable[[Forces], Forces]:
    friction = make_friction(p.friction, f)
    share = p.body.front_share

    def hook(q: Forces) -> Forces:
        pull = f.fmax(0.0, q.f_xf + q.f_xr - friction(q.v_x))
        # The ESC does not brake: the loss is at most the pull.
        loss = f.fmin(pull, k * f.fmax(0.0, q.v_x))
        return q._replace(f_xf=q.f_xf - share * loss, f_xr=q.f_xr - (1.0 - share) * loss)

    return hook


EFFECT = Effect(
    name="back_emf",
    title="pulls less at speed than the model, at little throttle too",
    physics="The ESC sets the motor's voltage, of which the back EMF takes the same at every "
            "throttle.",
    stage="force",
    duty_only=True,
    acts_along=("speed", "throttle"),
    parameters=(Parameter("k", "N s/m", 0.0, 4.0, sizes=(0.2, 0.5, 1.0),
                          meaning="force lost per speed while the motor pulls"),),
    confused_with=("motor_gain", "motor_deadband", "quadratic_drag", "rolling_resistance"),
    experiment="Steady speeds at several throttles, and coasting from each: this loss is none "
               "while the car coasts.",
    force=force,
)
