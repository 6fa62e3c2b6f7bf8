"""Link and clock of the virtual world: host time is world time.

``read`` advances the world. Bytes that arrive later than the reader's horizon
are held back, and the world never runs past a delimiter that the reader has
not seen, so the length of a read slice cannot be noticed.
"""

from __future__ import annotations

from collections import deque

from dart_hal.core.errors import LinkLost
from dart_hal.core.ports import Chunk, Link
from dart_lab.sim.faults import Line
from dart_lab.sim.world import World

LONGEST = 256
"""Bytes without a delimiter that are passed on as they are."""


class SimLink(Link):
    """Bytes to and from the Nano of a world, through a line in each direction."""

    def __init__(self, world: World, up: Line | None = None, down: Line | None = None) -> None:
        self._world = world
        self._up, self._down = up or Line(), down or Line()
        self._part = bytearray()
        self._arrived: deque[Chunk] = deque()
        self._sent: deque[tuple[bytes, float]] = deque()
        self._now = world.t
        self._open = True

    @property
    def now(self) -> float:
        """Host time [s]."""
        return self._now

    def read(self, timeout: float) -> Chunk | None:
        """The next frame (or noise) within ``timeout`` s, None = nothing came."""
        self._check_open()
        horizon = self._now + timeout
        while True:
            due = self._arrived[0].t if self._arrived else float("inf")
            if due <= self._world.t and due <= horizon:
                chunk = self._arrived.popleft()
                self._now = max(self._now, chunk.t)
                return chunk
            if self._world.t >= horizon:
                self._now = horizon
                return None
            self._advance(min(horizon, due))

    def write(self, data: bytes) -> None:
        """Bytes start on the line now (after the latency of the line, if any)."""
        self._check_open()
        data, t = self._down.carry(data, self._now)
        if not data:
            return
        if t <= self._world.t and not self._sent:
            self._world.nano.write(data)
        else:
            self._sent.append((data, t))

    def sleep(self, seconds: float) -> None:
        """Let world time pass; frames of that time wait to be read."""
        target = self._now + seconds
        while self._world.t < target:
            self._advance(target)
        self._now = target

    def close(self) -> None:
        if self._open:
            self._open = False
            self._world.nano.close()

    def _advance(self, until: float) -> None:
        """One run of the world, ended by ``until``, a frame, or a late write."""
        world = self._world
        if self._sent:
            if self._sent[0][1] <= world.t:
                world.nano.write(self._sent.popleft()[0])
                return
            until = min(until, self._sent[0][1])
        world.advance(until)
        for data, t in world.nano.read():
            self._part += data
            if data.endswith(b"\0") or len(self._part) >= LONGEST:
                arrived, when = self._up.carry(bytes(self._part), t)
                self._part.clear()
                if arrived:
                    self._arrived.append(Chunk(arrived, when))

    def _check_open(self) -> None:
        if not self._open:
            raise LinkLost("the link to the simulated car is closed")


class SimClock:
    """Host time of a simulated car."""

    def __init__(self, link: SimLink) -> None:
        self._link = link

    def now(self) -> float:
        return self._link.now

    def sleep(self, seconds: float) -> None:
        self._link.sleep(seconds)
