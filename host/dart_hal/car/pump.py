"""Who runs the frame step: the caller in virtual time, a thread on a real link."""

from __future__ import annotations

import contextlib
import threading
from typing import Protocol

from dart_hal.car.engine import REFRESH, Engine
from dart_hal.errors import LinkLost
from dart_hal.types import State

SLICE = 0.02
"""s: longest wait in the thread's read, so that expiry is noticed in time."""


class Pump(Protocol):
    """Delivers States and stands still when told to."""

    def next(self, timeout: float) -> tuple[State, int]:
        """The newest State not yet delivered and how many older ones were skipped.

        Raises LinkLost after ``timeout`` s without a frame.
        """

    def stop(self) -> None: ...


def _silence(engine: Engine, timeout: float) -> LinkLost:
    return LinkLost(f"no frame for {timeout:g} s on {engine.backend.url.text}",
                    found=f"{engine.receiver.counters.ok} good frames before")


class InlinePump:
    """Virtual time: the step runs inside ``next``; nothing is ever skipped."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def next(self, timeout: float) -> tuple[State, int]:
        engine = self._engine
        deadline = engine.now + timeout
        while True:
            states = engine.step(max(deadline - engine.now, 0.0))
            if states:
                return states[-1], len(states) - 1
            if engine.now >= deadline:
                raise _silence(engine, timeout)

    def stop(self) -> None:
        """Nothing runs by itself."""


class ThreadPump:
    """Real link: a thread steps; a slow loop gets the newest State.

    Whatever ends the stepping, a lost link or a listener that raises, the
    thread first brings the pins to neutral and goes on refreshing them; the
    error is raised by ``next``.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._news = threading.Condition()
        self._latest: State | None = None
        self._count = self._delivered = 0
        self._error: Exception | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="dart-hal link", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            while not self._ended.is_set():
                self._publish(self._engine.step(SLICE))
        except Exception as error:  # noqa: BLE001 - raised by next(), at neutral
            self._hold(error)

    def _publish(self, states: list[State]) -> None:
        if states:
            with self._news:
                self._latest = states[-1]
                self._count += len(states)
                self._news.notify_all()

    def _hold(self, error: Exception) -> None:
        """Neutral, then tell, then neutral again each PWM frame until ``stop``."""
        engine = self._engine
        with contextlib.suppress(Exception), engine.lock:
            engine.driver.lost(engine.now)
        with self._news:
            self._error = error
            self._news.notify_all()
        while not self._ended.wait(REFRESH):
            with contextlib.suppress(Exception), engine.lock:
                engine.driver.frame(engine.now)

    def next(self, timeout: float) -> tuple[State, int]:
        with self._news:
            self._news.wait_for(
                lambda: self._error is not None or self._count > self._delivered, timeout)
            if self._error is not None:
                raise self._error
            if self._latest is None or self._count == self._delivered:
                raise _silence(self._engine, timeout)
            # What came before the loop was there to see it is not a slow loop's loss.
            skipped = self._count - self._delivered - 1 if self._delivered else 0
            self._delivered = self._count
            return self._latest, skipped

    def stop(self) -> None:
        self._ended.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=1.0)
