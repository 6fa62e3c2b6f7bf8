"""Input capture of MockNano: pulses of a spare PCA9685 channel on D8."""

from __future__ import annotations

_MASK = 0xFFFFFFFF
CK_PER_MS = 2000


class MockCapture:
    """Collects rises and high times of a requested number of periods.

    As in the firmware, the time limit is 100 ms plus 25 ms per period; it then reports what it has.
    """

    def __init__(self) -> None:
        self._periods = 0
        self._deadline = 0
        self._rises: list[int] = []
        self._highs: list[int] = []

    def begin(self, frames: int, ck: int) -> None:
        self._periods = frames
        self._deadline = ck + (100 + 25 * frames) * CK_PER_MS
        self._rises.clear()
        self._highs.clear()

    def edge(self, level: bool, ck: int) -> None:
        """Take over a change of the pin at ``ck``."""
        if not self._periods or self._full:
            return
        if level:
            self._rises.append(ck)
        elif self._rises:
            self._highs.append((ck - self._rises[-1]) & _MASK)

    @property
    def _full(self) -> bool:
        return len(self._rises) > self._periods

    def done(self, ck: int) -> bool:
        """Return whether all periods have been captured, or the time is over."""
        return self._periods > 0 and (self._full or ck >= self._deadline)

    def take(self) -> tuple[int, ...]:
        """Return the fields of CAPTURE and end the capture."""
        rises = self._rises or [0]
        highs = self._highs[:self._periods]
        self._periods = 0
        return (rises[0], rises[-1], sum(highs) & _MASK, len(rises) - 1,
                min(min(highs, default=0), 0xFFFF), min(max(highs, default=0), 0xFFFF))
