"""Latency of the motion capture: poses are delayed.

    pose(t) = true pose(t - k)
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter, PureDelay


def seconds(k: float) -> float:
    return k


EFFECT = Effect(
    name="mocap_latency",
    title="has delayed poses from the motion capture",
    physics="Cameras, computer and network delay the pose.",
    stage="measurement",
    acts_along=("speed", "yaw_rate"),
    parameters=(Parameter("k", "s", 0.0, 0.3, sizes=(0.01, 0.03, 0.06),
                          meaning="additional age of the poses"),),
    confused_with=("steering_delay", "throttle_delay", "clock_offset"),
    experiment="Turn the car by hand: gyro against the yaw rate of the pose.",
    signals={"pose": PureDelay(seconds)},
)
