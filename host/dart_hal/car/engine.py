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
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

from dart_hal.car.driver import Driver
from dart_hal.car.hooks import Hooks
from dart_hal.car.identify import await_hello
from dart_hal.car.identity import Hello
from dart_hal.car.receive import Receiver
from dart_hal.car.telemetry import BITS_PER_BYTE, Telemetry
from dart_hal.car.transmit import Transmitter
from dart_hal.config import CarFiles
from dart_hal.errors import DartHalError
from dart_hal.links.base import Backend
from dart_hal.types import Applied, State
from dart_hal.wire.crc import crc16
from dart_hal.wire.messages import HELLO_REQ, PROTO, SCHEMA, SEED_FOREVER

BAUD = 500_000
GRACE = 0.004
"""s that the user's loop has to answer a STATE before the pulses are written."""
REFRESH = 0.020
"""s, one PWM frame: pulses and heartbeat go on even when no STATE comes."""


class Engine:
    """Joins link, receiver, transmitter and driver of one open car."""

    def __init__(self, backend: Backend, files: CarFiles) -> None:
        self.backend = backend
        self.lock: AbstractContextManager[Any] = threading.RLock()
        self.hooks = Hooks()
        byte_time = BITS_PER_BYTE / getattr(backend.link, "baud", BAUD)
        host_id = (crc16(backend.url.text.encode(), SEED_FOREVER) if backend.virtual
                   else secrets.randbits(16))
        self.telemetry = Telemetry(files, byte_time)
        self.transmitter = Transmitter(backend.link, self.hooks, host_id, byte_time)
        self.receiver = Receiver(self.telemetry, self.transmitter)
        self.receiver.sent_at = getattr(backend.link, "ping_sent", None)
        self.driver = Driver(files, backend, self.transmitter, self.receiver)
        self.receiver.on_boot = self.driver.on_boot
        self._recorded: Callable[[], Applied] | None = None
        if hasattr(backend.link, "applied"):
            self._recorded = lambda: backend.link.applied
        self._frames = 0
        self._due = False
        self._due_since = 0.0
        self._refresh_at = float("-inf")
        self._noted: Applied | None = None
        self.recorder: Any = None
        self.listeners: list[Callable[[State], None]] = []

    @property
    def now(self) -> float:
        return self.backend.clock.now()

    @property
    def applied(self) -> Applied:
        """What the pins carry: from the recording in a replay."""
        return self._recorded() if self._recorded else self.driver.applied

    def identify(self) -> Hello:
        """Wait for HELLO. Raises NoHello, LinkLost."""
        return await_hello(self.backend, self)

    def poll(self, timeout: float) -> Hello | None:
        """One step; HELLO if it is there. (``identify.Caller``)"""
        self.step(timeout)
        return self.receiver.hello

    def ask(self) -> None:
        """Send a HELLO_REQ that wants DIAG as well."""
        self.transmitter.send(HELLO_REQ, {"proto": PROTO, "schema": SCHEMA, "flags": 1}, self.now)

    def at_rate(self, baud: int) -> None:
        """Go on at another line rate: what came before was noise."""
        with self.lock:
            self.backend.link.set_baud(baud)  # type: ignore[attr-defined]
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
        with self.lock:
            if chunk is None:
                return []
            data = self.hooks.rx(chunk.data, chunk.t)
            states = self.receiver.feed(data, chunk.t, self.applied)
            for state in states:
                self._frames += 1
                self.driver.seen(state, chunk.t)
                if self._frames % 2 == 0:
                    self._due, self._due_since = True, chunk.t
                for listener in self.listeners:
                    listener(state)
            return states

    def answer(self) -> bool:
        """A command came: write it now if this is its PWM frame; True if it was."""
        due = self._due
        if due:
            self._write(self.now)
        return due

    def start(self) -> None:
        """HELLO is there: note it, and say hello to the Nano's supervisor."""
        if self.recorder is not None and self.receiver.hello_values is not None:
            self.recorder.hello(self.receiver.hello_values)
            self.recorder.note("line", {"baud": str(getattr(self.backend.link, "baud", BAUD))})

    def close(self) -> None:
        """Neutral on the pins, a last heartbeat that says stop."""
        with self.lock:
            self.driver.close(self.now)
            if self.receiver.hello is not None:
                with contextlib.suppress(DartHalError):
                    self.driver.heartbeat(self.now)

    @property
    def link_age(self) -> float:
        """s since the last good frame."""
        return self.now - self.driver.seen_at

    def _patience(self, timeout: float) -> float:
        """How long a read may last: until pulses are due again, answered or not."""
        due = self._refresh_at
        if self._due and not self.backend.virtual:
            due = min(due, self._due_since + GRACE)
        return min(timeout, max(due - self.now, 0.0))  # exact: now + (due - now) is due

    def _write_if_due(self) -> None:
        now = self.now
        answered = self.backend.virtual or now >= self._due_since + GRACE
        if (self._due and answered) or now >= self._refresh_at:
            self._write(now)

    def _write(self, now: float) -> None:
        """One PWM frame: pulses, heartbeat, ping when its time has come."""
        self._due = False
        self._refresh_at = now + 1.5 * REFRESH
        applied = self.driver.frame(now)
        if self.receiver.hello is not None:
            self.transmitter.ping(now)  # first on the line: waiting bytes would look like delay
            self.driver.heartbeat(now)
        if self.recorder is not None and applied != self._noted:
            self.recorder.applied(now, applied)
            self._noted = applied
