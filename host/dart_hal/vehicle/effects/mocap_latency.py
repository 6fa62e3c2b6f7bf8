"""Latency of the motion capture: poses come late.

    pose(t) = true pose(t - k)
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Late, Parameter


def seconds(k: float) -> float:
    return k


EFFECT = Effect(
    name="mocap_latency",
    title="is seen late by the motion capture",
    physics=(
        "Cameras expose, a computer solves, a network carries: the stamp is that of the "
        "arrival."),
    stage="measurement",
    acts_along=("speed", "yaw_rate"),
    parameters=(Parameter("k", "s", 0.0, 0.3, sizes=(0.01, 0.03, 0.06),
                          meaning="additional age of the poses"),),
    confused_with=("steering_delay", "throttle_delay", "clock_offset"),
    experiment=(
        "Turn the standing car by hand to and fro: gyro against the turning rate of the "
        "pose shows the latency, without command or actuator."),
    signals={"pose": Late(seconds)},
)
