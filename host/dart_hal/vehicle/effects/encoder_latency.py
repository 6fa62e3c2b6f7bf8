"""Latency of the encoder: its speed is delayed.

    reading(t) = v(t - k)
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter, PureDelay


def seconds(k: float) -> float:
    return k


EFFECT = Effect(
    name="encoder_latency",
    title="has an encoder whose speed is delayed",
    physics=(
        "A mean over the last 0.1 s is 0.05 s old, and is read later."),
    stage="measurement",
    acts_along=("acceleration",),
    parameters=(Parameter("k", "s", 0.0, 0.5, sizes=(0.01, 0.03, 0.06),
                          meaning="additional age of the encoder's speed"),),
    confused_with=("clock_offset", "mocap_latency", "encoder_slip"),
    experiment="Hard throttle steps: only the encoder is delayed.",
    signals={"wheel": PureDelay(seconds)},
)
