"""The guard in virtual time: its decisions and its messages, without a process of its own."""

from __future__ import annotations

import math
import os
from contextlib import suppress

from dart_hal.car.guarding import GuardPost
from dart_hal.core.timing import PWM_FRAME
from dart_hal.devices.actuation.guard import GuardLogic
from dart_hal.devices.actuation.guarded import Guard
from dart_lab.sim.world import World
from fault_table.drive import ESC, Drive
from fault_table.layers import list_removed

GUARD_STEP_S = PWM_FRAME / 4
"""s between two looks of the guard, as in ``dart_hal.devices.actuation.guard.watch``."""


class GuardProcess:
    """In place of the process object; ``code``: its exit status, None = it runs."""

    code: int | None = None

    def poll(self) -> int | None:
        return self.code

    def communicate(self, timeout: float) -> None:
        """It ends by itself."""


class WorldGuard:
    """A guard that the world runs: real `GuardLogic` and `Guard` at the two ends of real pipes.

    ``stopped``: it is killed, or its process is stopped.
    """

    def __init__(self, drive: Drive) -> None:
        self._drive = drive
        self._watch = GuardLogic()
        self._written = -math.inf
        self.stopped = False
        self._read, self._beats = os.pipe()
        self._status, self._write = os.pipe()
        for end in (self._read, self._beats, self._status, self._write):
            os.set_blocking(end, False)
        self.guard = guard = object.__new__(Guard)
        guard._clock = lambda: drive.world.t
        guard._heard = drive.world.t
        guard._process = self.process = GuardProcess()  # type: ignore[assignment]
        guard.tripped = guard.failed = guard._watched = False
        guard._beats = self._beats
        guard._status = self._status
        actuator = drive.car._engine.driver.actuator
        self._neutral = int(actuator.neutral_us / actuator.pca.count_us)
        post = object.__new__(GuardPost)
        post.error = None
        post.ready = lambda: None  # type: ignore[method-assign]
        post._guard = guard
        post._actuator = actuator
        if "guard" not in list_removed():
            actuator.gate = post.gate
            drive.car._engine.driver._guard = post
            drive.world.schedule(drive.world.t, self._look)

    def kill_driver(self) -> None:
        """The driver is gone: its end of the pipe closes, and it writes nothing any more."""
        os.close(self._beats)
        self._beats = -1
        self._forget()

    def close(self) -> None:
        """Close the pipes, before the car: it has no guard any more."""
        self.stopped = True
        self._forget()
        for end in (self._read, self._beats, self._status, self._write):
            if end >= 0:
                os.close(end)

    def _forget(self) -> None:
        driver = self._drive.car._engine.driver
        driver._guard = None
        driver.actuator.gate = None

    def kill(self) -> None:
        """The guard is gone."""
        self.stopped = True
        self.process.code = -9

    def _look(self, world: World) -> None:
        """One round of ``watch``: read, decide, write neutral or report that it lives."""
        world.schedule(world.t + GUARD_STEP_S, self._look)
        if self.stopped or self._watch.done:
            return
        with suppress(BlockingIOError):
            self._watch.note_bytes(os.read(self._read, 4096), world.t)
        if world.t - self._written < PWM_FRAME:
            return
        self._written = world.t
        if self._watch.due(world.t):
            counts = self._neutral
            self._drive.backend.bus.writeto(  # type: ignore[union-attr]
                0x40, bytes([0x06 + 4 * ESC, 0, 0, counts & 0xFF, counts >> 8]))
            self._watch.note_write(True)
            os.write(self._write, b"t")
        else:
            os.write(self._write, b"b")
