"""Messages of a State: the topics of car number N, as in DART's own software."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import nan

from dart_hal.core.types import ExternalPose, State
from dart_lab.live.ros.messages import (
    RosMessage,
    external_pose,
    number,
    numbers,
    odometry,
    transform,
)

# By topic (std_msgs/Float32), the method of ``Commands`` that receives its number.
INPUT_TOPICS = {"safety_value": "safety", "throttle_{n}": "throttle", "steering_{n}": "steering"}
# Topics of every car and their types. The last one is advertised, as in DART's software, and
# never sent.
REAL_TOPICS = {"sensors_and_input_{n}": "std_msgs/Float32MultiArray",
               "arduino_data_{n}": "std_msgs/Float32MultiArray",
               "odom_{n}": "nav_msgs/Odometry", "/tf": "tf2_msgs/TFMessage",
               "commands_timestamped_car_{n}": "std_msgs/Float64MultiArray"}
# More topics of a simulated car. For a real car the motion capture publishes them.
SIMULATED_TOPICS = {"vicon/jetracer{n}": "geometry_msgs/PoseWithCovarianceStamped",
                    "vx_{n}": "std_msgs/Float32", "vy_{n}": "std_msgs/Float32",
                    "omega_{n}": "std_msgs/Float32"}


def list_output_topics(number: int, simulated: bool) -> dict[str, str]:
    """Return by topic the type of each published message."""
    kinds = {**REAL_TOPICS, **SIMULATED_TOPICS} if simulated else REAL_TOPICS
    return {topic.format(n=number): kind for topic, kind in kinds.items()}


def list_input_topics(number: int) -> dict[str, str]:
    """Return by topic the method of ``Commands`` that receives its number."""
    return {topic.format(n=number): method for topic, method in INPUT_TOPICS.items()}


@dataclass(slots=True)
class TopicWriter:
    """Builds the messages of a State. l_r [m]: centre of mass to rear axle."""

    number: int
    l_r: float
    simulated: bool
    _start_t: float | None = None
    _newest: ExternalPose | None = None

    def messages(self, state: State, logged: tuple[float, float, float], epoch: float
                 ) -> Iterator[tuple[str, RosMessage]]:
        """Yield (topic, message) of one State.

        logged: safety, throttle, steering as sent. epoch [s]: zero of the car's clock, since 1970.
        Missing values of the IMU are NaN; a controller that then sends NaN gets neutral. Current
        and voltage are not measured: 0, as in DART's recordings. ``vy`` is the lateral speed of the
        centre of mass if the rear axle does not slip: v_y = l_r * yaw rate.
        """
        n = self.number
        stamp = epoch + state.t
        self._start_t = state.t if self._start_t is None else self._start_t
        moves = (_or_nan(state.accel_x), _or_nan(state.accel_y), _or_nan(state.yaw_rate),
                 abs(state.speed))
        yield f"sensors_and_input_{n}", numbers((state.t - self._start_t, 0.0, 0.0, *moves,
                                                 *logged))
        yield f"arduino_data_{n}", numbers(moves)
        frames = f"odom_{n}", f"base_link_{n}"
        yield f"odom_{n}", odometry(state, stamp, *frames)
        yield "/tf", transform(state.pose, stamp, *frames)
        if self.simulated:
            yield from self._as_simulator(state, epoch)

    def _as_simulator(self, state: State, epoch: float
                      ) -> Iterator[tuple[str, RosMessage]]:
        n = self.number
        rate = _or_nan(state.yaw_rate)
        yield f"vx_{n}", number(state.speed)
        yield f"vy_{n}", number(self.l_r * rate)
        yield f"omega_{n}", number(rate)
        newest = state.external.newest if state.external else None
        if newest is not None and newest is not self._newest:
            self._newest = newest
            yield f"vicon/jetracer{n}", external_pose(newest, epoch + newest.arrival)


def _or_nan(value: float | None) -> float:
    return nan if value is None else value
