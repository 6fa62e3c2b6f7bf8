"""How the loop runs: periods, losses, ages."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from dart_hal.core.errors import UsageError
from dart_hal.core.timing import SAMPLE
from dart_hal.devices.actuation.limits import LONGEST_VALIDITY

SLOWEST = round(LONGEST_VALIDITY / SAMPLE / 2)
"""Frames from one State of a loop to its next, 25: a command that may hold for 0.5 s outlives
one round of the loop that comes too late."""
KEPT = 1000
"""Loop periods that are judged: 10 s at 100 Hz."""
LATE = SAMPLE
"""s by which work for one State may outlast the time to the next one. Beyond, at 100 Hz, one of
the PWM frames, 20 ms each, has gone out with the command before."""
WAITED = "this car waits for its program, a real one drives on: try sim://?pace=1"
DROVE_ON = "those between are skipped; the car drives on with a command only while it is valid"

log = logging.getLogger("dart_hal")


@dataclass(frozen=True, slots=True)
class Timing:
    """Loop periods p50, p99, max [s of the car's time]; frames lost and damaged on the
    line, States skipped by a slow loop; age of the last frame [s]. By the wall clock, on
    an emulated car too: ``work_p99``, ``work_max`` [s] that the loop took for one State,
    and how often it was ``late`` while the car was armed: 10 ms or more beyond the next."""

    p50: float
    p99: float
    max: float
    lost: int
    damaged: int
    skipped: int
    link_age: float
    work_p99: float = float("nan")
    work_max: float = float("nan")
    late: int = 0


def check_every(every: int) -> None:
    """Refuse a loop that no command would outlive. Raises UsageError."""
    if isinstance(every, bool) or not isinstance(every, int) or not 1 <= every <= SLOWEST:
        raise UsageError(f"states(every={every!r}) is no part of the stream", found=repr(every),
                         expected=f"1 to {SLOWEST}: a command holds for at most "
                         f"{LONGEST_VALIDITY} s, and must outlive a late round",
                         remedy="states(every=10) for 10 Hz")


class LoopTimer:
    """Collects the times at which the user's loop asked for a State, and how long it took.

    ``wall``: the computer's clock [s].
    """

    def __init__(self, wall: Callable[[], float] = time.perf_counter) -> None:
        self._periods: deque[float] = deque(maxlen=KEPT)
        self._work: deque[float] = deque(maxlen=KEPT)
        self._wall, self._given = wall, float("nan")
        self._last: float | None = None
        self._frames = 0
        self._seen: dict[int, int] = {}
        self.skipped = self.late = self.elsewhere = 0

    def begin(self) -> None:
        """A loop of this thread begins; what was read before is not lost to it."""
        self._seen[threading.get_ident()] = self._frames

    def tick(self, now: float, frames: int, every: int) -> None:
        """``frames`` have come, the last of which goes to a loop that asked for ``every`` n-th.

        Those that went to a loop of another thread meanwhile are lost to this one.
        """
        if self._last is not None:
            self._periods.append(now - self._last)
        self._last = now
        me = threading.get_ident()
        elsewhere = self._frames - self._seen.get(me, self._frames)
        self._frames += frames
        self._seen[me] = self._frames
        self.skipped += frames - every + elsewhere
        if elsewhere and not self.elsewhere:
            log.warning("two threads read the States of one car, so each gets only some of them: "
                        "read them in one, and let the other take car.on_state(listener); "
                        "health.skipped counts those that a loop did not get")
        self.elsewhere += elsewhere

    def give(self) -> None:
        """A State is handed to the loop."""
        self._given = self._wall()

    def asked(self, every: int, *, armed: bool, waits: bool) -> None:
        """The loop asks for the next State; a late round is counted, the first one said.

        ``every``: frames from one State to the next; ``waits``: the car stood still meanwhile,
        in virtual time.
        """
        work, self._given = self._wall() - self._given, float("nan")
        if work == work:  # the first State, and one after an error, answer none
            self._work.append(work)
        period = every * SAMPLE
        if armed and work >= period + LATE:
            self.late += 1
            if self.late == 1:
                log.warning("the loop took %.0f ms for one State, and they come each %.0f ms: %s; "
                            "car.timing counts the late rounds", 1e3 * work, 1e3 * period,
                            WAITED if waits else DROVE_ON, extra={"waits": waits})

    def quantiles(self) -> tuple[float, float, float]:
        """p50, p99, max [s]; NaN before two States."""
        return _quantiles(self._periods)

    def work(self) -> tuple[float, float]:
        """p99, max [s]; NaN before two States."""
        return _quantiles(self._work)[1:]


def _quantiles(values: deque[float]) -> tuple[float, float, float]:
    ordered = sorted(values)
    if not ordered:
        return float("nan"), float("nan"), float("nan")
    last = len(ordered) - 1
    return ordered[last // 2], ordered[int(last * 0.99)], ordered[last]
