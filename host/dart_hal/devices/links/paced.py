"""A virtual world that runs in real time: it goes on while the program computes.

A world in virtual time waits for its program, so a controller that is too slow
for a car drives an emulated one well. Here the world is brought up to the wall
clock whenever somebody looks at it: a slow loop finds its command expired, as
on the car.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence

from dart_hal.core.errors import DartHalError
from dart_hal.core.ports import Chunk, ImageSource, Link, PoseSource, ScanSource
from dart_hal.core.types import ExternalPose, Image, Scan
from dart_hal.devices.links.busio import TransferBus

LOOK = 0.001
"""s between two looks at a line on which nothing came: one tick of the world."""
QUIET = 0.008
"""s after bytes in which nobody looks: the next STATE ends 9.9 ms after the last at the earliest,
and what comes between may wait, for its stamps are of the world."""
LATE = 0.25
"""s: a world that is later than this cannot keep up and is not chased, its clock is moved."""

log = logging.getLogger("dart_hal")


class PacedLink(Link):
    """Link and Clock over ``link``, whose world moves by ``link.sleep``; safe for threads.

    ``lock``: held while the world is touched.
    """

    def __init__(self, link: Link, now: Callable[[], float],
                 pass_time: Callable[[float], None]) -> None:
        self.link, self.lock = link, threading.RLock()
        self._now, self._pass_time = now, pass_time
        self._start = time.monotonic() - now()
        self._slow = False
        self._quiet_until = 0.0

    def now(self) -> float:
        """Time of the world [s], brought up to the wall clock."""
        with self.lock:
            behind = time.monotonic() - self._start - self._now()
            if behind > LATE:
                self._start += behind
                self._say_slow(behind)
            elif behind > 0.0:
                self._pass_time(behind)
            return self._now()

    def _say_slow(self, behind: float) -> None:
        if not self._slow:
            self._slow = True
            log.warning("the emulation is slower than real time on this computer: its clock was "
                        "moved by %.2f s; nano=mock in the URL is faster", behind)

    def sleep(self, seconds: float) -> None:
        """Let real time pass."""
        time.sleep(max(seconds, 0.0))

    def read(self, timeout: float) -> Chunk | None:
        deadline = self.now() + timeout
        while True:
            with self.lock:
                now = self.now()
                chunk = self.link.read(0.0)
            if chunk is not None:
                self._quiet_until = chunk.t + QUIET
            if chunk is not None or now >= deadline:
                return chunk
            time.sleep(max(LOOK, min(self._quiet_until, deadline) - now))

    def write(self, data: bytes) -> None:
        with self.lock:
            self.now()
            self.link.write(data)

    def close(self) -> None:
        with self.lock:
            self.link.close()


class PacedBus(TransferBus):
    """The bus of a paced world: a transfer meets it as it is now."""

    def __init__(self, bus: TransferBus, link: PacedLink) -> None:
        self._bus, self._link = bus, link

    def transfer(self, address: int, data: bytes, n: int) -> bytes:
        with self._link.lock:
            self._link.now()
            return self._bus.transfer(address, data, n)


class PacedPoses:
    """A source of poses that looks into a paced world."""

    def __init__(self, source: PoseSource, link: PacedLink) -> None:
        self.name, self._source, self._link = source.name, source, link
        self.on_board = source.on_board

    def poll(self, now: float) -> Sequence[ExternalPose]:
        with self._link.lock:
            return self._source.poll(now)

    def close(self) -> None:
        self._source.close()


class PacedImages:
    """A camera in a paced world."""

    def __init__(self, source: ImageSource, link: PacedLink) -> None:
        self.name, self._source, self._link = source.name, source, link

    @property
    def trouble(self) -> DartHalError | None:
        return self._source.trouble

    def poll(self, now: float) -> Sequence[Image]:
        with self._link.lock:
            return self._source.poll(now)

    def close(self) -> None:
        self._source.close()


class PacedScans:
    """A lidar in a paced world."""

    def __init__(self, source: ScanSource, link: PacedLink) -> None:
        self.name, self._source, self._link = source.name, source, link

    @property
    def trouble(self) -> DartHalError | None:
        return self._source.trouble

    def poll(self, now: float) -> Sequence[Scan]:
        with self._link.lock:
            return self._source.poll(now)

    def close(self) -> None:
        self._source.close()
