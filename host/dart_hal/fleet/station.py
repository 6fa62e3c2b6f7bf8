"""A computer in a room that is no car: lists the cars, watches them, stops them all.

Time is the computer's; ``pause`` [s] lets it pass.
"""

from __future__ import annotations

import os
import secrets
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any

from dart_hal.fleet import messages as m
from dart_hal.fleet.codec import encode
from dart_hal.fleet.peers import LOST_AFTER, OtherHealth, OtherPose, Peers
from dart_hal.fleet.stopping import REPEAT, StopCall
from dart_hal.fleet.transports import Transport, open_transport

BEAT_EVERY = 0.05
"""s between two BEATs."""


@dataclass(frozen=True, slots=True)
class Seen:
    """A car of the room: s since it was heard, frames that did not come, its health and pose."""

    name: str
    silent: float
    lost: int
    health: OtherHealth | None
    pose: OtherPose | None

    @property
    def state(self) -> str:
        """Its supervisor's mode; LOST where nothing was heard for 0.5 s."""
        if self.silent > LOST_AFTER:
            return "LOST"
        return self.health.mode if self.health is not None else "UNKNOWN"


class Station:
    """A member without a car; a context manager. Raises what opening the transport raises."""

    def __init__(self, room: str | Transport, name: str = "",
                 now: Callable[[], float] = time.monotonic,
                 pause: Callable[[float], object] = time.sleep) -> None:
        self.name = name or f"station {socket.gethostname()[:16]} {os.getpid()}"
        self.transport = open_transport(room) if isinstance(room, str) else room
        self.peers = Peers(self.name, secrets.randbits(32))
        self.peers.on_stopped = self._stopped
        self._now, self._pause = now, pause
        self._seq, self._beat = 0, float("-inf")
        self._call: StopCall | None = None

    def cars(self) -> list[Seen]:
        """Who has told of a pose or a health, by name."""
        now, poses = self._now(), self.peers.other_poses(self._now())
        return [Seen(name, max(now - s.heard, 0.0), s.lost, self.peers.health(s), poses.get(name))
                for name, s in sorted(self.peers.senders.items())
                if name in poses or m.HEALTH.id in s.told]

    def look(self) -> None:
        """Take what has come."""
        self.peers.take(self.transport, self._now())

    def listen(self, seconds: float) -> list[Seen]:
        """Look for so long; who is there."""
        self._send(m.BEAT, ())  # to a list of addresses: so that they know whom to answer
        end = self._now() + seconds
        while self._now() < end:
            self.look()
            self._pause(REPEAT)
        return self.cars()

    def watch(self) -> list[Seen]:
        """Look, and beat when it is time: call it at least each 50 ms."""
        now = self._now()
        self.look()
        if now - self._beat >= BEAT_EVERY - 1e-9:
            self._beat = now
            self._send(m.BEAT, ())
        return self.cars()

    def call_stop(self, why: str = "") -> StopCall:
        """Begin to stop all cars; ``press`` until it is over."""
        known = [seen.name for seen in self.cars()]
        self._call = StopCall(secrets.randbits(32) or 1, why, known, self._now())
        self.press()
        return self._call

    def press(self) -> bool:
        """Repeat the stop when it is due; whether it is over."""
        if self._call is None:
            return True
        if self._call.due(self._now()):
            self._send(m.STOP, (self._call.number, self._call.why))
        self.look()
        return self._call.over(self._now())

    def stop(self, why: str = "") -> StopCall:
        """Stop all cars, until each that is known has answered or for 2 s: see ``silent``."""
        call = self.call_stop(why)
        while not self.press():
            self._pause(REPEAT / 2)
        return call

    def close(self) -> None:
        self.transport.close()

    def __enter__(self) -> Station:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    def _stopped(self, number: int, who: str) -> None:
        if self._call is not None:
            self._call.answer(number, who)

    def _send(self, kind: m.Kind, values: tuple[Any, ...]) -> None:
        self._seq += 1
        now = self._now()
        self.transport.send(encode(kind, self.peers.boot, self._seq, self.transport.stamp(now),
                                   (self.name, *values)), now)
