"""Link and clock of the virtual world: host time is world time.

``read`` advances the world. Bytes that arrive after the end of the read are kept for the next one,
and the world never runs past a delimiter that has not been read. The result is therefore
independent of the length of the reads.
"""

from __future__ import annotations

from collections import deque

from dart_hal.core.errors import LinkLost
from dart_hal.core.ports import Chunk, Link
from dart_lab.sim.faults import Line
from dart_lab.sim.world import World

# Bytes without a delimiter are passed on in chunks of this length.
MAX_UNDELIMITED_BYTES = 256


class SimLink(Link):
    """Bytes to and from the Nano of a world, through a line in each direction."""

    def __init__(self, world: World, up: Line | None = None, down: Line | None = None) -> None:
        self._world = world
        self._up = up or Line()
        self._down = down or Line()
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
        """Return the next frame, or noise, within ``timeout`` s; None = nothing arrived."""
        self._check_open()
        horizon = self._now + timeout
        while True:
            # A chunk is due when the world has reached its arrival. Otherwise the world runs to the
            # next arrival, or to the end of the read.
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
        """Send bytes, which start on the line after its latency, if it has one."""
        self._check_open()
        data, t = self._down.carry(data, self._now)
        if not data:
            return
        if t <= self._world.t and not self._sent:
            self._world.nano.write(data)
        else:
            self._sent.append((data, t))

    def sleep(self, seconds: float) -> None:
        """Advance the world by a time; frames of that time can be read afterwards."""
        target = self._now + seconds
        while self._world.t < target:
            self._advance(target)
        self._now = target

    def close(self) -> None:
        if self._open:
            self._open = False
            self._world.nano.close()

    def _advance(self, until: float) -> None:
        """Run the world until ``until``, the end of a frame, or a delayed write."""
        world = self._world
        if self._sent:
            if self._sent[0][1] <= world.t:
                world.nano.write(self._sent.popleft()[0])
                return
            until = min(until, self._sent[0][1])
        world.advance(until)
        for data, t in world.nano.read():
            self._part += data
            # The line carries whole frames, so that its damage is independent of the chunks.
            if data.endswith(b"\0") or len(self._part) >= MAX_UNDELIMITED_BYTES:
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
