"""Timing of the user's loop: periods, losses, overruns."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from dart_hal.core.errors import UsageError
from dart_hal.core.timing import SAMPLE
from dart_hal.devices.actuation.limits import MAX_VALIDITY

# Most frames per State of a loop, 25: a command may be valid for 0.5 s, and must outlast one period
# of the loop that is late.
MAX_FRAMES_PER_STATE = round(MAX_VALIDITY / SAMPLE / 2)
# Loop periods of the statistics: 10 s at 100 Hz.
MAX_LOOP_PERIODS = 1000
# s by which the computation for one State may exceed the period. Beyond, at 100 Hz, one PWM frame
# of 20 ms has repeated the previous command.
MAX_OVERRUN = SAMPLE
# Share of the rounds above which late ones are reported: a few per hundred are the computer's.
MAX_LATE_SHARE = 0.05
VIRTUAL_TIME_ADVICE = "this car waits for its program, a real one drives on: try sim://?pace=1"
REAL_TIME_ADVICE = ("those between are skipped; the car drives on with a command only while it is "
                    "valid")

log = logging.getLogger("dart_hal")


@dataclass(frozen=True, slots=True)
class Timing:
    """Timing of the loop; periods in s of the car's time.

    Attributes:
        p50, p99, max: median, 99 % quantile and maximum of the loop period.
        lost, damaged: frames on the line.
        skipped: States that a slow loop did not get.
        link_age: age [s] of the last frame.
        work_p99, work_max: time [s] by the wall clock that the loop took for one State, also for
            an emulated car.
        late: number of States of an armed car for which that was 10 ms or more above the period.
    """

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
    """Raise UsageError for a number of frames per State that no command would outlast."""
    if (isinstance(every, bool) or not isinstance(every, int)
            or not 1 <= every <= MAX_FRAMES_PER_STATE):
        raise UsageError(f"states(every={every!r}) is no part of the stream", found=repr(every),
                         expected=f"1 to {MAX_FRAMES_PER_STATE}: a command holds for at most "
                         f"{MAX_VALIDITY} s, and must outlive a late round",
                         remedy="states(every=10) for 10 Hz")


class LoopTimer:
    """Measures when the user's loop requests a State, and how long it computes.

    wall: clock of the computer [s].
    """

    def __init__(self, wall: Callable[[], float] = time.perf_counter) -> None:
        self._periods: deque[float] = deque(maxlen=MAX_LOOP_PERIODS)
        self._work: deque[float] = deque(maxlen=MAX_LOOP_PERIODS)
        self._wall = wall
        self._delivered_at = float("nan")
        self._last: float | None = None
        self._frames = 0
        self._frames_by_thread: dict[int, int] = {}
        self.skipped = self.late = self.elsewhere = 0
        self._armed_rounds = 0
        self._longest_late = 0.0
        self._late_period = float("nan")

    def begin(self) -> None:
        """Start a loop of this thread; States read before it are not lost to it."""
        self._frames_by_thread[threading.get_ident()] = self._frames

    def tick(self, now: float, frames: int, every: int) -> None:
        """Count new frames, the last of which goes to a loop that requested each ``every``-th.

        Frames that a loop of another thread got meanwhile are lost to this one.
        """
        if self._last is not None:
            self._periods.append(now - self._last)
        self._last = now
        me = threading.get_ident()
        elsewhere = self._frames - self._frames_by_thread.get(me, self._frames)
        self._frames += frames
        self._frames_by_thread[me] = self._frames
        self.skipped += frames - every + elsewhere
        if elsewhere and not self.elsewhere:
            log.warning("two threads read the States of one car, so each gets only some of them: "
                        "read them in one, and let the other take car.on_state(listener); "
                        "health.skipped counts those that a loop did not get")
        self.elsewhere += elsewhere

    def record_delivery(self) -> None:
        """Note that a State is passed to the loop."""
        self._delivered_at = self._wall()

    def record_request(self, every: int, *, armed: bool) -> None:
        """Note that the loop requests the next State, and count an overrun.

        every: frames per State. armed: only then a round and its overrun count.
        """
        work, self._delivered_at = self._wall() - self._delivered_at, float("nan")
        if work == work:  # the first State, and one after an error, answer none
            self._work.append(work)
        period = every * SAMPLE
        if armed and work == work:
            self._armed_rounds += 1
            if work >= period + MAX_OVERRUN:
                self.late += 1
                if work > self._longest_late:
                    self._longest_late = work
                    self._late_period = period

    def report_overruns(self, *, waits: bool) -> None:
        """Warn once, at the end of a drive, if too many rounds were late; waits: virtual time."""
        if self.late <= MAX_LATE_SHARE * self._armed_rounds:
            return
        log.warning("the loop was late in %d of %d rounds: it took up to %.0f ms for one State, "
                    "and they come each %.0f ms; %s", self.late, self._armed_rounds,
                    1e3 * self._longest_late, 1e3 * self._late_period,
                    VIRTUAL_TIME_ADVICE if waits else REAL_TIME_ADVICE, extra={"waits": waits})

    def quantiles(self) -> tuple[float, float, float]:
        """Return median, 99 % quantile and maximum [s] of the periods; NaN before two States."""
        return _quantiles(self._periods)

    def work(self) -> tuple[float, float]:
        """Return 99 % quantile and maximum [s] of the computation; NaN before two States."""
        return _quantiles(self._work)[1:]


def _quantiles(values: deque[float]) -> tuple[float, float, float]:
    ordered = sorted(values)
    if not ordered:
        return float("nan"), float("nan"), float("nan")
    last = len(ordered) - 1
    return ordered[last // 2], ordered[int(last * 0.99)], ordered[last]
