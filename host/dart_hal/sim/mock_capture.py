"""Input capture of MockNano: pulses of a spare PCA9685 channel on D8."""

from __future__ import annotations

_MASK = 0xFFFFFFFF


class MockCapture:
    """Collects rises and high times until as many periods as were asked for."""

    def __init__(self) -> None:
        self._wanted = 0
        self._rises: list[int] = []
        self._highs: list[int] = []

    def begin(self, frames: int) -> None:
        self._wanted = frames
        self._rises.clear()
        self._highs.clear()

    def edge(self, level: bool, ck: int) -> None:
        """The pin changed at ``ck``."""
        if self.done or not self._wanted:
            return
        if level:
            self._rises.append(ck)
        elif self._rises:
            self._highs.append((ck - self._rises[-1]) & _MASK)

    @property
    def done(self) -> bool:
        """``frames`` whole periods lie between the first and the last rise."""
        return 0 < self._wanted < len(self._rises)

    def take(self) -> tuple[int, ...]:
        """Fields of CAPTURE; the capture is over."""
        n, highs = self._wanted, self._highs[:self._wanted]
        self._wanted = 0
        return (self._rises[0], self._rises[n], sum(highs) & _MASK, n,
                min(min(highs), 0xFFFF), min(max(highs), 0xFFFF))
