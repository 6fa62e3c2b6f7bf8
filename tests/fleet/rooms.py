"""Frames of a car that is not open, and the ESC pins of cars that were."""

from __future__ import annotations

from dart_hal.car import Car, Fleet, join
from dart_hal.core.types import Pose, Tracking, pose_cov
from dart_hal.devices.links.base import open_backend
from dart_hal.fleet import messages as m
from dart_hal.fleet.codec import encode
from dart_hal.fleet.peers import pose_values
from dart_lab.sim.truth import world_of
from tests.common import NEUTRAL_TOLERANCE_US, NEUTRAL_US


def pose_frame(seq, *, x=0.0, speed=1.0, yaw_rate=0.0, boot=7, sent=0.0, age=0.0, name="red"):
    pose = Pose(x, 0.0, 0.0, pose_cov(0.01, 0.02))
    return encode(m.POSE, boot, seq, sent, pose_values(name, age, "room", pose, speed,
                                                          yaw_rate, Tracking.TRACKING))


class FleetPins:
    """A fleet of emulated cars in a room, and every pulse at their ESCs."""

    def __init__(self, room, seeds=(1, 2), beat_within=float("inf")):
        self.pulses = [[] for _ in seeds]
        self.worlds = []
        cars = []
        for seed, own_pulses in zip(seeds, self.pulses, strict=True):
            backend = open_backend(f"sim://?nano=mock&seed={seed}")
            self.worlds.append(world_of(backend))
            self.worlds[-1].watchers.append(
                lambda channel, pulse,
                own_pulses=own_pulses: own_pulses.append(pulse) if channel == 1 else None)
            cars.append(Car.over(backend))
        self.fleet = Fleet(cars)
        self.fleet.members = tuple(join(car, room, name=name, beat_within=beat_within)
                                   for car, name in zip(cars, self.fleet.names, strict=True))

    def drive(self, seconds, throttle=0.25, *, each=lambda: None, only=None):
        """All cars, or those of ``only``, are driven; what refuses them is counted."""
        refused = 0
        for _ in self.fleet.states(duration=seconds):
            each()
            for n in only if only is not None else range(len(self.fleet.cars)):
                try:
                    self.fleet.cars[n].drive(throttle=throttle)
                except RuntimeError:
                    refused += 1
        return refused

    def now(self):
        return [world.t for world in self.worlds]

    def driving(self, n, since):
        """(rise, fall) of the pulses at the ESC of car n, since then, that are not neutral."""
        return [(rise, fall) for rise, fall in self.pulses[n] if fall > since
                and abs((fall - rise) * 1e6 - NEUTRAL_US) > NEUTRAL_TOLERANCE_US]

    def last_driving(self, n, since):
        """s from then to the end of the last pulse that was not neutral; 0: there was none."""
        return max((fall - since for _, fall in self.driving(n, since)), default=0.0)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.fleet.close()
