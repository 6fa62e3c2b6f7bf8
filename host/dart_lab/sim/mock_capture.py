"""Input capture of MockNano: pulses of a spare PCA9685 channel on D8."""

from __future__ import annotations

_MASK = 0xFFFFFFFF
CK_PER_MS = 2000


class MockCapture:
    """Collects rises and high times until as many periods as were asked for, or too late.

    As the firmware: 100 ms and 25 ms per period are waited, then it answers what there was.
    """

    def __init__(self) -> None:
        self._wanted = 0
        self._deadline = 0
        self._rises: list[int] = []
        self._highs: list[int] = []

    def begin(self, frames: int, ck: int) -> None:
        self._wanted = frames
        self._deadline = ck + (100 + 25 * frames) * CK_PER_MS
        self._rises.clear()
        self._highs.clear()

    def edge(self, level: bool, ck: int) -> None:
        """The pin changed at ``ck``."""
        if not self._wanted or self._full:
            return
        if level:
            self._rises.append(ck)
        elif self._rises:
            self._highs.append((ck - self._rises[-1]) & _MASK)

    @property
    def _full(self) -> bool:
        return len(self._rises) > self._wanted

    def done(self, ck: int) -> bool:
        """``frames`` whole periods lie between the first and the last rise, or time is up."""
        return self._wanted > 0 and (self._full or ck >= self._deadline)

    def take(self) -> tuple[int, ...]:
        """Fields of CAPTURE; the capture is over."""
        rises, highs = self._rises or [0], self._highs[:self._wanted]
        self._wanted = 0
        return (rises[0], rises[-1], sum(highs) & _MASK, len(rises) - 1,
                min(min(highs, default=0), 0xFFFF), min(max(highs, default=0), 0xFFFF))
