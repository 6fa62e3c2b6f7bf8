"""Option pins of MockNano: /OE gate D6, multiplexer select D5, own pulse D9."""

from __future__ import annotations

from dart_hal.sim.mock_supervisor import Output

PERIOD, WIDTH, FIRST = 0.020, 0.0015, 0.005
"""s; the own pulses lie between the slots, in which D5 may change."""

PinEdge = tuple[float, str, int | None]


class MockPins:
    """Levels and their log; ``cutoff`` is the parameter safety_out.

    Nothing is driven from ``reset_at`` until the program starts at ``starts``.
    """

    def __init__(self, cutoff: int, reset_at: float, starts: float) -> None:
        self.levels: dict[str, int | None] = {"D5": 0, "D6": 0, "D9": 0}
        self._cutoff = cutoff
        self._log: list[PinEdge] = [(starts, name, 0) for name in self.levels]
        if starts > reset_at:
            self._log += [(reset_at, name, None) for name in self.levels]
        self._first = starts + FIRST
        self._pulses = 0

    def follow(self, state: Output, t: float) -> None:
        """The supervisor is in ``state`` from t on."""
        self._drive("D5", int(self._cutoff == 2 and state is Output.LIVE), t)
        self._drive("D6", int(self._cutoff == 1 and state in (Output.LINKED, Output.LIVE)), t)

    def take(self, now: float) -> list[PinEdge]:
        """Edges since the last call; the own neutral pulse runs at 50 Hz."""
        while self._cutoff == 2 and self._first + self._pulses * PERIOD + WIDTH <= now:
            rise = self._first + self._pulses * PERIOD
            self._log += [(rise, "D9", 1), (rise + WIDTH, "D9", 0)]
            self._pulses += 1
        log = sorted((e for e in self._log if e[0] <= now), key=lambda e: e[:2])
        self._log = [e for e in self._log if e[0] > now]
        return log

    def _drive(self, name: str, level: int, t: float) -> None:
        if self.levels[name] != level:
            self.levels[name] = level
            self._log.append((t, name, level))
