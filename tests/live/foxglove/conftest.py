"""A car in real time that is served, and clients written from the protocol's text alone."""

from __future__ import annotations

import json
import struct
import threading
import time
from contextlib import contextmanager

import pytest
from websockets.sync.client import connect

from dart_hal.car import Car
from dart_hal.cli.common.session import limit_to_real_time
from dart_lab.live.foxglove.server import serve
from tests.common import MOCK_1_URL


class Client:
    """What Foxglove does: reads what is advertised, subscribes, publishes."""

    def __init__(self, socket):
        self.socket = socket
        self.channels = {}
        self.statuses = []
        self.info = json.loads(socket.recv(timeout=5))
        self.read_channels()

    def read_channels(self):
        self.take(self.socket.recv(timeout=5))

    def take(self, message):
        """A message: (subscription, ns, payload) of data, else None."""
        if isinstance(message, bytes):
            opcode, number, ns = struct.unpack_from("<BIQ", message)
            assert opcode == 1
            return number, ns, message[13:]
        content = json.loads(message)
        if content["op"] == "advertise":
            self.channels |= {c["topic"]: c for c in content["channels"]}
        else:
            self.statuses.append(content)
        return None

    def send(self, **message):
        self.socket.send(json.dumps(message))

    def subscribe(self, *topics):
        """Subscription n is of the nth topic."""
        self.send(op="subscribe", subscriptions=[
            {"id": n, "channelId": self.channels[topic]["id"]} for n, topic in enumerate(topics)])

    def hear(self, seconds):
        """Data messages that come in so many s, each with when it came."""
        heard = []
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            try:
                data = self.take(self.socket.recv(timeout=left))
            except TimeoutError:
                break
            if data is not None:
                heard.append((time.time_ns(), *data))
        return heard

    def publish(self, channel, value):
        """What a client sends that means to drive."""
        self.socket.send(struct.pack("<BI", 1, channel) + json.dumps(value).encode())

    def advertise(self, number, topic):
        """Announce a channel of the client's own."""
        self.send(op="advertise", channels=[
            {"id": number, "topic": topic, "encoding": "json", "schemaName": "x"}])

    def last_status(self, seconds=2.0):
        """The status that comes next."""
        end = time.monotonic() + seconds
        while not self.statuses and time.monotonic() < end:
            self.hear(0.05)
        return self.statuses.pop(0)["message"] if self.statuses else None


class FoxgloveCar:
    """A car whose States a thread takes, as a program would; ``late``: the longest gap [s]."""

    def __init__(self, car, server):
        self.car = car
        self.server = server
        self.late = 0.0
        self.count = 0
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        last = time.monotonic()
        for _ in limit_to_real_time(self.car.states()):
            now = time.monotonic()
            self.late = max(self.late, now - last)
            last = now
            self.count = self.count + 1
            if self._end.is_set():
                return

    def end(self):
        self._end.set()
        self._thread.join()

    @contextmanager
    def client(self, **options):
        with connect(f"ws://localhost:{self.server.port}", compression=None, max_size=None,
                     close_timeout=0.5,
                     subprotocols=["foxglove.websocket.v1"], **options) as socket:
            yield Client(socket)


@contextmanager
def serve_car(**options):
    """A car whose world is paced by itself."""
    with (Car.open(MOCK_1_URL + "&pace=1", **options) as car, serve(car, port=0) as server):
        driven = FoxgloveCar(car, server)
        try:
            yield driven
        finally:
            driven.end()


@pytest.fixture(scope="module")
def shown_car():
    """One for all tests of a file."""
    with serve_car() as driven:
        yield driven


@pytest.fixture(scope="session")
def serving():
    return serve_car
