"""The frame step: it reads bytes, returns States, and writes pulses and heartbeats.

In virtual time the step runs inside ``states()``. On a real link a thread runs it, so that
commands expire and heartbeats go on while the user's loop computes. One PWM frame belongs to
every second STATE. Its pulses are written when ``drive()`` answers that STATE, or
``MAX_LOOP_ANSWER_TIME`` later.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from math import isfinite
from typing import TYPE_CHECKING, Any

from dart_hal.car.battery import BatteryMonitor, BatteryWatch, DividerBattery, RecordedBattery
from dart_hal.car.camera import CarCamera
from dart_hal.car.driver import Driver
from dart_hal.car.facts import BEAT_LIMIT, STALE_LINK_TIME
from dart_hal.car.handshake import await_hello
from dart_hal.car.hooks import Hooks
from dart_hal.car.identity import Hello
from dart_hal.car.lidar import CarLidar, mount_of
from dart_hal.car.poses import PoseFeed, localiser_of, room_of
from dart_hal.car.receive import Receiver
from dart_hal.car.telemetry import BITS_PER_BYTE, Telemetry
from dart_hal.car.transmit import Transmitter
from dart_hal.core.config import CarFiles
from dart_hal.core.config.car import BatteryConfig
from dart_hal.core.errors import DartHalError, UsageError
from dart_hal.core.ports import Link
from dart_hal.core.timing import PWM_FRAME
from dart_hal.core.types import Applied, State
from dart_hal.devices.links.base import Backend
from dart_hal.wire.crc import crc16
from dart_hal.wire.messages import HELLO_REQ, PARAM_GET, PROTO, SCHEMA, SEED_FOREVER

if TYPE_CHECKING:
    from dart_hal.car.obstacle_guard import ObstacleGuard

# Line rate of a link that has none, such as a simulated one.
DEFAULT_BAUD = 500_000
# s that the user's loop has to answer a STATE before the pulses are written.
MAX_LOOP_ANSWER_TIME = 0.004
# s between two requests that the Nano has not answered.
INQUIRY_INTERVAL = 0.1

class Engine:
    """Link, receiver, transmitter and driver of one open car."""

    def __init__(self, backend: Backend, files: CarFiles) -> None:
        self.backend = backend
        self._own_lock = threading.RLock()
        self.lock: AbstractContextManager[Any] = self._own_lock
        self.hooks = Hooks()
        byte_time = BITS_PER_BYTE / (backend.link.baud or DEFAULT_BAUD)
        host_id = (crc16(backend.url.text.encode(), SEED_FOREVER) if backend.virtual
                   else int.from_bytes(os.urandom(2), "little"))
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
        self._latencies: deque[float] = deque(maxlen=500)
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
        self.battery: BatteryWatch | RecordedBattery | None = None
        if backend.battery:
            self.battery = RecordedBattery(backend.battery)
        elif backend.bus is not None and files.config.battery is not None:
            self.battery = self._open_battery(files.config.battery)
        self.localiser = localiser_of(backend, self.lidar)
        self.guard: ObstacleGuard | None = None
        self.listeners: list[Callable[[State], None]] = []
        # Identifier of the thread that calls the listeners now; 0: none.
        self._listening = 0

    def _open_battery(self, config: BatteryConfig) -> BatteryWatch:
        """Return what measures the battery: the INA219, or the Nano at its next heartbeats."""
        if config.source == "ina219":
            return BatteryMonitor(self.backend, config)
        divider = DividerBattery(config)
        self.receiver.handlers["BATTERY"] = divider.add
        self.transmitter.request("BATTERY")
        return divider

    @property
    def now(self) -> float:
        """Return the time [s] of the car's clock."""
        return self.backend.clock.now()

    @property
    def pin_values(self) -> Applied:
        """Return what the pins carry; in a replay, what the recording has."""
        recorded = self.backend.link.applied
        return self.driver.applied if recorded is None else recorded

    def identify(self) -> Hello:
        """Wait for HELLO. Raises NoHello, LinkLost."""
        return await_hello(self.backend, self)

    def poll(self, timeout: float) -> Hello | None:
        """Run one step; return HELLO if it has arrived. (``handshake.HelloRequester``)"""
        self.step(timeout)
        return self.receiver.hello

    def request_hello(self) -> None:
        """Send a HELLO_REQ that requests DIAG as well."""
        self.transmitter.send(HELLO_REQ, {"proto": PROTO, "schema": SCHEMA, "flags": 1}, self.now)

    def set_rate(self, baud: int) -> None:
        """Change the line rate; bytes received before it were noise."""
        with self.lock:
            self.backend.link.set_baud(baud)
            self.transmitter.byte_time = BITS_PER_BYTE / baud
            self.telemetry.set_byte_time(BITS_PER_BYTE / baud)
            self.receiver.restart_decoder()

    @property
    def bytes_received(self) -> int:
        """Return the number of bytes received at this line rate."""
        return self.receiver.fed

    def step(self, timeout: float) -> list[State]:
        """Write what is due, then read at most one chunk. Raises LinkLost."""
        with self.lock:
            self._write_if_due()
        chunk = self.backend.link.read(self._read_timeout(timeout))
        return self._process_bytes(chunk.data, chunk.t) if chunk is not None else []

    def hold_neutral(self) -> None:
        """Write neutral at once after a step failed; no frame is due, for a link may be lost."""
        with self.lock:
            self._due = False
            self.driver.lost(self.now)

    def resume(self, link: Link, received: bytes) -> list[State]:
        """Continue over ``link`` to the same board; ``received``: bytes with its HELLO."""
        with self.lock:
            self.backend.link = link
            self.transmitter.set_link(link)
            if self.writer is not None:
                self.writer.note("replugged", {"port": link.device, "t": repr(self.now)})
        return self._process_bytes(received, self.now)

    def _process_bytes(self, data: bytes, t: float) -> list[State]:
        """Decode bytes that arrived at host time ``t`` [s]; pass their States to the listeners."""
        with self.lock:
            if self.driver.hang_found:  # disarm before States of the hang are passed on
                self._write(self.now)
            # States first, then what has arrived with them: scans, images, poses.
            states = [self._process_state(state, t) for state in self.receiver.feed(
                self.hooks.rx(data, t), t, self.pin_values)]
            if self.localiser is not None:
                self.localiser.add_states(states)
            if self.battery is not None:
                if isinstance(self.battery, RecordedBattery):
                    self.battery.reach(t)
                states = [replace(state, battery=self.battery.voltage) for state in states]
            if self.lidar is not None:
                states = self.lidar.take(states, t, self.now)
            if self.guard is not None and states:
                self.driver.actuator.set_obstacle(self.guard.blocks(states[-1]))
            if self.camera is not None:
                states = self.camera.take(states, t, self.now)
            if self.poses is not None:
                states = self.poses.take(states, t, self.now)
            if self.driver.overdue:
                self._write(self.now)
        self._listening = threading.get_ident()
        try:
            for state in states:    # without the lock: one that blocks must not delay a stop
                for listener in self.listeners:
                    listener(state)
        finally:
            self._listening = 0
        return states

    def refuse_in_listener(self) -> None:
        """Raise UsageError if a listener calls: it would wait for the State that waits for it."""
        if self._listening == threading.get_ident():
            raise UsageError("a listener waits for a State", found="states(), arm() or another "
                             "call that waits, in a function of on_state()",
                             expected="a listener that returns at once",
                             remedy="set a flag in the listener, and call it in the main loop")

    def _process_state(self, state: State, t: float) -> State:
        """Update the driver, and return the State without a throttle that is cut off.

        Every second State makes a PWM frame due.
        """
        self._frames += 1
        state = self.driver.correct_hang(state)
        self.driver.observe(state, t)
        if self._frames % 2 == 0:
            self._due = True
            self._due_since = t
        applied = self.driver.apply_cutoff(state.applied)
        return state if applied is state.applied else replace(state, applied=applied)

    def answer(self) -> bool:
        """Write a command now if its PWM frame is due; return whether it was."""
        due = self._due
        if due:
            self._write(self.now)
        return due

    def start(self) -> None:
        """Note the HELLO that has arrived in the recording."""
        if self.writer is not None and self.receiver.hello_values is not None:
            self.writer.hello(self.receiver.hello_values)
            self.writer.note("line", {"baud": str(self.backend.link.baud or DEFAULT_BAUD)})

    def close(self) -> None:
        """Write neutral, and send a last heartbeat with the mode STOP.

        A thread that holds the lock for longer than a PWM frame is not waited for.
        """
        if isinstance(self.battery, BatteryWatch):
            self.battery.close()
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

    def end_pulses(self) -> None:
        """End the pulses again, once no thread writes any more."""
        self.driver.end_pulses()

    @property
    def link_age(self) -> float:
        """Return the time [s] since the last good frame."""
        return self.now - self.driver.observer.arrived_at

    def _read_timeout(self, timeout: float) -> float:
        """Return how long [s] a read may wait: until pulses are due, answered or not."""
        # The earliest of: refresh of the pulses, stale link, end of the loop's time to answer.
        due = self._refresh_at
        if not self.driver.observer.stale(self.now):
            due = min(due, self.driver.observer.arrived_at + STALE_LINK_TIME + 1e-6)
        if self._due and not self.backend.virtual:
            due = min(due, self._due_since + MAX_LOOP_ANSWER_TIME)
        return min(timeout, max(due - self.now, 0.0))  # exact: now + (due - now) is due

    def _write_if_due(self) -> None:
        now = self.now
        # In virtual time the loop has answered before the next step, else its time must be over.
        answered = self.backend.virtual or now >= self._due_since + MAX_LOOP_ANSWER_TIME
        if (self._due and answered) or now >= self._refresh_at or self.driver.overdue:
            self._write(now)

    def _write(self, now: float) -> None:
        """Write one PWM frame: pulses and heartbeat, and a ping and inquiries if they are due."""
        self._note_latency(now)
        self._due = False
        # Without a STATE, the pulses are refreshed after 1.5 PWM frames.
        self._refresh_at = now + 1.5 * PWM_FRAME
        applied = self.driver.frame(now)
        if self.receiver.hello is not None:
            self.transmitter.ping(now)  # first on the line: waiting bytes would look like delay
            self.driver.heartbeat(now)
            self._send_inquiries(now)
        self._record(now, applied)
        if isinstance(self.battery, BatteryWatch):
            self._read_battery(self.battery, now)

    def _read_battery(self, battery: BatteryWatch, now: float) -> None:
        """Read the voltage after the pulses, record it, and limit the throttle of later frames."""
        voltage = battery.update(now)
        self.driver.actuator.set_battery_cap(battery.cap)
        if self.writer is not None and voltage is not None:
            self.writer.battery(now, voltage)

    def _record(self, now: float, applied: Applied) -> None:
        """Record what the pins carry from ``now`` on, if it has changed."""
        if self.writer is not None and applied != self._noted:
            self.writer.applied(now, applied)
            self._noted = applied

    def _send_inquiries(self, now: float) -> None:
        """Request what the Nano has not sent since its boot: HELLO, limit of its heartbeat."""
        if now < self._inquire_at or self.backend.bus is None:
            return
        self._inquire_at = now + INQUIRY_INTERVAL
        if self.receiver.hello_stale:
            self.request_hello()
        if BEAT_LIMIT.id not in self.receiver.params:
            self.transmitter.send(PARAM_GET, {"id": BEAT_LIMIT.id}, now)

    def _note_latency(self, now: float) -> None:
        """Store the latency of this frame; its 99 % quantile over 10 s is a fact for arming."""
        due = self._due_since + MAX_LOOP_ANSWER_TIME if self._due else self._refresh_at
        if self.backend.virtual or not isfinite(due):
            return
        self._latencies.append(max(now - due, 0.0))
        if len(self._latencies) == self._latencies.maxlen and self._frames % 100 == 0:
            p99 = sorted(self._latencies)[int(0.99 * len(self._latencies))]
            self.driver.observer.loop_latency = p99
