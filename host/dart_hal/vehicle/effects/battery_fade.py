"""Battery fade: the motor becomes weaker while the car drives.

    F_m times 1 + k t / 100 s. As a signal: that throttle which gives this force,
    tau + (k t / 100 s) (T(tau) - T(-tau)) with the dead band T of the motor
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.motor import make_dead_band
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def faded(p: Vehicle, f: Namespace, k: Value) -> Callable[[Value, Now], Value]:
    band = make_dead_band(p.motor.g, f)

    def signal(v: Value, now: Now) -> Value:
        past = band(v) - band(-v)
        return v + 0.01 * k * now.t * past

    return signal


EFFECT = Effect(
    name="battery_fade",
    title="loses or gains motor force during a drive",
    signed_titles=("loses motor force during a drive", "gains motor force during a drive"),
    physics=(
        "The voltage of a battery sags while it is drained, the motor warms and its "
        "winding resists more: force falls in proportion to time, for every throttle."),
    stage="actuator",
    acts_along=("time", "throttle"),
    parameters=(Parameter("k", "1/100 s", -0.5, 0.3, sizes=(0.03, 0.08, 0.15),
                          meaning="change of the motor force in 100 s of driving"),),
    confused_with=("motor_gain", "quadratic_drag", "rolling_resistance"),
    experiment=(
        "The same throttle step from standstill at the start and at the end of a long "
        "drive, and coasting beside each: coasting stays the same when it is the "
        "battery."),
    signals={"throttle": Static(faded)},
)
