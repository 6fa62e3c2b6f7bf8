"""The frame step: bytes in, States out, pulses and heartbeat out.

In virtual time the step runs inside ``states()``; on a real link a thread runs
it, so that expiry and heartbeat go on while the user's loop computes. One PWM
frame belongs to every second STATE. Its pulses are written when ``drive()``
answers that STATE, or when nobody did within ``GRACE``.
"""

from __future__ import annotations

import contextlib
import secrets
import threading
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from math import isfinite
from typing import Any

from dart_hal.car.camera import CarCamera
from dart_hal.car.driver import Driver
from dart_hal.car.facts import BEAT_LIMIT, STALE
from dart_hal.car.handshake import await_hello
from dart_hal.car.hooks import Hooks
from dart_hal.car.identity import Hello
from dart_hal.car.lidar import CarLidar, mount_of
from dart_hal.car.poses import PoseFeed, localiser_of, room_of
from dart_hal.car.receive import Receiver
from dart_hal.car.telemetry import BITS_PER_BYTE, Telemetry
from dart_hal.car.transmit import Transmitter
from dart_hal.core.config import CarFiles
from dart_hal.core.errors import DartHalError
from dart_hal.core.ports import Link
from dart_hal.core.timing import PWM_FRAME
from dart_hal.core.types import Applied, State
from dart_hal.devices.links.base import Backend
from dart_hal.wire.crc import crc16
from dart_hal.wire.messages import HELLO_REQ, PARAM_GET, PROTO, SCHEMA, SEED_FOREVER

BAUD = 500_000
GRACE = 0.004
"""s that the user's loop has to answer a STATE before the pulses are written."""
INQUIRE_EVERY = 0.1
"""s between two questions that the Nano has not answered."""

class Engine:
    """Joins link, receiver, transmitter and driver of one open car."""

    def __init__(self, backend: Backend, files: CarFiles) -> None:
        self.backend = backend
        self._own_lock = threading.RLock()
        self.lock: AbstractContextManager[Any] = self._own_lock
        self.hooks = Hooks()
        byte_time = BITS_PER_BYTE / (backend.link.baud or BAUD)
        host_id = (crc16(backend.url.text.encode(), SEED_FOREVER) if backend.virtual
                   else secrets.randbits(16))
        self.telemetry = Telemetry(files, byte_time)
        self.transmitter = Transmitter(backend.link, self.hooks, host_id, byte_time)
        self.receiver = Receiver(self.telemetry, self.transmitter)
        self.receiver.sent_at = backend.link.ping_sent
        self.driver = Driver(files, backend, self.transmitter, self.receiver)
        self.receiver.on_boot = self.driver.on_boot
        self._frames = 0
        self._due = False
        self._due_since = 0.0
        self._refresh_at = self._inquire_at = float("-inf")
        self._late: deque[float] = deque(maxlen=500)
        self._noted: Applied | None = None
        self.writer: Any = None
        self.poses: PoseFeed | None = None
        if backend.poses is not None:
            self.telemetry.room = room = room_of(files, self.telemetry.odometry, backend.poses)
            self.poses = PoseFeed(backend.poses, room)
        self.lidar = (None if backend.lidar is None
                      else CarLidar(backend.lidar, mount_of(files), lambda: self.lock))
        self.camera = (None if backend.camera is None
                       else CarCamera(backend.camera, lambda: self.lock))
        self.localiser = localiser_of(backend, self.lidar)
        self.listeners: list[Callable[[State], None]] = []

    @property
    def now(self) -> float:
        return self.backend.clock.now()

    @property
    def applied(self) -> Applied:
        """What the pins carry: from the recording in a replay."""
        recorded = self.backend.link.applied
        return self.driver.applied if recorded is None else recorded

    def identify(self) -> Hello:
        """Wait for HELLO. Raises NoHello, LinkLost."""
        return await_hello(self.backend, self)

    def poll(self, timeout: float) -> Hello | None:
        """One step; HELLO if it is there. (``handshake.Caller``)"""
        self.step(timeout)
        return self.receiver.hello

    def ask(self) -> None:
        """Send a HELLO_REQ that wants DIAG as well."""
        self.transmitter.send(HELLO_REQ, {"proto": PROTO, "schema": SCHEMA, "flags": 1}, self.now)

    def at_rate(self, baud: int) -> None:
        """Go on at another line rate: what came before was noise."""
        with self.lock:
            self.backend.link.set_baud(baud)
            self.transmitter.byte_time = BITS_PER_BYTE / baud
            self.telemetry.set_byte_time(BITS_PER_BYTE / baud)
            self.receiver.restart_decoder()

    @property
    def came(self) -> int:
        """Bytes received at this rate."""
        return self.receiver.fed

    def step(self, timeout: float) -> list[State]:
        """Write what is due, then read at most one chunk. Raises LinkLost."""
        with self.lock:
            self._write_if_due()
        chunk = self.backend.link.read(self._patience(timeout))
        return self._take(chunk.data, chunk.t) if chunk is not None else []

    def resume(self, link: Link, said: bytes) -> list[State]:
        """Go on over ``link`` to the same board; ``said``: what came there, its HELLO in it."""
        with self.lock:
            self.backend.link = link
            self.transmitter.over(link)
            if self.writer is not None:
                self.writer.note("replugged", {"port": link.device, "t": repr(self.now)})
        return self._take(said, self.now)

    def _take(self, data: bytes, t: float) -> list[State]:
        """Bytes that came: States for whoever listens, and every second one is a PWM frame."""
        with self.lock:
            states = [self._seen(state, t) for state in self.receiver.feed(
                self.hooks.rx(data, t), t, self.applied)]
            if self.localiser is not None:
                self.localiser.add_states(states)
            if self.lidar is not None:
                states = self.lidar.take(states, t, self.now)
            if self.camera is not None:
                states = self.camera.take(states, t, self.now)
            if self.poses is not None:
                states = self.poses.take(states, t, self.now)
            if self.driver.overdue:
                self._write(self.now)
        for state in states:        # without the lock: one that blocks holds up nobody's stop
            for listener in self.listeners:
                listener(state)
        return states

    def _seen(self, state: State, t: float) -> State:
        """The State, without the throttle that it says is cut off; counts PWM frames."""
        self._frames += 1
        self.driver.seen(state, t)
        if self._frames % 2 == 0:
            self._due, self._due_since = True, t
        applied = self.driver.passed(state.applied)
        return state if applied is state.applied else replace(state, applied=applied)

    def answer(self) -> bool:
        """A command came: write it now if this is its PWM frame; True if it was."""
        due = self._due
        if due:
            self._write(self.now)
        return due

    def start(self) -> None:
        """HELLO is there: note it in the recording."""
        if self.writer is not None and self.receiver.hello_values is not None:
            self.writer.hello(self.receiver.hello_values)
            self.writer.note("line", {"baud": str(self.backend.link.baud or BAUD)})

    def close(self) -> None:
        """Neutral on the pins, a last heartbeat that says stop.

        Whoever holds the lock for longer than a PWM frame is not waited for.
        """
        held = self._own_lock.acquire(timeout=PWM_FRAME)
        try:
            now = self.now
            self.driver.close(now)
            self._record(now, self.driver.applied)
            if self.receiver.hello is not None:
                with contextlib.suppress(DartHalError):
                    self.driver.heartbeat(self.now)
        finally:
            if held:
                self._own_lock.release()

    @property
    def link_age(self) -> float:
        """s since the last good frame."""
        return self.now - self.driver.observer.seen_at

    def _patience(self, timeout: float) -> float:
        """How long a read may last: until pulses are due again, answered or not."""
        due = self._refresh_at
        if not self.driver.observer.stale(self.now):
            due = min(due, self.driver.observer.seen_at + STALE + 1e-6)
        if self._due and not self.backend.virtual:
            due = min(due, self._due_since + GRACE)
        return min(timeout, max(due - self.now, 0.0))  # exact: now + (due - now) is due

    def _write_if_due(self) -> None:
        now = self.now
        answered = self.backend.virtual or now >= self._due_since + GRACE
        if (self._due and answered) or now >= self._refresh_at or self.driver.overdue:
            self._write(now)

    def _write(self, now: float) -> None:
        """One PWM frame: pulses, heartbeat, ping and questions when their time has come."""
        self._note_lateness(now)
        self._due = False
        self._refresh_at = now + 1.5 * PWM_FRAME
        applied = self.driver.frame(now)
        if self.receiver.hello is not None:
            self.transmitter.ping(now)  # first on the line: waiting bytes would look like delay
            self.driver.heartbeat(now)
            self._inquire(now)
        self._record(now, applied)

    def _record(self, now: float, applied: Applied) -> None:
        """What the pins carry from ``now`` on, where it changes."""
        if self.writer is not None and applied != self._noted:
            self.writer.applied(now, applied)
            self._noted = applied

    def _inquire(self, now: float) -> None:
        """Ask for what the Nano has not said since it booted: who it is, how long it waits."""
        if now < self._inquire_at or self.backend.bus is None:
            return
        self._inquire_at = now + INQUIRE_EVERY
        if self.receiver.hello_stale:
            self.ask()
        if BEAT_LIMIT.id not in self.receiver.params:
            self.transmitter.send(PARAM_GET, {"id": BEAT_LIMIT.id}, now)

    def _note_lateness(self, now: float) -> None:
        """How long after its time this frame is written; p99 of the last 10 s."""
        due = self._due_since + GRACE if self._due else self._refresh_at
        if self.backend.virtual or not isfinite(due):
            return
        self._late.append(max(now - due, 0.0))
        if len(self._late) == self._late.maxlen and self._frames % 100 == 0:
            self.driver.observer.loop_late = sorted(self._late)[int(0.99 * len(self._late))]
