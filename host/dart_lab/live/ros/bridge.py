"""A car between its States and a middleware's topics."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Protocol

from dart_hal.car import Car
from dart_hal.core.process.suspend import elapsed
from dart_hal.core.types import State
from dart_lab.live.ros import told
from dart_lab.live.ros.commands import Commands
from dart_lab.live.ros.messages import Message

SOURCE = "ros"
VALID_FOR = 0.15
"""s that a command to the car holds: 15 States. Should this program hang just before it notices a
silence (``commands.HOLD``), the ESC is neutral a PWM frame behind 0.45 s, and the car tripped."""


class Middleware(Protocol):
    """What carries messages. ``heard`` is called in any thread."""

    @property
    def closed(self) -> bool:
        """Whether the node was told to end."""

    def subscribe(self, topic: str, heard: Callable[[float], None]) -> None:
        """``heard(value)`` for each std_msgs/Float32, the newest alone where they pile up."""

    def advertise(self, topic: str, kind: str) -> None:
        """A topic of ours; kind: "std_msgs/Float32"."""

    def publish(self, topic: str, message: Message) -> None:
        """Hand over a message of an advertised topic; does not wait for who reads."""

    def close(self) -> None:
        """Leave the network; idempotent."""


class Bridge:
    """Car ``number`` on a middleware. clock [s]: by which messages age; say: one sentence."""

    def __init__(self, car: Car, number: int, middleware: Middleware, say: Callable[[str], None],
                 clock: Callable[[], float] = elapsed) -> None:
        self.commands = Commands()
        self._car, self._middleware, self._say, self._clock = car, middleware, say, clock
        self._told = told.Told(number, car.files.config.geometry.l_r, car.simulated)
        for topic, kind in told.topics(number, car.simulated).items():
            middleware.advertise(topic, kind)
        for topic, method in told.heard(number).items():
            middleware.subscribe(topic, self._hears(getattr(self.commands, method)))

    def run(self, arming: Iterable[State], states: Iterable[State]) -> None:
        """Arm, then drive by what is heard until ``states`` or the middleware end.

        Raises NotArmed, LinkLost, and Disarmed after a trip: the car is armed again by hand.
        """
        for state in arming:
            self._tell(state)
            if self._middleware.closed:
                self._car.stop()
                return
        self.commands.armed()
        for state in states:
            if self._middleware.closed:
                break
            wanted = self.commands.wanted(self._clock())
            if self._car.drives:
                self._car.drive(steering=wanted.steering, throttle=wanted.throttle,
                                valid_for=VALID_FOR, source=SOURCE)
            self._tell(state)
        self._car.stop()

    def _tell(self, state: State) -> None:
        logged, epoch = self.commands.logged(self._clock()), time.time() - self._car.now
        for topic, message in self._told.messages(state, logged, epoch):
            self._middleware.publish(topic, message)
        for sentence in self.commands.said():
            self._say(sentence)

    def _hears(self, method: Callable[[float, float], None]) -> Callable[[float], None]:
        return lambda value: method(value, self._clock())
