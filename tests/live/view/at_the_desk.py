"""A desk in virtual time: an emulated car, pages that are names, and the pulses at the ESC."""

from __future__ import annotations

import json

from dart_hal.car import Car
from dart_hal.devices.links.base import open_backend
from dart_lab.live.view import messages as m
from dart_lab.live.view.access import Access
from dart_lab.live.view.desk import Desk
from dart_lab.sim.truth import world_of
from tests.common import NEUTRAL_TOLERANCE_US, NEUTRAL_US

TOKEN = "right"
ON_THE_WAY = 0.03
"""s that the page's newest news is old when its command arrives."""


def driving(pulses, since):
    """(rise, fall) of those at the ESC that end after that and are not neutral."""
    return [(rise, fall) for rise, fall in list(pulses) if fall > since
            and abs((fall - rise) * 1e6 - NEUTRAL_US) > NEUTRAL_TOLERANCE_US]


class AtTheDesk:
    """``drive(seconds, each)``: the desk's loop, with ``each(t)`` at every State."""

    def __init__(self, seed=1, drives=True, url=None, **options):
        backend = open_backend(url or f"sim://?nano=mock&seed={seed}")
        self.world = world_of(backend)
        self.pulses = []
        self.modes = []
        self.messages = []
        self.world.watchers.append(
            lambda channel, pulse: self.pulses.append(pulse) if channel == 1 else None)
        self.car = Car.over(backend, raise_on_trip=False)
        self.desk = Desk(self.car, Access(8642, token=TOKEN), drives=drives, clock=self.now,
                         **options)
        self._each = lambda t: None
        self._count = 0
        self.car.on_state(self._step)
        for page in ("one", "two"):
            list(self.desk.open_page(page))

    def now(self):
        return self.car.now

    def _step(self, state):
        self.modes.append((self.now(), self.car.mode))
        self._each(self.now())
        self._count += 1
        if self._count % 3 == 0:
            self.messages += map(json.loads, self.desk.batch())

    def drive(self, seconds, each=lambda t: None):
        self._each = each
        self.desk.run(seconds)

    def send_message(self, page, message):
        return self.desk.handle_message(page, message)

    def hold(self, page="one", throttle=1.0, old=ON_THE_WAY, unchanged=0.0):
        self.send_message(page, m.DriveRequest(0.0, throttle, self.now() - old, unchanged))

    def watch(self, page="one"):
        """The stick is released, and the page goes on watching."""
        self.send_message(page, m.Release(self.now() - ON_THE_WAY))

    def take_and_arm(self, page="one"):
        self.send_message(page, m.Take(TOKEN))
        self.send_message(page, m.Arm())
        self._each = lambda t: None
        self.desk.run(4.0, lambda: self.car.mode == "ARMED")
        assert self.car.mode == "ARMED", self.messages[-1]

    def driving(self, since):
        return driving(self.pulses, since)

    def last_driving(self, since):
        return max((fall - since for _, fall in self.driving(since)), default=0.0)

    def list_texts(self):
        return [one["text"] for one in self.messages if one["type"] == "said"]

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.desk.close()
        self.car.close()
