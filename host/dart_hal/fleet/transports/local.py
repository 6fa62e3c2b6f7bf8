"""``local://ROOM``: cars of one process, in whatever time they live; with faults to test by.

Options: ``loss`` share of datagrams that do not come, ``delay`` and ``jitter`` [s] (each is late
by delay and up to jitter more, so they overtake each other), ``twice`` share that come twice,
``seed``. Each is drawn for every receiver by itself, by the options of the receiver.
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

KEPT = 10_000
"""Datagrams that wait for a receiver; for one that never looks no more are kept."""


class Room:
    """Who is in it, and its time: the latest of the cars' clocks, which go in lockstep.

    A car that is let run alone for a while takes the room's time with it; the others follow.
    """

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.members: list[LocalTransport] = []
        self.entered = 0
        self.now = 0.0


_rooms: dict[str, Room] = {}
_doors = threading.Lock()


def open_local(url: Url) -> LocalTransport:
    """Enter a room of this process. Raises UsageError."""
    url.known("loss", "delay", "jitter", "twice", "seed")
    return LocalTransport(url, *(_number(url, name, most) for name, most in (
        ("loss", 1.0), ("twice", 1.0), ("delay", inf), ("jitter", inf))))


class LocalTransport:
    """One member's end."""

    def __init__(self, url: Url, loss: float = 0.0, twice: float = 0.0, delay: float = 0.0,
                 jitter: float = 0.0) -> None:
        self.url, self.trouble = url.text, ""
        self.loss, self.twice, self.delay, self.jitter = loss, twice, delay, jitter
        self._waiting: list[tuple[float, int, bytes]] = []
        self._count = 0
        self._name = url.target
        with _doors:
            self._room = room = _rooms.setdefault(self._name, Room())
            self._draw = random.Random(f"{url.options.get('seed', '0')} {room.entered}")
            room.entered += 1
            room.members.append(self)

    def stamp(self, now: float) -> float:
        """The room's time."""
        return self._room.now

    def send(self, data: bytes, now: float) -> None:
        room = self._room
        with room.lock:
            room.now = max(room.now, now)
            for other in room.members:
                if other is not self:
                    other.come(data, room.now)

    def come(self, data: bytes, sent: float) -> None:
        """A datagram is on its way here; the room's lock is held."""
        draw = self._draw
        if self.loss and draw.random() < self.loss:
            return
        for _ in range(2 if self.twice and draw.random() < self.twice else 1):
            late = self.delay + (draw.uniform(0.0, self.jitter) if self.jitter else 0.0)
            self._count += 1
            if len(self._waiting) < KEPT:
                insort(self._waiting, (sent + late, self._count, data))

    def poll(self, now: float) -> Sequence[Datagram]:
        room, waiting = self._room, self._waiting
        with room.lock:
            room.now = max(room.now, now)
            if not waiting or waiting[0][0] > room.now:
                return ()
            due = [entry for entry in waiting if entry[0] <= room.now]
            del waiting[:len(due)]
        return [Datagram(data, room.now - at) for at, _, data in due]

    def answer(self, source: object) -> None:
        """Everybody in the room is sent to anyway."""

    def close(self) -> None:
        with _doors:
            if self in self._room.members:
                self._room.members.remove(self)
                if not self._room.members:
                    del _rooms[self._name]


def _number(url: Url, name: str, most: float) -> float:
    text = url.options.get(name, "0")
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= most or value == inf:
        raise UsageError(f"{name}={text!r} of a room", found=url.text,
                         expected="a share from 0 to 1" if most == 1.0 else "seconds from 0")
    return value
