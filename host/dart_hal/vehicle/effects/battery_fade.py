"""Battery fade: the motor becomes weaker while the car drives.

    F_m (1 + k t / 100 s)

As a signal, this is the throttle that gives the same force. The force is proportional to the
dead-band output T(tau) - T(-tau), so the throttle becomes

    tau + (k t / 100 s) (T(tau) - T(-tau))
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.motor import make_dead_band
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def fade_throttle(p: Vehicle, f: Namespace, k: Value) -> Callable[[Value, Now], Value]:
    band = make_dead_band(p.duty_motor.g, f)

    def signal(v: Value, now: Now) -> Value:
        effective = band(v) - band(-v)
        return v + 0.01 * k * now.t * effective

    return signal


EFFECT = Effect(
    name="battery_fade",
    title="loses or gains motor force during a drive",
    signed_titles=("loses motor force during a drive", "gains motor force during a drive"),
    physics="The voltage drops, and the warm winding has more resistance.",
    stage="actuator",
    duty_only=True,
    acts_along=("time", "throttle"),
    parameters=(Parameter("k", "1/100 s", -0.5, 0.3, sizes=(0.03, 0.08, 0.15),
                          meaning="change of the motor force in 100 s of driving"),),
    confused_with=("motor_gain", "quadratic_drag", "rolling_resistance"),
    experiment="Throttle steps at start and end of a drive. Coasting does not change.",
    signals={"throttle": Static(fade_throttle)},
)
