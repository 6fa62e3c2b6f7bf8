"""Time that goes on while the computer is suspended, and whether it was.

Linux stops CLOCK_MONOTONIC during a suspend, and CLOCK_BOOTTIME goes on. A car drives through the
suspend of its computer: the PCA9685 repeats its last pulse. Ages and deadlines are therefore
measured on CLOCK_BOOTTIME; where a platform has none, on CLOCK_MONOTONIC.
"""

from __future__ import annotations

import time
from collections.abc import Callable

SHORTEST = 0.1
"""s: a suspend takes longer, and two readings of the clocks differ by less."""
READING = 0.02
"""s within which both clocks must be read to be compared."""
READINGS = 5

_BOOTTIME = getattr(time, "CLOCK_BOOTTIME", None)


def elapsed() -> float:
    """s since the start of the computer, suspends included."""
    return time.monotonic() if _BOOTTIME is None else time.clock_gettime(_BOOTTIME)


def elapsed_ns() -> int:
    """ns since the start of the computer, suspends included."""
    return time.monotonic_ns() if _BOOTTIME is None else time.clock_gettime_ns(_BOOTTIME)


class SuspendDetector:
    """Compares a clock that goes on during a suspend with one that stands still.

    boot, awake: these clocks [s].
    """

    def __init__(self, boot: Callable[[], float] = elapsed,
                 awake: Callable[[], float] | None = None) -> None:
        self._boot = boot
        self._awake = time.monotonic if awake is None else awake
        self._asleep = self._difference()

    def slept(self) -> bool:
        """Whether the computer was suspended since the last call."""
        known, now = self._asleep, self._difference()
        if now is None:
            return False
        self._asleep = now
        return known is not None and now - known > SHORTEST

    def _difference(self) -> float | None:
        """s of suspend so far; None where the clocks were not read in time.

        The process may lose the processor between two readings, which would look like a suspend.
        """
        for _ in range(READINGS):
            before = self._awake()
            boot = self._boot()
            if self._awake() - before < READING:
                return boot - before
        return None
