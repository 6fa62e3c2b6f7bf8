"""Latency of the gyro: its yaw rate is delayed.

    reading(t) = omega(t - k)
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter, PureDelay


def seconds(k: float) -> float:
    return k


EFFECT = Effect(
    name="gyro_latency",
    title="has a gyro whose yaw rate is delayed",
    physics="The filter of the chip (32 Hz on a BNO055) and the read.",
    stage="measurement",
    acts_along=("steering_rate",),
    parameters=(Parameter("k", "s", 0.0, 0.5, sizes=(0.02, 0.04, 0.08),
                          meaning="additional age of the gyro's yaw rate"),),
    confused_with=("clock_offset", "mocap_latency", "steering_lag"),
    experiment="Steer from side to side: only the gyro is delayed.",
    signals={"gyro": PureDelay(seconds)},
)
