"""Latency of the gyro: its turning rate comes late.

    reading(t) = omega(t - k)
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Late, Parameter


def seconds(k: float) -> float:
    return k


EFFECT = Effect(
    name="gyro_latency",
    title="has a gyro whose turning rate comes late",
    physics=(
        "The filter inside the chip (32 Hz on a BNO055) and the wait until it is read "
        "delay it."),
    stage="measurement",
    acts_along=("steering_rate",),
    parameters=(Parameter("k", "s", 0.0, 0.5, sizes=(0.02, 0.04, 0.08),
                          meaning="additional age of the gyro's yaw rate"),),
    confused_with=("clock_offset", "mocap_latency", "steering_lag"),
    experiment=(
        "Steering changes to and fro, with encoder and motion capture beside: the gyro "
        "alone is late."),
    signals={"gyro": Late(seconds)},
)
