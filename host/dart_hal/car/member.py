"""A car in a room of cars: tells where it is, hears where the others are, obeys a stop.

All of it happens when a State of the car comes, in the thread that reads its link: a program
that hangs is stopped all the same. A message of the room informs, or stops; none arms a car or
moves it.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Sequence
from math import inf
from pathlib import Path
from types import TracebackType
from typing import Any

from dart_hal.car.car import Car
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray, State
from dart_hal.fleet import messages as m
from dart_hal.fleet.codec import Counters, encode
from dart_hal.fleet.discovery import Announcement
from dart_hal.fleet.key import RoomKey, find_key
from dart_hal.fleet.messages import NOTE, TEXT
from dart_hal.fleet.outbox import Outbox
from dart_hal.fleet.peers import Coordination, OtherPose, Peers, values_of_pose
from dart_hal.fleet.sender import Session
from dart_hal.fleet.stopping import REPEAT, StopCall, StopRule
from dart_hal.fleet.transports import Transport, open_transport

EVERY = 5
"""States from one message to the next: 20 Hz."""


def join(car: Car, room: str | Transport, *, name: str | None = None,
         beat_within: float = inf, announce: bool = False,
         room_key: RoomKey | str | Path | None = None) -> Member:
    """Let a car enter a room, a transport or its URL; it leaves with ``close``.

    name: what the others call it, None: that of its files. beat_within [s]: it may drive only
    while a station watches it (``dart-hal fleet watch``), and stops when its newest frame that the
    station has confirmed is older. announce: tell the network by mDNS (needs zeroconf), so that
    ``dart-hal fleet`` finds the room. room_key: the key of the room, or the path of its file,
    None: that of $DART_ROOM_KEY, if any. With a key the car accepts signed messages alone;
    without one each computer on its network can stop it, keep it driving in place of the watcher,
    and send wrong poses of other cars.
    Raises UsageError and what opening the transport raises.
    """
    name = name or car.files.config.name
    if len(name.encode("utf-8")) > TEXT or not name.isprintable() or not name:
        raise UsageError(f"no member of a room can be called {name[:80]!r}", found=repr(name[:80]),
                         expected=f"1 to {TEXT} bytes of printable text",
                         remedy='join(car, room, name="red")')
    key = find_key(room_key)
    transport = open_transport(room) if isinstance(room, str) else room
    try:
        told = (Announcement(name, transport.url),) if announce else ()
        return Member(car, transport, name, beat_within, told, key)
    except BaseException:
        transport.close()
        raise


class Member:
    """One car in a room; a context manager. Made by ``join``."""

    def __init__(self, car: Car, transport: Transport, name: str, beat_within: float = inf,
                 announced: Sequence[Announcement] = (), key: RoomKey | None = None) -> None:
        self.car, self.name, self.transport = car, name, transport
        self._lock = threading.RLock()
        self._announced = announced
        self.peers = Peers(name, secrets.randbits(32), key)
        self._outbox = Outbox(self.peers, transport)
        self.rule = StopRule(beat_within)
        self.peers.on_stop = self._stop
        self.peers.on_stopped = self._stopped
        self.peers.on_health = self._health
        self.peers.on_beat = lambda who, since: self.rule.beat(since)
        self._call: StopCall | None = None
        self._plan: tuple[float, str, float, tuple[tuple[float, ...], ...]] | None = None
        self._count = self.unsaid = 0
        self._held, self._closed = "", False
        self._read: dict[str, tuple[int, int]] = {}
        self._leave = car.on_state(self._step)
        if beat_within < inf:
            self._obey(car.now)

    # -- what is known ---------------------------------------------------------------

    def other_poses(self) -> dict[str, OtherPose]:
        """The last known pose of each other car by name, as old as it is now."""
        with self._lock:
            return self.peers.other_poses(self.car.now)

    def coordination(self) -> dict[str, Coordination]:
        """What the law of each other car told last, by name, where that is new since this was
        called last."""
        with self._lock:
            told = self.peers.coordination(self.car.now)
            new = {name: c for name, c in told.items() if self._read.get(name) != c[1:3]}
            self._read.update({name: c[1:3] for name, c in new.items()})
        return new

    @property
    def held(self) -> str:
        """Who stopped this car, and why, or what keeps it from driving now; "": nothing does."""
        with self._lock:
            return self.rule.held(self.car.now)

    @property
    def ignored(self) -> dict[str, str]:
        """Members whose messages do not count, by the name that they give, and why."""
        with self._lock:
            return self.peers.ignored(self.car.now)

    @property
    def counters(self) -> Counters:
        """Datagrams that came: good ones, and those that were refused by what was wrong."""
        return self.peers.decoder.counters

    # -- what is told ------------------------------------------------------------------

    def tell_plan(self, points: FloatArray | Sequence[Sequence[float]], *, step: float,
                  frame: str = "start", t: float | None = None) -> None:
        """Tell the others where this car means to be, from now on at 20 Hz.

        points (n <= 64, 4): x, y [m], yaw [rad], speed [m/s], step [s] apart, the first at t [s]
        of the car's clock, None: now. No points: there is no plan any more. Raises UsageError.
        """
        rows = tuple(tuple(float(v) for v in row) for row in points)
        encode(m.PLAN, 0, 0, 0.0, (self.name, 0.0, frame, step, rows))
        with self._lock:
            self._plan = (self.car.now if t is None else t, frame, step, rows) if rows else None

    def tell_coordination(self, payload: bytes) -> None:
        """Tell the others what a shared law says, once, now; at most 255 bytes. Raises
        UsageError."""
        encode(m.COORDINATION, 0, 0, 0.0, (self.name, payload))
        with self._lock:
            if not self._closed:
                self._send(m.COORDINATION, (payload,), self.car.now)

    def stop_all(self, why: str = "") -> StopCall:
        """Stop every car of the room, this one first.

        STOP goes out now and, until all that are known have answered, with each State of this
        car. In real time this call waits for that, for 2 s at most: see ``silent``.
        """
        self.car.stop()
        with self._lock:
            now = self.car.now
            self._call = call = StopCall(secrets.randbits(32) or 1, why, self.peers.cars(now), now)
            self._repeat(now)
        while not (self.car.waits or call.over(self.car.now)):
            time.sleep(REPEAT)
            with self._lock:
                self._hear(self.car.now)
        return call

    def close(self) -> None:
        """Leave the room; the car stays open."""
        self._leave()
        for told in self._announced:
            told.close()
        with self._lock:
            self._closed = True
            self.transport.close()

    def __enter__(self) -> Member:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    # -- with each State ---------------------------------------------------------------

    def _step(self, state: State) -> None:
        with self._lock:
            if self._closed:  # while this State was on its way
                return
            now = self.car.now
            self._hear(now)
            self._count += 1
            if self._count % EVERY == 1:
                self._tell(state, now)

    def _hear(self, now: float) -> None:
        try:
            self.peers.take(self.transport, now)
        except OSError as why:  # the network is gone: the car goes by what it knows
            self.transport.trouble = str(why)
        self._obey(now)
        self._repeat(now)

    def _obey(self, now: float) -> None:
        held = self.rule.held(now)
        if held or self._held:
            self.car.run_stop(bool(held), by="room", reason=f"run-stop of the room: {held}")
        self._held = held

    def _repeat(self, now: float) -> None:
        if self._call is not None and self._call.due(now):
            self._send(m.STOP, (self._call.number, self._call.why), now)
            self._call.knows(self.peers.cars(now), now)

    def _stop(self, number: int, who: str, why: str) -> None:
        now = self.car.now
        self.rule.stop(number, who, why, now)
        self._obey(now)
        if self.peers.decoder.key is not None:
            self._outbox.send_heard(now)  # so that a new station accepts the answer at once
        self._send(m.STOPPED, (number,), now)

    def _stopped(self, number: int, session: Session) -> None:
        if self._call is not None:
            self._call.answer(number, session, self.car.now)

    def _health(self, session: Session, mode: str) -> None:
        if self._call is not None:
            self._call.health(session, mode, self.car.now)

    def _tell(self, state: State, now: float) -> None:
        estimate = state.estimate
        pose = values_of_pose("", now - estimate.t, estimate.frame, estimate.pose,
                              estimate.speed, estimate.yaw_rate, estimate.tracking)
        self._send(m.POSE, pose[1:], now)
        health = state.health
        self._send(m.HEALTH, (self.car.mode, health.lost, " ".join(sorted(health.doubts)),
                              self._held[:NOTE // 4]), now)
        if self._plan is not None:
            t, *rest = self._plan
            self._send(m.PLAN, (max(now - t, 0.0), *rest), now)
        if self.peers.decoder.key is not None:
            self._outbox.send_heard(now)

    def _send(self, kind: m.Kind, values: tuple[Any, ...], now: float) -> None:
        """One frame to everybody. What cannot be told, such as a pose that is not finite, is
        counted rather than raised in the car's loop."""
        try:
            self._outbox.send(kind, values, now)
        except UsageError:
            self.unsaid += 1
