"""Connect a car with the topics of a middleware such as ROS."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Protocol

from dart_hal.car import Car
from dart_hal.car.lidar import mount_of
from dart_hal.core.process.suspend import elapsed
from dart_hal.core.types import State
from dart_lab.live.ros.commands import Commands
from dart_lab.live.ros.messages import RosMessage
from dart_lab.live.ros.told import (
    LATCHED_TOPICS,
    TopicWriter,
    list_input_topics,
    list_output_topics,
)

ROS_COMMAND_SOURCE = "ros"
# Validity of a command to the car: 15 States. If this program hangs just before it detects a
# silent publisher (after MAX_MESSAGE_AGE_S), the ESC is neutral one PWM frame after 0.45 s, and
# the car is tripped.
COMMAND_VALIDITY_S = 0.15


class Middleware(Protocol):
    """Transport of messages. ``heard`` may be called in any thread."""

    @property
    def is_closed(self) -> bool:
        """Whether the node ends."""

    def subscribe(self, topic: str, heard: Callable[[float], None]) -> None:
        """Call ``heard(value)`` for each std_msgs/Float32; only for the newest of several."""

    def advertise(self, topic: str, kind: str, latched: bool) -> None:
        """Offer a topic; kind: its type, such as "std_msgs/Float32"; latched: a later subscriber
        gets its last message."""

    def publish(self, topic: str, message: RosMessage) -> None:
        """Publish a message of an advertised topic, without waiting for subscribers."""

    def close(self) -> None:
        """Leave the network; idempotent."""


class Bridge:
    """Car ``number`` on a middleware.

    clock [s]: for the age of messages. show_notice: shows a notice to the user.
    """

    def __init__(self, car: Car, number: int, middleware: Middleware,
                 show_notice: Callable[[str], None], clock: Callable[[], float] = elapsed) -> None:
        self.commands = Commands()
        self._car = car
        self._middleware = middleware
        self._show_notice = show_notice
        self._clock = clock
        # Zero of the car's clock [s since 1970], None until the first State.
        self._epoch: float | None = None
        mount = mount_of(car.files) if car.has_lidar else None
        source = car.lidar.localiser if car.has_lidar else None
        chart = source.chart if source else None
        self._writer = TopicWriter(number, car.files.config.geometry.l_r, car.simulated, mount,
                                   chart)
        topics = list_output_topics(number, car.simulated, mount is not None, chart is not None,
                                    car.has_battery)
        for topic, kind in topics.items():
            middleware.advertise(topic, kind, topic in LATCHED_TOPICS)
        for topic, method in list_input_topics(number).items():
            middleware.subscribe(topic, self._stamp(getattr(self.commands, method)))

    def run(self, arming: Iterable[State], states: Iterable[State]) -> None:
        """Arm, then drive by the received commands until ``states`` or the middleware end.

        Raises NotArmed, LinkLost, and Disarmed after a trip: the user has to arm again.
        """
        for state in arming:
            self._publish(state)
            if self._middleware.is_closed:
                self._car.stop()
                return
        self.commands.require_go()
        for state in states:
            if self._middleware.is_closed:
                break
            command = self.commands.current_command(self._clock())
            if self._car.drives:
                self._car.drive(steering=command.steering, throttle=command.throttle,
                                valid_for=COMMAND_VALIDITY_S, source=ROS_COMMAND_SOURCE)
            self._publish(state)
        self._car.stop()

    def _publish(self, state: State) -> None:
        logged = self.commands.upstream_inputs(self._clock())
        # The time of a simulated car is sent on /clock and must not jump: its zero is constant.
        # That of a real car follows the clock of the computer, which other nodes use.
        if self._epoch is None or not self._car.simulated:
            self._epoch = time.time() - self._car.now
        for topic, message in self._writer.messages(state, logged, self._epoch):
            self._middleware.publish(topic, message)
        for sentence in self.commands.take_reports():
            self._show_notice(sentence)

    def _stamp(self, method: Callable[[float, float], None]) -> Callable[[float], None]:
        return lambda value: method(value, self._clock())
