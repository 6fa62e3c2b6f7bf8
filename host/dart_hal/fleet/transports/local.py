"""``local://ROOM``: cars of one process, in virtual or real time; with faults for tests.

Options: ``loss`` share of lost datagrams, ``delay`` and ``jitter`` [s] (each is delayed by delay
and up to jitter more, so they overtake each other), ``twice`` share of duplicates, ``seed``. Each
receiver draws its own, by its own options.
"""

from __future__ import annotations

import random
import threading
from bisect import insort
from collections.abc import Sequence
from math import inf

from dart_hal.core.errors import UsageError
from dart_hal.core.url import Url
from dart_hal.fleet.transports import Datagram

# Datagrams that wait for a receiver; further ones are dropped.
MAX_QUEUED_DATAGRAMS = 10_000


class Room:
    """Members of a room, and its time: the latest of the clocks of the cars, which run in lockstep.

    A car that runs alone for a while advances the time of the room; the others follow.
    """

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.members: list[LocalTransport] = []
        self.entered = 0
        self.now = 0.0


_rooms: dict[str, Room] = {}
_doors = threading.Lock()


def open_local(url: Url) -> LocalTransport:
    """Join a room of this process. Raises UsageError."""
    url.known("loss", "delay", "jitter", "twice", "seed")
    return LocalTransport(url, *(_number(url, name, limit) for name, limit in (
        ("loss", 1.0), ("twice", 1.0), ("delay", inf), ("jitter", inf))))


class LocalTransport:
    """Transport of one member."""

    def __init__(self, url: Url, loss: float = 0.0, twice: float = 0.0, delay: float = 0.0,
                 jitter: float = 0.0) -> None:
        self.url = url.text
        self.trouble = ""
        self.loss = loss
        self.twice = twice
        self.delay = delay
        self.jitter = jitter
        self._waiting: list[tuple[float, int, bytes]] = []
        self._count = 0
        self._name = url.target
        with _doors:
            self._room = room = _rooms.setdefault(self._name, Room())
            self._draw = random.Random(f"{url.options.get('seed', '0')} {room.entered}")
            room.entered += 1
            room.members.append(self)

    def stamp(self, now: float) -> float:
        """Return the time of the room."""
        return self._room.now

    def send(self, data: bytes, now: float) -> None:
        """Pass a datagram to all other members."""
        room = self._room
        with room.lock:
            room.now = max(room.now, now)
            for other in room.members:
                if other is not self:
                    other.enqueue(data, room.now)

    def enqueue(self, data: bytes, sent: float) -> None:
        """Queue a datagram with its faults; the lock of the room is held."""
        draw = self._draw
        if self.loss and draw.random() < self.loss:
            return
        for _ in range(2 if self.twice and draw.random() < self.twice else 1):
            late = self.delay + (draw.uniform(0.0, self.jitter) if self.jitter else 0.0)
            self._count += 1
            if len(self._waiting) < MAX_QUEUED_DATAGRAMS:
                insort(self._waiting, (sent + late, self._count, data))

    def poll(self, now: float) -> Sequence[Datagram]:
        """Return the datagrams that are due."""
        room = self._room
        waiting = self._waiting
        with room.lock:
            room.now = max(room.now, now)
            if not waiting or waiting[0][0] > room.now:
                return ()
            due = [entry for entry in waiting if entry[0] <= room.now]
            del waiting[:len(due)]
        return [Datagram(data, room.now - at) for at, _, data in due]

    def answer(self, source: object) -> None:
        """Do nothing: all members receive every datagram."""

    def close(self) -> None:
        """Leave the room; the last member removes it."""
        with _doors:
            if self in self._room.members:
                self._room.members.remove(self)
                if not self._room.members:
                    del _rooms[self._name]


def _number(url: Url, name: str, limit: float) -> float:
    """Return a numeric option. Raises UsageError outside 0 to ``limit``."""
    text = url.options.get(name, "0")
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= limit or value == inf:
        raise UsageError(f"{name}={text!r} of a room", found=url.text,
                         expected="a share from 0 to 1" if limit == 1.0 else "seconds from 0")
    return value
