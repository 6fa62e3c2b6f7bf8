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
from pathlib import Path
from types import TracebackType

from dart_hal.core.process.suspend import elapsed
from dart_hal.fleet import messages as m
from dart_hal.fleet.key import RoomKey, find_key
from dart_hal.fleet.outbox import Outbox
from dart_hal.fleet.peers import LOST_AFTER, OtherHealth, OtherPose, Peers
from dart_hal.fleet.sender import Session
from dart_hal.fleet.stopping import AT_LEAST, REPEAT, StopCall
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
    """A member without a car; a context manager. room_key: as ``dart_hal.car.join`` takes it.

    Raises UsageError and what opening the transport raises.
    """

    def __init__(self, room: str | Transport, name: str = "",
                 now: Callable[[], float] = elapsed,
                 pause: Callable[[float], object] = time.sleep,
                 room_key: RoomKey | str | Path | None = None) -> None:
        key = find_key(room_key)
        self.name = name or f"station {socket.gethostname()[:16]} {os.getpid()}"
        self.transport = open_transport(room) if isinstance(room, str) else room
        self.peers = Peers(self.name, secrets.randbits(32), key)
        self.peers.on_stopped = self._stopped
        self.peers.on_health = self._health
        self._outbox = Outbox(self.peers, self.transport)
        self._now, self._pause = now, pause
        self._beat = float("-inf")
        self._call: StopCall | None = None

    def cars(self) -> list[Seen]:
        """Who has told of a pose or a health, by name."""
        now, poses = self._now(), self.peers.other_poses(self._now())
        return [Seen(name, max(now - s.heard, 0.0), s.lost, self.peers.health(s), poses.get(name))
                for name, s in sorted(self.peers.senders.items())
                if name in poses or m.HEALTH.id in s.told]

    @property
    def has_key(self) -> bool:
        """Whether it accepts signed messages alone."""
        return self.peers.decoder.key is not None

    def ignored(self) -> dict[str, str]:
        """Members whose messages do not count, by the name that they give, and why."""
        return self.peers.ignored(self._now())

    def look(self) -> None:
        """Take what has come."""
        self.peers.take(self.transport, self._now())

    def listen(self, seconds: float) -> list[Seen]:
        """Look for so long; who is there. It sends, so that cars that have a list of addresses
        know whom to answer, but it is no watcher: it sends no BEAT."""
        end = self._now() + seconds
        while (now := self._now()) < end:
            self.look()
            if now - self._beat >= BEAT_EVERY - 1e-9:
                self._beat = now
                self._outbox.send(m.HEARD, (self.peers.echoes(),), now)
            self._pause(REPEAT)
        return self.cars()

    def watch(self) -> list[Seen]:
        """Look, and beat when it is time: call it at least each 50 ms."""
        now = self._now()
        self.look()
        if now - self._beat >= BEAT_EVERY - 1e-9:
            self._beat = now
            self._outbox.send_heard(now)
            self._outbox.send(m.BEAT, (), now)
        return self.cars()

    def call_stop(self, why: str = "", at_least: float = AT_LEAST) -> StopCall:
        """Begin to stop all cars; ``press`` until it is over. at_least [s]: for cars that have not
        been received yet."""
        now = self._now()
        self._call = StopCall(secrets.randbits(32) or 1, why, self._known(now), now, at_least)
        self.press()
        return self._call

    def press(self) -> bool:
        """Repeat the stop when it is due; whether it is over."""
        if self._call is None:
            return True
        now = self._now()
        if self._call.due(now):
            if self.has_key:
                # A car that does not know this station needs a proof before it obeys.
                self._outbox.send_heard(now)
            self._outbox.send(m.STOP, (self._call.number, self._call.why), now)
        self.look()
        now = self._now()
        self._call.knows(self._known(now), now)
        return self._call.over(now)

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

    def _known(self, now: float) -> set[Session]:
        """Cars that have to answer: those of ``cars``, and sessions that they displaced."""
        listed = {sender.session for sender in self.peers.senders.values()
                  if m.HEALTH.id in sender.told or m.POSE.id in sender.told}
        return listed | self.peers.cars(now)

    def _stopped(self, number: int, session: Session) -> None:
        if self._call is not None:
            self._call.answer(number, session, self._now())

    def _health(self, session: Session, mode: str) -> None:
        if self._call is not None:
            self._call.health(session, mode, self._now())
