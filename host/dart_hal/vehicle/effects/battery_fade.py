"""Battery fade: the motor becomes weaker while the car drives.

    F_m (1 + k d)
    d = (1 - V / V_m) / 10 %    if the model states motor_voltage V_m, the voltage of the battery
                                at which its motor parameters hold; 0 where V is not measured
    d = t / 100 s               if the model does not state it

The reference is a constant of the model, so that drives which start with a full and with a
half-empty battery start with different forces. As a signal, this is the throttle that gives the
same force. The force is proportional to the dead-band output T(tau) - T(-tau), so the throttle
becomes

    tau + k d (T(tau) - T(-tau))

A motor whose force is proportional to the voltage has k = -0.1.
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
        if p.motor_voltage is None:
            decline = 0.01 * now.t
        elif now.voltage is None:
            return v
        else:
            decline = 10.0 * (1.0 - now.voltage / p.motor_voltage)
        return v + k * decline * effective

    return signal


EFFECT = Effect(
    name="battery_fade",
    title="loses or gains motor force during a drive",
    signed_titles=("loses motor force during a drive", "gains motor force during a drive"),
    physics="The voltage drops, and the warm winding has more resistance.",
    stage="actuator",
    duty_only=True,
    acts_along=("time", "throttle"),
    parameters=(Parameter("k", "relative", -0.5, 0.3, sizes=(0.03, 0.08, 0.15),
                          meaning="change of the motor force by 10 % less voltage than the model's "
                                  "motor_voltage, or in 100 s if it states none"),),
    confused_with=("motor_gain", "quadratic_drag", "rolling_resistance"),
    experiment="Throttle steps at start and end of a drive. Coasting does not change.",
    signals={"throttle": Static(fade_throttle)},
)
