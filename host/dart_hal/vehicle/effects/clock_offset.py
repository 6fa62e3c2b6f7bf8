"""Clock offset: the sensors on the car are stamped by another clock.

    reading(t) = true(t - k) for wheel, gyro and accelerometer; k > 0: stamped too late
"""

from __future__ import annotations

from dart_hal.vehicle.effect import Effect, Parameter, PureDelay


def seconds(k: float) -> float:
    return k


EFFECT = Effect(
    name="clock_offset",
    title="has sensors whose clock is not that of commands and motion capture",
    signed_titles=("has sensors whose stamps are early", "has sensors whose stamps are late"),
    physics="A wrong fit between the clocks of microcontroller and computer.",
    stage="measurement",
    acts_along=("acceleration", "steering_rate"),
    parameters=(Parameter("k", "s", -0.3, 0.3, sizes=(0.01, 0.03, 0.06),
                          meaning="time by which the stamps of the sensors are late"),),
    confused_with=("gyro_latency", "encoder_latency", "mocap_latency"),
    experiment="Turn and push the car by hand: gyro and encoder shift equally.",
    signals={"wheel": PureDelay(seconds), "gyro": PureDelay(seconds), "accel": PureDelay(seconds)},
)
