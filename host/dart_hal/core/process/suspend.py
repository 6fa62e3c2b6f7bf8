"""Measure time including suspends of the computer, and detect suspends.

Linux stops CLOCK_MONOTONIC during a suspend, but not CLOCK_BOOTTIME. A car keeps driving while its
computer is suspended: the PCA9685 repeats its last pulse. Ages and deadlines therefore use
CLOCK_BOOTTIME; on a platform without it, CLOCK_MONOTONIC.
"""

from __future__ import annotations

import time
from collections.abc import Callable

# s: shorter than a suspend, longer than the difference of two readings of the clocks.
MIN_SUSPEND = 0.1
# s between the readings of both clocks, if they are to be compared.
MAX_READING_TIME = 0.02
# Attempts to read both clocks in that time.
MAX_READINGS = 5

_BOOTTIME = getattr(time, "CLOCK_BOOTTIME", None)


def elapsed() -> float:
    """Return the time since the start of the computer [s], including suspends."""
    return time.monotonic() if _BOOTTIME is None else time.clock_gettime(_BOOTTIME)


def elapsed_ns() -> int:
    """Return the time since the start of the computer [ns], including suspends."""
    return time.monotonic_ns() if _BOOTTIME is None else time.clock_gettime_ns(_BOOTTIME)


class SuspendDetector:
    """Compares a clock that runs during a suspend with one that stops.

    boot, awake: these clocks [s].
    """

    def __init__(self, boot: Callable[[], float] = elapsed,
                 awake: Callable[[], float] | None = None) -> None:
        self._boot = boot
        self._awake = time.monotonic if awake is None else awake
        self._asleep = self._difference()

    def was_suspended(self) -> bool:
        """Return whether the computer was suspended since the last call."""
        known = self._asleep
        now = self._difference()
        if now is None:
            return False
        self._asleep = now
        return known is not None and now - known > MIN_SUSPEND

    def _difference(self) -> float | None:
        """Return the total time of suspends [s]; None if the clocks were not read in time.

        The process may lose the processor between two readings, which would look like a suspend.
        """
        for _ in range(MAX_READINGS):
            before = self._awake()
            boot = self._boot()
            if self._awake() - before < MAX_READING_TIME:
                return boot - before
        return None
