"""A car and its page: what the car does goes out, what the pages want comes in.

Two threads meet here. The car's tells each State; the server's tells what pages say. STOP, a stick
that is let go and a socket that closes act at once, in the server's thread; everything that moves
the car waits for ``run``, the loop of whoever lets the page drive.
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
from dart_lab.live.view.operator import Operator, Refused
from dart_lab.live.view.rows import Row, points, row
from dart_lab.live.view.told import Lines, begin, not_armed, others_in, status
from dart_lab.live.view.words import AT_REST

STATUS_EVERY = 0.2
"""s between two messages about mode and health."""
STOPPED_FOR = 0.5
"""s that a STOP holds; then the car may be armed again, by hand."""
KEPT = 1000
"""Rows that wait for the server at most: 10 s."""
AGAIN = 0.2
"""s until a lost link is looked at again."""

_json = msgspec.json.encode
Others = Callable[[], Mapping[str, OtherPose]]
TAKEN = '{"type":"yours"}'


class Desk:
    """One car's page, without its sockets.

    access: who may drive; drives: whether a page may, in ``run``; lines (m, 4) [m]: the map that
    is drawn, or one for each frame of poses; others: tells where the other cars of a room are;
    max_throttle: of a stick that is pushed to its end; folder: where the recordings go that a page
    begins; clock [s]: by which commands age.
    """

    def __init__(self, car: Car, access: Access, *, drives: bool = False,
                 lines: Lines = None, others: Others | None = None, waive: Sequence[str] = (),
                 max_throttle: float = 0.35, folder: Path = Path("runs"),
                 clock: Callable[[], float] = elapsed) -> None:
        self.car, self.drives, self.operator = car, drives, Operator(access)
        self._others, self._lines = others, lines
        self._waive, self._max_throttle = tuple(waive), max_throttle
        self._clock, self._folder = clock, folder
        self._lock = threading.Lock()
        self._rows: deque[Row] = deque(maxlen=KEPT)
        self._state: State | None = None
        self._scan: Scan | None = None
        self._said: deque[str] = deque(maxlen=100)
        self._wishes: deque[m.Message] = deque(maxlen=10)
        self._logged: dict[str, float] = {}
        self._told_at, self._stopped_until, self._closed = -inf, -inf, False
        self._trouble = ""
        self.pages = 0
        self._leave = car.on_state(self._seen)

    def close(self) -> None:
        """Let go of the car, which stays open; ``run`` ends."""
        self._closed = True
        self._leave()

    # -- in the car's thread ---------------------------------------------------------------

    def _seen(self, state: State) -> None:
        with self._lock:
            self._rows.append(row(state, self.car.asked))
            self._state = state

    def run(self, duration: float = inf, ended: Callable[[], bool] = lambda: False) -> None:
        """Let the page drive for ``duration`` s, or until ``ended()``; wait for a lost link."""
        until = self._clock() + duration
        while self._clock() < until and not (ended() or self._closed):
            try:
                for _ in self.car.states(duration=max(until - self._clock(), 0.01)):
                    self._trouble = ""
                    self._step()
                    if ended() or self._closed:
                        return
            except LinkLost as lost:
                self._trouble = str(lost)
                time.sleep(AGAIN)

    def _step(self) -> None:
        while self._wishes:
            wish = self._wishes.popleft()
            if isinstance(wish, m.Arm):
                self._arm()
            elif isinstance(wish, m.Unlock):
                self.car.unlock("by hand, at the live page")
            elif isinstance(wish, m.Record):
                self._record(wish.on)
        with self._lock:
            wanted = self.operator.wanted(self._clock())
        if wanted is not None and self.car.mode == "ARMED":
            lock = self.car.files.config.limits.max_steering
            self.car.drive(steering=lock * wanted.steering,
                           throttle=self._max_throttle * wanted.throttle,
                           valid_for=wanted.left, source="view")

    def _arm(self) -> None:
        driver = self.operator.page
        try:
            arming = self.car.arming(waive=self._waive)
            for _ in arming:
                if self.operator.page is not driver:  # nobody is there to hold the stick
                    self.car.stop()
                    return
        except NotArmed as why:
            rolls = "ENCODER_MOVING" in (*why.reasons, *self.car.refusals())
            self._say(AT_REST if rolls else not_armed(self.car, why.reasons))
        with self._lock:
            self.operator.armed()

    def _record(self, on: bool) -> None:
        """Begin a file in the folder for recordings, or end it."""
        if not on:
            self.car.recorder.end()
            return
        path = self._folder / time.strftime("run_%Y-%m-%d_%H-%M-%S.mcap")
        try:
            self.car.recorder.start(path)
        except (DartHalError, OSError) as why:
            self._say(f"no recording: {why}")
        else:
            self._say(f"recording {path}")

    # -- in the server's thread ------------------------------------------------------------

    def joined(self, page: Hashable) -> Iterable[str]:
        """Who the car is; its samples come with the next batch."""
        self.pages += 1
        yield _json(begin(self.car, self._lines, self.drives)).decode()

    def said(self, page: Hashable, message: m.Message) -> str | None:
        """Raises Refused."""
        now = self._clock()
        if isinstance(message, m.Stop):
            self._stop(now)
            return None
        if not self.drives:
            raise Refused("this car is driven by a program: the page watches, and stops it")
        with self._lock:
            if isinstance(message, m.Take):
                self.operator.take(page, message.token)
                return TAKEN
            if isinstance(message, m.Leave):
                self.operator.gone(page)
            elif isinstance(message, m.Release):
                self.operator.release(page)
            elif isinstance(message, m.Drive):
                self.operator.drive(page, message.steering, message.throttle, message.heard,
                                    now, message.unchanged)
            else:
                self.operator.check(page)
                self._wishes.append(message)
        self._end_drive()
        return None

    def left(self, page: Hashable) -> None:
        """Its socket is closed: what it drove stops."""
        self.pages -= 1
        with self._lock:
            self.operator.gone(page)
        self._end_drive()

    def batch(self) -> Iterable[str]:
        """All samples since the last batch, and what changed."""
        now = self._clock()
        with self._lock:
            self.operator.wanted(now)
            rows, state = list(self._rows), self._state
            self._rows.clear()
        self._end_drive()
        if now > self._stopped_until > -inf:
            self._stopped_until = -inf
            self.car.run_stop(False, by="view")
        if not self.pages:
            return
        yield _json({"type": "rows", "now": now, "rows": rows}).decode()
        if (logged := dict(self.car.recorder.logged)) != self._logged:
            self._logged = logged
            yield _json({"type": "log", "values": logged}).decode()
        if state is not None and now - self._told_at >= STATUS_EVERY:
            self._told_at = now
            yield _json(status(self.car, state, self._extra())).decode()
            if self._others is not None:
                yield _json(others_in(state.estimate.frame, self._others())).decode()
            if state.scan is not None and state.scan is not self._scan:
                self._scan = state.scan
                yield _json({"type": "scan", "points": points(state.scan, state)}).decode()
        while self._said:
            yield self.refusal(self._said.popleft())

    def picture(self) -> bytes | None:
        """The camera's newest image, JPEG."""
        with self._lock:
            image = None if self._state is None else self._state.image
        return None if image is None else image.jpeg

    def is_driver(self, page: Hashable) -> bool:
        """Whether this page has the wheel."""
        with self._lock:
            return page == self.operator.page

    def refusal(self, why: str) -> str:
        """A sentence for the list of what was said."""
        return _json({"type": "said", "text": why}).decode()

    def _extra(self) -> dict[str, Any]:
        trouble = self._trouble or str(self.car.recorder.trouble or "")
        path = self.car.recorder.path
        return {"pages": self.pages, "driven": self.operator.page is not None, "trouble": trouble,
                "recording": path.name if path else ""}

    def _say(self, text: str) -> None:
        self._said.append(text)

    def _stop(self, now: float) -> None:
        """Whoever pressed it."""
        self._stopped_until = now + STOPPED_FOR
        self.car.run_stop(True, by="view", reason="STOP was pressed at a live page")
        with self._lock:
            self.operator.stop()
        self._say("STOP was pressed at a page")

    def _end_drive(self) -> None:
        """A drive by the page that is over leaves the car disarmed."""
        with self._lock:
            why, refusal = self.operator.ended(), self.operator.refusal()
        if refusal:
            self._say(refusal)
        if why:
            self.car.stop()
            self._say({"released": "the stick was let go", "gone": "the page that drove is gone",
                       "silent": "the page that drove fell silent"}[why] + ": arm to drive again")
