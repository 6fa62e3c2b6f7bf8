"""Throttle delay: the command acts a fixed time later.

    tau(t) = command(t - k)
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter
from dart_hal.vehicle.flat import replace_unchecked
from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.parameters import Vehicle


def vehicle(p: Vehicle, k: Value) -> Vehicle:
    return replace_unchecked(p, {"delay": {"throttle_s": p.delay.throttle_s + k}})


EFFECT = Effect(
    name="throttle_delay",
    title="responds to the throttle later than the model, by a fixed time",
    physics="Commands wait for the frame and the filter of the ESC.",
    stage="command",
    acts_along=("throttle", "acceleration"),
    parameters=(Parameter("k", "s", 0.0, 0.5, sizes=(0.03, 0.06, 0.12),
                          meaning="additional delay of the throttle"),),
    confused_with=("throttle_lag", "mocap_latency", "clock_offset"),
    experiment="Throttle steps: a delay shifts their start, a lag rounds it.",
    vehicle=vehicle,
)
