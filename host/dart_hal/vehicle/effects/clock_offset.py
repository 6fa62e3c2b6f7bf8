"""Clock offset: the sensors on the car are stamped by another clock.

    wheel, gyro and accelerometer at t show what was at t - k; k > 0: stamped too late
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Late, Parameter


def seconds(k: float) -> float:
    return k


EFFECT = Effect(
    name="clock_offset",
    title="has sensors whose clock is not that of commands and motion capture",
    signed_titles=("has sensors whose stamps are early", "has sensors whose stamps are late"),
    physics=(
        "Microcontroller and computer each have a clock; a wrong fit between them "
        "shifts all sensors on the car together, against commands and poses."),
    stage="measurement",
    acts_along=("acceleration", "steering_rate"),
    parameters=(Parameter("k", "s", -0.3, 0.3, sizes=(0.01, 0.03, 0.06),
                          meaning="time by which the stamps of the sensors are late"),),
    confused_with=("gyro_latency", "encoder_latency", "mocap_latency"),
    experiment=(
        "Turn and push the standing car by hand: gyro and encoder shifted by the same "
        "time against the poses is a clock, one of them alone is a latency."),
    signals={"wheel": Late(seconds), "gyro": Late(seconds), "accel": Late(seconds)},
)
