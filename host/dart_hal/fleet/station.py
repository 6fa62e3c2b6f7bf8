"""Member of a room without a car: lists the cars, watches them, stops them all.

Time is that of the computer; ``pause`` [s] waits.
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
from dart_hal.fleet.stopping import MIN_STOP_TIME, STOP_INTERVAL, StopCall
from dart_hal.fleet.transports import Transport, open_transport

# s between two BEATs.
BEAT_INTERVAL = 0.05


@dataclass(frozen=True, slots=True)
class CarStatus:
    """State of a car: s since its last frame, number of missing frames, health and pose."""

    name: str
    silent: float
    lost: int
    health: OtherHealth | None
    pose: OtherPose | None

    @property
    def state(self) -> str:
        """Mode of its supervisor; LOST if silent for 0.5 s."""
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
        self.peers.on_stopped = self._on_stopped
        self.peers.on_health = self._on_health
        self._outbox = Outbox(self.peers, self.transport)
        self._now = now
        self._pause = pause
        self._beat = float("-inf")
        self._call: StopCall | None = None

    def cars(self) -> list[CarStatus]:
        """Return the cars that have sent a pose or a health, by name."""
        now = self._now()
        poses = self.peers.other_poses(self._now())
        return [CarStatus(name, max(now - s.heard, 0.0), s.lost, self.peers.health(s, now),
                          poses.get(name))
                for name, s in sorted(self.peers.senders.items())
                if name in poses or m.HEALTH.id in s.newest_frames]

    @property
    def has_key(self) -> bool:
        """Whether only signed messages are accepted."""
        return self.peers.decoder.key is not None

    def list_ignored(self) -> dict[str, str]:
        """Return the names of members whose messages are not used, with the reason."""
        return self.peers.list_ignored(self._now())

    def look(self) -> None:
        """Process the received frames."""
        self.peers.receive(self.transport, self._now())

    def listen(self, seconds: float) -> list[CarStatus]:
        """Process frames for this time; return the cars.

        It sends HEARD, so that cars with a list of addresses answer, but no BEAT.
        """
        end = self._now() + seconds
        while (now := self._now()) < end:
            self.look()
            if now - self._beat >= BEAT_INTERVAL - 1e-9:
                self._beat = now
                self._outbox.send(m.HEARD, (self.peers.echoes(),), now)
            self._pause(STOP_INTERVAL)
        return self.cars()

    def watch(self) -> list[CarStatus]:
        """Process frames and send a beat when due: call it at least each 50 ms."""
        now = self._now()
        self.look()
        if now - self._beat >= BEAT_INTERVAL - 1e-9:
            self._beat = now
            self._outbox.send_heard(now)
            self._outbox.send(m.BEAT, (), now)
        return self.cars()

    def call_stop(self, why: str = "", at_least: float = MIN_STOP_TIME) -> StopCall:
        """Start to stop all cars; call ``press`` until it returns True.

        at_least [s]: minimum duration, for cars that have not been received yet.
        """
        now = self._now()
        number = secrets.randbits(32) or 1
        self._call = StopCall(number, why, self._required_cars(now), now, at_least)
        self.press()
        return self._call

    def press(self) -> bool:
        """Repeat the stop when due; return whether it has ended."""
        if self._call is None:
            return True
        now = self._now()
        if self._call.is_due(now):
            if self.has_key:
                # A car needs a proof of this station before it obeys.
                self._outbox.send_heard(now)
            self._outbox.send(m.STOP, (self._call.number, self._call.why), now)
        self.look()
        now = self._now()
        self._call.add_cars(self._required_cars(now), now)
        return self._call.is_over(now)

    def stop(self, why: str = "") -> StopCall:
        """Stop all cars, until each known one has answered or for 2 s: see ``silent``."""
        call = self.call_stop(why)
        while not self.press():
            self._pause(STOP_INTERVAL / 2)
        return call

    def close(self) -> None:
        """Close the transport."""
        self.transport.close()

    def __enter__(self) -> Station:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    def _required_cars(self, now: float) -> set[Session]:
        """Return the cars that must answer: those of ``cars``, and sessions that they displaced."""
        listed = {sender.session for sender in self.peers.senders.values()
                  if m.HEALTH.id in sender.newest_frames or m.POSE.id in sender.newest_frames}
        return listed | self.peers.cars(now)

    def _on_stopped(self, number: int, session: Session) -> None:
        """Pass an answer to the current stop."""
        if self._call is not None:
            self._call.answer(number, session, self._now())

    def _on_health(self, session: Session, mode: str) -> None:
        """Pass a health to the current stop."""
        if self._call is not None:
            self._call.health(session, mode, self._now())
