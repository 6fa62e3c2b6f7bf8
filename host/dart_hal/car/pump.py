"""Runs the frame step: the caller in virtual time, a thread on a real link."""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable
from typing import Protocol

from dart_hal.car.engine import Engine
from dart_hal.car.reconnect import BoardSearch, FoundBoard
from dart_hal.core.errors import LinkLost
from dart_hal.core.types import State

# s: longest wait of the thread's read, so that commands expire in time.
MAX_READ_TIME = 0.02
# s between two frames without a Nano: neutral again, and a heartbeat for the guard (100 ms).
REFRESH_INTERVAL = 0.04


class Pump(Protocol):
    """Delivers the States of a car until it is stopped."""

    def next(self, timeout: float) -> tuple[State, int]:
        """Return the newest State not yet delivered, and how many older ones were skipped.

        Raises LinkLost after ``timeout`` s without a frame.
        """

    def error(self) -> BaseException | None:
        """Return what ``next`` would raise and has not yet; a lost link is returned once."""

    def stop(self) -> None:
        """Stop the steps."""


def _no_frame_error(engine: Engine, timeout: float) -> LinkLost:
    return LinkLost(f"no frame for {timeout:g} s on {engine.backend.url.text}",
                    found=f"{engine.receiver.counters.ok} good frames before")


class InlinePump:
    """Virtual time: the step runs inside ``next``.

    Of several States of one step a program that drives gets the newest, as on a real link. A replay
    delivers each.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._is_replay = engine.backend.link.applied is not None
        self._waiting: deque[State] = deque()

    def next(self, timeout: float) -> tuple[State, int]:
        engine = self._engine
        engine.refuse_in_listener()
        if self._waiting:
            return self._waiting.popleft(), 0
        deadline = engine.now + timeout
        while True:
            states = engine.step(max(deadline - engine.now, 0.0))
            if states and self._is_replay:
                self._waiting.extend(states[1:])
                return states[0], 0
            if states:
                return states[-1], len(states) - 1
            if engine.now >= deadline:
                raise _no_frame_error(engine, timeout)

    def error(self) -> BaseException | None:
        return None

    def stop(self) -> None:
        """Do nothing: no thread runs."""


class ThreadPump:
    """Real link: a thread runs the steps, and a slow loop gets the newest State.

    When a step fails, by a lost link or a listener that raises (also SystemExit and
    KeyboardInterrupt):

    1. The thread writes neutral, and goes on refreshing it.
    2. ``next`` raises the error; a lost link only once.
    3. After a lost link, the thread searches for the board. When it is found, the steps go on, and
       the car is disarmed.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._news = threading.Condition()
        self._latest: State | None = None
        self._count = self._delivered = 0
        self._error: BaseException | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="dart-hal link", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        found: FoundBoard | None = None
        while not self._ended.is_set():
            try:
                if found is not None:
                    again, found = found, None
                    self._publish(self._engine.resume(*again))
                self._publish(self._engine.step(MAX_READ_TIME))
            except LinkLost as error:
                found = self._hold(error, self._search)
            except BaseException as error:  # noqa: BLE001 - raised by next(), at neutral
                self._hold(error, None)
        if found is not None:
            found.link.close()

    def _search(self) -> BoardSearch | None:
        """Release the port, so that its name is free, and start a search for the board."""
        from dart_hal.devices.links.serial_port import SerialLink

        engine = self._engine
        hello = engine.receiver.hello
        link = engine.backend.link
        link.close()
        return BoardSearch(engine.backend, hello.board_id, link.baud) \
            if hello is not None and isinstance(link, SerialLink) else None

    def _publish(self, states: list[State]) -> None:
        if states:
            with self._news:
                self._latest = states[-1]
                self._count += len(states)
                self._news.notify_all()

    def _hold(self, error: BaseException,
              start_search: Callable[[], BoardSearch | None] | None) -> FoundBoard | None:
        """Write neutral, publish the error, refresh neutral until the board is found or stop()."""
        engine = self._engine
        with engine.lock:  # until it is told: who finds the car disarmed finds out why
            with contextlib.suppress(BaseException):  # a hook of the program may raise again
                engine.hold_neutral()
            with self._news:
                self._error = error
                self._delivered = self._count  # what came before is old when it is told
                self._news.notify_all()
        # Now that the pins are neutral: the close of a port that vanished may wait.
        search = start_search() if start_search is not None else None
        # Refresh neutral, and feed the guard, until the search succeeds.
        found = None
        while found is None and not self._ended.wait(REFRESH_INTERVAL):
            with contextlib.suppress(BaseException), engine.lock:
                engine.driver.frame(engine.now)
            found = search.look(engine.now) if search is not None else None
        if search is not None:
            search.close()
        return found

    def next(self, timeout: float) -> tuple[State, int]:
        self._engine.refuse_in_listener()
        with self._news:
            self._news.wait_for(
                lambda: self._error is not None or self._count > self._delivered, timeout)
            if (error := self.error()) is not None:
                raise error
            if self._latest is None or self._count == self._delivered:
                raise _no_frame_error(self._engine, timeout)
            # What came before the loop was there to see it is not a slow loop's loss.
            skipped = self._count - self._delivered - 1 if self._delivered else 0
            self._delivered = self._count
            return self._latest, skipped

    def error(self) -> BaseException | None:
        with self._news:
            error = self._error
            if isinstance(error, LinkLost):
                self._error = None
            return error

    def stop(self) -> None:
        self._ended.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=1.0)
