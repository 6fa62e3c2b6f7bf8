"""A car in real time with its page, and a client of the socket that is no browser."""

from __future__ import annotations

import json
import threading
import time
from contextlib import contextmanager

from websockets.sync.client import connect

from dart_hal.car import Car
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of


@contextmanager
def live_page(drives=True, url="sim://?nano=mock&pace=1", **options):
    """An emulated car and its page, with the pulses at the ESC; its loop runs in a thread."""
    backend = open_backend(url)
    pulses = []
    world_of(backend).watchers.append(
        lambda channel, pulse: pulses.append(pulse) if channel == 1 else None)
    with Car.over(backend, raise_on_trip=False) as car, \
            car.view(port=0, drives=drives, **options) as page:
        page.pulses = pulses
        ended = threading.Event()
        loop = threading.Thread(target=lambda: page.run(60.0, ended.is_set))
        loop.start()
        try:
            yield car, page
        finally:
            ended.set()
            loop.join()


def join(page, origin=None, host="localhost"):
    """An open socket."""
    return connect(f"ws://{host}:{page.access.port}/socket", origin=origin, max_size=None,
                   compression=None, close_timeout=0.3)


def send_message(socket, **message):
    socket.send(json.dumps(message))


def until(socket, kind, within=5.0, where=lambda message: True):
    """The first message of a kind that fulfils ``where``. Raises TimeoutError."""
    ends = time.monotonic() + within
    while time.monotonic() < ends:
        message = json.loads(socket.recv(timeout=max(ends - time.monotonic(), 0.01)))
        if message["type"] == kind and where(message):
            return message
    raise TimeoutError(kind)
