"""Connects a car with its pages: States are sent out, requests of the pages come in.

Two threads call this class. The thread of the car passes each State; the thread of the server
passes messages of pages. STOP, a released stick and a closed socket act at once, in the thread of
the server. Everything that moves the car waits for ``run``, in the thread of the car.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from math import inf
from pathlib import Path
from typing import Any

import msgspec

from dart_hal.car import Car
from dart_hal.core.errors import DartHalError, LinkLost, NotArmed
from dart_hal.core.process.suspend import elapsed
from dart_hal.core.types import Scan, State
from dart_hal.fleet.peers import OtherPose
from dart_lab.live.view import messages as m
from dart_lab.live.view.access import Access
from dart_lab.live.view.operator import MAX_RELEASED_S, Operator, Refused
from dart_lab.live.view.rows import Row, scan_points, state_row
from dart_lab.live.view.told import (
    Lines,
    begin_message,
    describe_refusals,
    others_message,
    status_message,
)
from dart_lab.live.view.words import WAIT_FOR_REST

# Time between two messages about mode and health.
STATUS_PERIOD_S = 0.2
# Time for which a STOP holds. After it the user may arm the car again.
STOP_DURATION_S = 0.5
# Rows that wait for the server: 10 s.
MAX_QUEUED_ROWS = 1000
# Time until a lost link is tried again.
RETRY_PERIOD_S = 0.2
_json = msgspec.json.encode
Others = Callable[[], Mapping[str, OtherPose]]
# Texts of the ends of a drive, by ``Operator.take_end_reason``.
END_TEXTS = {"released": "the page was hidden, or its stick was released",
             "gone": "the page that drove has left", "silent": "the page that drove fell silent",
             "idle": f"the stick was not held for {MAX_RELEASED_S:.0f} s"}
TAKEN_MESSAGE = '{"type":"yours"}'


class Desk:
    """The page of one car, without its sockets: the ``PageListener`` of its server.

    access: to the page. drives: a page may drive, in ``run``. lines (m, 4) [m]: map that is drawn,
    or one for each frame of poses. others: returns the poses of other cars. max_throttle: of a
    stick pushed to its end. folder: for recordings that a page starts. clock [s]: for the age of
    commands.
    """

    def __init__(self, car: Car, access: Access, *, drives: bool = False,
                 lines: Lines = None, others: Others | None = None, waive: Sequence[str] = (),
                 max_throttle: float = 0.35, folder: Path = Path("runs"),
                 clock: Callable[[], float] = elapsed) -> None:
        self.car = car
        self.drives = drives
        self.operator = Operator(access)
        self._others = others
        self._lines = lines
        self._waive = tuple(waive)
        self._max_throttle = max_throttle
        self._clock = clock
        self._folder = folder
        self._lock = threading.Lock()
        self._rows: deque[Row] = deque(maxlen=MAX_QUEUED_ROWS)
        self._state: State | None = None
        self._scan: Scan | None = None
        self._reports: deque[str] = deque(maxlen=100)
        self._requests: deque[m.Message] = deque(maxlen=10)
        self._logged: dict[str, float] = {}
        self._status_sent_at = -inf
        self._stopped_until = -inf
        self._arm_requested = False
        self._closed = False
        self._error = ""
        self.pages = 0
        self._unsubscribe = car.on_state(self._take_state)

    def close(self) -> None:
        """Detach from the car, which stays open; ``run`` ends, and so does a run-stop of a page."""
        self._closed = True
        self._unsubscribe()
        if self._stopped_until > -inf:
            self._stopped_until = -inf
            self.car.run_stop(False, source="view")

    # -- in the car's thread ---------------------------------------------------------------

    def _take_state(self, state: State) -> None:
        with self._lock:
            self._rows.append(state_row(state, self.car.asked))
            self._state = state

    def run(self, duration: float = inf, ended: Callable[[], bool] = lambda: False) -> None:
        """Let the page drive for ``duration`` s, or until ``ended()``; wait for a lost link."""
        until = self._clock() + duration
        while self._clock() < until and not (ended() or self._closed):
            try:
                for _ in self.car.states(duration=max(until - self._clock(), 0.01)):
                    self._error = ""
                    self._step()
                    if ended() or self._closed:
                        return
            except LinkLost as lost:
                self._error = str(lost)
                time.sleep(RETRY_PERIOD_S)

    def _step(self) -> None:
        """Handle the waiting requests, then send the command of the page to the car."""
        while self._requests:
            request = self._requests.popleft()
            if isinstance(request, m.Arm):
                self._arm()
            elif isinstance(request, m.Unlock):
                self.car.unlock("by hand, at the live page")
            elif isinstance(request, m.Record):
                self._record(request.on)
        with self._lock:
            command = self.operator.current_command(self._clock())
        if command is not None and self.car.mode == "ARMED":
            lock = self.car.files.config.limits.max_steering
            self.car.drive(steering=lock * command.steering,
                           throttle=self._max_throttle * command.throttle,
                           valid_for=command.remaining_s, source="view")

    def _arm(self) -> None:
        """Arm the car for the page that drives; report why it does not arm.

        A request that is done, or whose page has left, does nothing: ``_arm_requested`` is reset.
        """
        driver = self.operator.page
        if driver is None or not self._arm_requested:
            return
        try:
            arming = self.car.arming(waive=self._waive)
            for _ in arming:
                # The page that requested arming has left, or is hidden.
                if self.operator.page is not driver or not self._arm_requested:
                    self.car.stop()
                    return
        except NotArmed as why:
            rolls = "ENCODER_MOVING" in (*why.reasons, *self.car.refusals())
            self._report(WAIT_FOR_REST if rolls else describe_refusals(self.car, why.reasons))
        with self._lock:
            self._arm_requested = False
            armed = self.car.mode == "ARMED"
            left = self.operator.page is not driver
            if armed and not left:
                self.operator.begin(self._clock())
            else:
                self.operator.require_release()
        if armed and left:
            self.car.stop()

    def _record(self, on: bool) -> None:
        """Start a recording in the folder for them, or end it."""
        if not on:
            self.car.recorder.end()
            return
        path = self._folder / time.strftime("run_%Y-%m-%d_%H-%M-%S.mcap")
        try:
            self.car.recorder.start(path)
        except (DartHalError, OSError) as why:
            self._report(f"no recording: {why}")
        else:
            self._report(f"recording {path}")

    # -- in the server's thread ------------------------------------------------------------

    def open_page(self, page: Hashable) -> Iterable[str]:
        """Yield the message about the car; its samples follow in the next batch."""
        self.pages += 1
        yield _json(begin_message(self.car, self._lines, self.drives)).decode()

    def handle_message(self, page: Hashable, message: m.Message) -> str | None:
        """Handle a message of a page; return the answer to it. Raises Refused."""
        now = self._clock()
        if isinstance(message, m.Stop):
            self._stop(now)
            return None
        if not self.drives:
            raise Refused("this car is driven by a program: the page can only stop it")
        with self._lock:
            if isinstance(message, m.Take):
                self.operator.take(page, message.token)
                return TAKEN_MESSAGE
            if isinstance(message, m.Leave):
                if self.operator.remove_page(page, self.car.mode):
                    self._arm_requested = False
            elif isinstance(message, m.Release):
                self.operator.release(page, message.heard, now, self.car.mode)
                if message.heard is None and page == self.operator.page:
                    self._arm_requested = False
            elif isinstance(message, m.DriveRequest):
                self.operator.drive(page, message.steering, message.throttle, message.heard,
                                    now, message.unchanged)
            else:
                self.operator.check(page)
                self._arm_requested |= isinstance(message, m.Arm)
                self._requests.append(message)
        self._end_drive()
        return None

    def close_page(self, page: Hashable) -> None:
        """Remove a page whose socket is closed; the car stops if this page drove."""
        self.pages -= 1
        with self._lock:
            if self.operator.remove_page(page, self.car.mode):
                self._arm_requested = False
        self._end_drive()

    def batch(self) -> Iterable[str]:
        """Yield the samples since the last batch, and status messages."""
        now = self._clock()
        with self._lock:
            self.operator.current_command(now)
            rows = list(self._rows)
            state = self._state
            self._rows.clear()
        self._end_drive()
        if now > self._stopped_until > -inf:
            self._stopped_until = -inf
            self.car.run_stop(False, source="view")
        if not self.pages:
            return
        yield _json({"type": "rows", "now": now, "rows": rows}).decode()
        if (logged := dict(self.car.recorder.logged)) != self._logged:
            self._logged = logged
            yield _json({"type": "log", "values": logged}).decode()
        if state is not None and now - self._status_sent_at >= STATUS_PERIOD_S:
            self._status_sent_at = now
            yield _json(status_message(self.car, state, self._extra())).decode()
            if self._others is not None:
                yield _json(others_message(state.estimate.frame, self._others())).decode()
            if state.scan is not None and state.scan is not self._scan:
                self._scan = state.scan
                yield _json({"type": "scan", "points": scan_points(state.scan, state)}).decode()
        while self._reports:
            yield self.refusal(self._reports.popleft())

    def picture(self) -> bytes | None:
        """Return the newest image of the camera, JPEG; None without one."""
        with self._lock:
            image = None if self._state is None else self._state.image
        return None if image is None else image.jpeg

    def is_driver(self, page: Hashable) -> bool:
        """Return whether this page drives."""
        with self._lock:
            return page == self.operator.page

    def refusal(self, why: str) -> str:
        """Return a message for the list of notices of the page."""
        return _json({"type": "said", "text": why}).decode()

    def _extra(self) -> dict[str, Any]:
        error = self._error or str(self.car.recorder.trouble or "")
        path = self.car.recorder.path
        return {"pages": self.pages, "driven": self.operator.page is not None, "trouble": error,
                "recording": path.name if path else ""}

    def _report(self, text: str) -> None:
        self._reports.append(text)

    def _stop(self, now: float) -> None:
        """Stop the car for a STOP of any page."""
        self._stopped_until = now + STOP_DURATION_S
        self.car.run_stop(True, source="view", reason="STOP was pressed at a live page")
        with self._lock:
            self.operator.stop()
            self._arm_requested = False
        self._report("STOP was pressed at a page")

    def _end_drive(self) -> None:
        """Disarm the car if a drive by a page has ended, and report why."""
        with self._lock:
            why = self.operator.take_end_reason()
            refusal = self.operator.take_refusal()
        if refusal:
            self._report(refusal)
        if why:
            self.car.stop()
            self._report(f"{END_TEXTS[why]}: arm to drive again")
