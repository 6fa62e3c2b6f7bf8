"""An emulated car in virtual time behind the bridge, a middleware of lists, the ESC's pulses."""

from __future__ import annotations

from dart_hal.car import Car
from dart_hal.cli.common.session import load_map
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation.localisation.source import open_source
from dart_lab.live.ros.bridge import Bridge
from dart_lab.sim.truth import world_of
from tests.common import NEUTRAL_TOLERANCE_US


class ToyRos:
    """``publish_value(topic, value)``: another node publishes; ``published``: (topic, message)."""

    def __init__(self):
        self.heard = {}
        self.advertised = {}
        self.latched = set()
        self.published = []
        self.is_closed = False

    def subscribe(self, topic, heard):
        self.heard[topic] = heard

    def advertise(self, topic, kind, latched):
        self.advertised[topic] = kind
        self.latched |= {topic} if latched else set()

    def publish(self, topic, message):
        assert self.advertised[topic] == message.kind
        self.published.append((topic, message))

    def close(self):
        self.is_closed = True

    def publish_value(self, topic, value):
        self.heard[topic](value)

    def last(self, topic):
        return next(m for name, m in reversed(self.published) if name == topic)


class BridgedCar:
    """``run(seconds, each)``: arms, then drives, with ``each(t)`` at every State, t s behind."""

    def __init__(self, url="sim://?nano=mock&seed=1", number=1, localised=False):
        backend = open_backend(url)
        self.backend = backend
        poses = open_source("lidar", load_map(backend)) if localised else None
        self.pulses, self.warnings, self.ros, self.armed_at = [], [], ToyRos(), None
        world_of(backend).watchers.append(
            lambda channel, pulse: self.pulses.append(pulse) if channel == 1 else None)
        self.car = Car.over(backend, poses=poses)
        self.bridge = Bridge(self.car, number, self.ros, self.warnings.append, lambda: self.car.now)

    def run(self, seconds, each, while_arming=lambda: None):
        def arming():
            for state in self.car.arming():
                while_arming()
                yield state

        def states():
            self.armed_at = self.car.now
            for state in self.car.states(duration=seconds):
                each(self.car.now - self.armed_at)
                yield state

        self.bridge.run(arming(), states())

    def driving(self, since=-10.0, until=1e9):
        """(begin, end) of pulses that are not neutral and end between these, s since armed."""
        zero = self.armed_at
        return [(rise - zero, fall - zero) for rise, fall in self.pulses
                if since < fall - zero < until
                and abs((fall - rise) * 1e6 - 1500.0) > NEUTRAL_TOLERANCE_US]

    def last_driving(self):
        return max((fall for _, fall in self.driving()), default=-1.0)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.car.close()
