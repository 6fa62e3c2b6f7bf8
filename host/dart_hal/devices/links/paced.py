"""A virtual world that runs in real time: it continues while the program computes.

A world in virtual time waits for its program, so a controller that is too slow for a car can still
drive an emulated one. Here the world is advanced to the wall clock at each access: the command of a
slow loop expires, as on the car.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar

from dart_hal.core.errors import DartHalError
from dart_hal.core.ports import Chunk, DeviceSource, Link, PoseSource
from dart_hal.core.types import ExternalPose
from dart_hal.devices.links.busio import TransferBus

# s between two reads of a line without bytes: one step of the world.
LOOK_INTERVAL = 0.001
# s after bytes without a read: the next STATE ends at least 9.9 ms after the last one. Other bytes
# may wait, since their stamps are times of the world.
QUIET_TIME = 0.008
# s: with a larger lag the world cannot keep up, and its clock is moved instead.
MAX_WORLD_LAG = 0.25

log = logging.getLogger("dart_hal")

Item = TypeVar("Item")


class PacedLink(Link):
    """Link and Clock of ``link``, whose world is advanced by ``pass_time``; safe for threads.

    ``lock``: locked while the world is accessed. faster: what to do about a world that cannot keep
    up, for its notice.
    """

    def __init__(self, link: Link, now: Callable[[], float],
                 pass_time: Callable[[float], None], faster: str) -> None:
        self.link = link
        self.lock = threading.RLock()
        self._now = now
        self._pass_time = pass_time
        self._faster = faster
        self._start = time.monotonic() - now()
        self._slow = False
        self._quiet_until = 0.0

    def now(self) -> float:
        """Advance the world to the wall clock and return its time [s]."""
        with self.lock:
            lag = time.monotonic() - self._start - self._now()
            if lag > MAX_WORLD_LAG:
                self._start += lag
                self._warn_slow(lag)
            elif lag > 0.0:
                self._pass_time(lag)
            return self._now()

    def _warn_slow(self, lag: float) -> None:
        if not self._slow:
            self._slow = True
            log.warning("the emulation is slower than real time on this computer: its clock was "
                        "moved by %.2f s, and a gap of the frames ends or delays arming; %s", lag,
                        self._faster)

    def sleep(self, seconds: float) -> None:
        """Sleep in real time."""
        time.sleep(max(seconds, 0.0))

    def read(self, timeout: float) -> Chunk | None:
        deadline = self.now() + timeout
        while True:
            with self.lock:
                now = self.now()
                chunk = self.link.read(0.0)
            if chunk is not None:
                self._quiet_until = chunk.t + QUIET_TIME
            if chunk is not None or now >= deadline:
                return chunk
            time.sleep(max(LOOK_INTERVAL, min(self._quiet_until, deadline) - now))

    def write(self, data: bytes) -> None:
        with self.lock:
            self.now()
            self.link.write(data)

    def close(self) -> None:
        with self.lock:
            self.link.close()


class PacedBus(TransferBus):
    """The bus of a paced world: each transfer first advances the world."""

    def __init__(self, bus: TransferBus, link: PacedLink) -> None:
        self._bus = bus
        self._link = link

    def transfer(self, address: int, data: bytes, n: int) -> bytes:
        with self._link.lock:
            self._link.now()
            return self._bus.transfer(address, data, n)


class PacedPoses:
    """A source of poses in a paced world."""

    def __init__(self, source: PoseSource, link: PacedLink) -> None:
        self.name = source.name
        self.on_board = source.on_board
        self.map_std = source.map_std if source.on_board else 0.0
        self._source = source
        self._link = link

    def poll(self, now: float) -> Sequence[ExternalPose]:
        with self._link.lock:
            return self._source.poll(now)

    def close(self) -> None:
        self._source.close()


class PacedDevice(Generic[Item]):
    """A camera or a lidar in a paced world."""

    def __init__(self, source: DeviceSource[Item], link: PacedLink) -> None:
        self.name = source.name
        self._source = source
        self._link = link

    @property
    def trouble(self) -> DartHalError | None:
        return self._source.trouble

    def poll(self, now: float) -> Sequence[Item]:
        with self._link.lock:
            return self._source.poll(now)

    def close(self) -> None:
        self._source.close()
