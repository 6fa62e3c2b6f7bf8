"""What a State becomes: upstream's topics of car number N."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import nan

from dart_hal.core.types import ExternalPose, State
from dart_lab.live.ros.messages import (
    Message,
    external_pose,
    number,
    numbers,
    odometry,
    transform,
)

HEARD = {"safety_value": "safety", "throttle_{n}": "throttle", "steering_{n}": "steering"}
"""Topic, and the method of ``Commands`` that takes its number; std_msgs/Float32."""
REAL = {"sensors_and_input_{n}": "std_msgs/Float32MultiArray",
        "arduino_data_{n}": "std_msgs/Float32MultiArray",
        "odom_{n}": "nav_msgs/Odometry", "/tf": "tf2_msgs/TFMessage",
        "commands_timestamped_car_{n}": "std_msgs/Float64MultiArray"}
"""Topic and type of what is told of every car. The last is advertised, as upstream does, and never
sent."""
SIMULATED = {"vicon/jetracer{n}": "geometry_msgs/PoseWithCovarianceStamped",
             "vx_{n}": "std_msgs/Float32", "vy_{n}": "std_msgs/Float32",
             "omega_{n}": "std_msgs/Float32"}
"""Of a simulated car besides: a real one's are the motion capture's to tell."""


def topics(number: int, simulated: bool) -> dict[str, str]:
    """Topic: type of all that is told."""
    kinds = {**REAL, **SIMULATED} if simulated else REAL
    return {topic.format(n=number): kind for topic, kind in kinds.items()}


def heard(number: int) -> dict[str, str]:
    """Topic: method of ``Commands``."""
    return {topic.format(n=number): method for topic, method in HEARD.items()}


@dataclass(slots=True)
class Told:
    """l_r [m]: centre of mass to rear axle."""

    number: int
    l_r: float
    simulated: bool
    _began: float | None = None
    _newest: ExternalPose | None = None

    def messages(self, state: State, logged: tuple[float, float, float], epoch: float
                 ) -> Iterator[tuple[str, Message]]:
        """(topic, message) of one State; logged: safety, throttle, steering as sent; epoch [s]: 0
        of the car's clock, since 1970.

        What the IMU cannot tell is NaN; a controller that makes NaN of it is refused. Nobody
        measures current and voltage: 0, as in upstream's recordings. ``vy`` is that of the centre
        of mass over a rear axle that does not slip.
        """
        n, stamp = self.number, epoch + state.t
        self._began = state.t if self._began is None else self._began
        moves = (_or_nan(state.accel_x), _or_nan(state.accel_y), _or_nan(state.yaw_rate),
                 abs(state.speed))
        yield f"sensors_and_input_{n}", numbers((state.t - self._began, 0.0, 0.0, *moves, *logged))
        yield f"arduino_data_{n}", numbers(moves)
        frames = f"odom_{n}", f"base_link_{n}"
        yield f"odom_{n}", odometry(state, stamp, *frames)
        yield "/tf", transform(state.pose, stamp, *frames)
        if self.simulated:
            yield from self._as_simulator(state, epoch)

    def _as_simulator(self, state: State, epoch: float
                      ) -> Iterator[tuple[str, Message]]:
        n, rate = self.number, _or_nan(state.yaw_rate)
        yield f"vx_{n}", number(state.speed)
        yield f"vy_{n}", number(self.l_r * rate)
        yield f"omega_{n}", number(rate)
        newest = state.external.newest if state.external else None
        if newest is not None and newest is not self._newest:
            self._newest = newest
            yield f"vicon/jetracer{n}", external_pose(newest, epoch + newest.arrival)


def _or_nan(value: float | None) -> float:
    return nan if value is None else value
