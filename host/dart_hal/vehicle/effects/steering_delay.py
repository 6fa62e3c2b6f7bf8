"""Steering delay: the command acts a fixed time later.

    s(t) = command(t - k)
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter
from dart_hal.vehicle.flat import replace_unchecked
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import Vehicle


def vehicle(p: Vehicle, k: Value) -> Vehicle:
    return replace_unchecked(p, {"delay": {"steering_s": p.delay.steering_s + k}})


EFFECT = Effect(
    name="steering_delay",
    title="steers later than the model, by a fixed time",
    physics=(
        "Commands wait in queues: radio, bus, the 50 Hz frame of the servo."),
    stage="command",
    acts_along=("steering_rate",),
    parameters=(Parameter("k", "s", 0.0, 0.5, sizes=(0.02, 0.04, 0.08),
                          meaning="additional delay of the steering"),),
    confused_with=("steering_lag", "steering_rate_limit", "mocap_latency", "clock_offset"),
    experiment=(
        "Steering steps: a delay shifts them, a lag rounds them, a rate limit delays only large "
        "ones."),
    vehicle=vehicle,
)
