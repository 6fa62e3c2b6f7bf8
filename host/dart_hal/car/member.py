"""A car in a room of cars: sends its pose, receives the others', obeys a run-stop.

This happens with each State of the car, in the thread that reads its link, so it stops a program
that hangs too. Messages of the room inform or stop; none arms or moves a car.
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
from dart_hal.fleet.codec import FrameCounters, encode
from dart_hal.fleet.discovery import Announcement
from dart_hal.fleet.key import RoomKey, find_key
from dart_hal.fleet.messages import MAX_NAME_BYTES, MAX_TEXT_BYTES
from dart_hal.fleet.outbox import Outbox
from dart_hal.fleet.peers import Coordination, OtherPose, Peers, pose_values
from dart_hal.fleet.sender import Session
from dart_hal.fleet.stopping import STOP_INTERVAL, StopCall, StopRule
from dart_hal.fleet.transports import Transport, open_transport

# States from one message to the next: 20 Hz.
FRAMES_PER_BROADCAST = 5


def join(car: Car, room: str | Transport, *, name: str | None = None,
         beat_within: float = inf, announce: bool = False,
         room_key: RoomKey | str | Path | None = None) -> Member:
    """Let a car enter a room; it leaves with ``close`` of the member.

    Args:
        car: open car.
        room: URL of a room, or its open transport.
        name: name of the car in the room; None: that of its files.
        beat_within: age [s] above which the newest frame that a station has confirmed stops the
            car. It may drive only while a station (``dart-hal fleet watch``) watches it.
            Infinite: without a station.
        announce: True: announce the room by mDNS (needs zeroconf), for ``dart-hal fleet``.
        room_key: key of the room, or the path of its file. None: that of $DART_ROOM_KEY, if any.
            With a key, the car accepts signed messages only. Without one, each computer on its
            network can stop it, keep it driving in place of the station, and send wrong poses.

    Returns:
        The member of the room.

    Raises:
        UsageError: the name is not allowed. Also what opening the transport raises.
    """
    name = name or car.files.config.name
    if len(name.encode("utf-8")) > MAX_NAME_BYTES or not name.isprintable() or not name:
        raise UsageError(f"no member of a room can be called {name[:80]!r}", found=repr(name[:80]),
                         expected=f"1 to {MAX_NAME_BYTES} bytes of printable text",
                         remedy='join(car, room, name="red")')
    key = find_key(room_key)
    transport = open_transport(room) if isinstance(room, str) else room
    try:
        announced = (Announcement(name, transport.url),) if announce else ()
        return Member(car, transport, name, beat_within, announced, key)
    except BaseException:
        transport.close()
        raise


class Member:
    """One car in a room; a context manager. Made by ``join``."""

    def __init__(self, car: Car, transport: Transport, name: str, beat_within: float = inf,
                 announced: Sequence[Announcement] = (), key: RoomKey | None = None) -> None:
        self.car = car
        self.name = name
        self.transport = transport
        self._lock = threading.RLock()
        self._announced = announced
        self.peers = Peers(name, secrets.randbits(32), key)
        self._outbox = Outbox(self.peers, transport)
        self.rule = StopRule(beat_within)
        self.peers.on_stop = self._on_stop
        self.peers.on_stopped = self._on_stopped
        self.peers.on_health = self._on_health
        self.peers.on_beat = lambda who, since: self.rule.beat(since)
        self._call: StopCall | None = None
        self._plan: tuple[float, str, float, tuple[tuple[float, ...], ...]] | None = None
        self._count = self.unsent = 0
        self._held = ""
        self._closed = False
        self._read_coordination: dict[str, tuple[int, int]] = {}
        self._remove_listener = car.on_state(self._step)
        if beat_within < inf:
            self._apply_stop(car.now)

    # -- what is known ---------------------------------------------------------------

    def other_poses(self) -> dict[str, OtherPose]:
        """Return the last known pose of each other car by name, with its age now."""
        with self._lock:
            return self.peers.other_poses(self.car.now)

    def coordination(self) -> dict[str, Coordination]:
        """Return the coordination messages of other cars by name, new since the last call."""
        with self._lock:
            known = self.peers.coordination(self.car.now)
            new = {name: c for name, c in known.items()
                   if self._read_coordination.get(name) != c[1:3]}
            self._read_coordination.update({name: c[1:3] for name, c in new.items()})
        return new

    @property
    def held(self) -> str:
        """Return who stopped this car and why, or what keeps it from driving; "": nothing."""
        with self._lock:
            return self.rule.drive_block(self.car.now)

    @property
    def ignored(self) -> dict[str, str]:
        """Return the members whose messages are ignored, by name, with the reason."""
        with self._lock:
            return self.peers.list_ignored(self.car.now)

    @property
    def counters(self) -> FrameCounters:
        """Return the counters of datagrams: good ones, and refused ones by reason."""
        return self.peers.decoder.counters

    # -- what is told ------------------------------------------------------------------

    def tell_plan(self, points: FloatArray | Sequence[Sequence[float]], *, step: float,
                  frame: str = "start", t: float | None = None) -> None:
        """Send the others the plan of this car, from now on at 20 Hz.

        points (n <= 64, 4): x, y [m], yaw [rad], speed [m/s] every ``step`` [s], the first at time
        t [s] of the car's clock, None: now. Without points there is no plan. Raises UsageError.
        """
        rows = tuple(tuple(float(v) for v in row) for row in points)
        encode(m.PLAN, 0, 0, 0.0, (self.name, 0.0, frame, step, rows))
        with self._lock:
            self._plan = (self.car.now if t is None else t, frame, step, rows) if rows else None

    def tell_coordination(self, payload: bytes) -> None:
        """Send the others a message of a shared law once, at most 255 bytes. Raises UsageError."""
        encode(m.COORDINATION, 0, 0, 0.0, (self.name, payload))
        with self._lock:
            if not self._closed:
                self._send(m.COORDINATION, (payload,), self.car.now)

    def stop_all(self, why: str = "") -> StopCall:
        """Stop every car of the room, this one first.

        STOP is sent now, and again with each State of this car until all known cars have answered.
        In real time the call waits for the answers, at most 2 s: see ``silent`` of the result.
        """
        self.car.stop()
        with self._lock:
            now = self.car.now
            self._call = call = StopCall(secrets.randbits(32) or 1, why, self.peers.cars(now), now)
            self._repeat(now)
        while not (self.car.waits or call.is_over(self.car.now)):
            time.sleep(STOP_INTERVAL)
            with self._lock:
                self._receive(self.car.now)
        return call

    def close(self) -> None:
        """Leave the room; the car stays open."""
        self._remove_listener()
        for announcement in self._announced:
            announcement.close()
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
        """Receive with each State; send with each ``FRAMES_PER_BROADCAST``-th."""
        with self._lock:
            if self._closed:  # while this State was on its way
                return
            now = self.car.now
            self._receive(now)
            self._count += 1
            if self._count % FRAMES_PER_BROADCAST == 1:
                self._broadcast(state, now)

    def _receive(self, now: float) -> None:
        """Receive messages, apply a run-stop, repeat an own one."""
        try:
            self.peers.receive(self.transport, now)
        except OSError as why:  # the network is gone: the car goes by what it knows
            self.transport.trouble = str(why)
        self._apply_stop(now)
        self._repeat(now)

    def _apply_stop(self, now: float) -> None:
        """Press or release the run-stop of the room."""
        held = self.rule.drive_block(now)
        if held or self._held:
            self.car.run_stop(bool(held), source="room", reason=f"run-stop of the room: {held}")
        self._held = held

    def _repeat(self, now: float) -> None:
        """Send STOP again while cars have not answered."""
        if self._call is not None and self._call.is_due(now):
            self._send(m.STOP, (self._call.number, self._call.why), now)
            self._call.add_cars(self.peers.cars(now), now)

    def _on_stop(self, number: int, who: str, why: str) -> None:
        """Apply a received STOP, and answer it."""
        now = self.car.now
        self.rule.stop(number, who, why, now)
        self._apply_stop(now)
        if self.peers.decoder.key is not None:
            self._outbox.send_heard(now)  # so that a new station accepts the answer at once
        self._send(m.STOPPED, (number,), now)

    def _on_stopped(self, number: int, session: Session) -> None:
        if self._call is not None:
            self._call.answer(number, session, self.car.now)

    def _on_health(self, session: Session, mode: str) -> None:
        if self._call is not None:
            self._call.health(session, mode, self.car.now)

    def _broadcast(self, state: State, now: float) -> None:
        """Send pose, health, voltage of the battery and plan."""
        estimate = state.estimate
        pose = pose_values("", now - estimate.t, estimate.frame, estimate.pose,
                              estimate.speed, estimate.yaw_rate, estimate.tracking)
        self._send(m.POSE, pose[1:], now)
        health = state.health
        self._send(m.HEALTH, (self.car.mode, health.lost, " ".join(sorted(health.doubts)),
                              self._held[:MAX_TEXT_BYTES // 4]), now)
        if state.battery is not None:
            self._send(m.BATTERY, (state.battery,), now)
        if self._plan is not None:
            t, *rest = self._plan
            self._send(m.PLAN, (max(now - t, 0.0), *rest), now)
        if self.peers.decoder.key is not None:
            self._outbox.send_heard(now)

    def _send(self, kind: m.Kind, values: tuple[Any, ...], now: float) -> None:
        """Send one frame to all; one with invalid values, such as NaN, is only counted."""
        try:
            self._outbox.send(kind, values, now)
        except UsageError:
            self.unsent += 1
