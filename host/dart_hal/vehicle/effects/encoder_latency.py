"""Latency of the encoder: its speed comes late.

    reading(t) = v(t - k)
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Late, Parameter


def seconds(k: float) -> float:
    return k


EFFECT = Effect(
    name="encoder_latency",
    title="has an encoder whose speed comes late",
    physics=(
        "A mean over the last 0.1 s is 0.05 s old, then it waits to be fetched: more "
        "than the model of the sensor allows for."),
    stage="measurement",
    acts_along=("acceleration",),
    parameters=(Parameter("k", "s", 0.0, 0.5, sizes=(0.01, 0.03, 0.06),
                          meaning="additional age of the encoder's speed"),),
    confused_with=("clock_offset", "mocap_latency", "encoder_slip"),
    experiment=(
        "Hard throttle steps, with gyro and motion capture beside: the encoder alone is "
        "late."),
    signals={"wheel": Late(seconds)},
)
