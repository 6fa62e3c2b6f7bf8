"""Option pins of MockNano: /OE gate D6, multiplexer select D5, own pulse D9."""

from __future__ import annotations

from collections import deque

from dart_hal.core.timing import PWM_FRAME
from dart_lab.sim.mock_supervisor import Output

WIDTH, FIRST = 0.0015, 0.005
"""s; the own pulses."""
SWITCH_GAP = 0.0001
"""s from the end of the own pulse to the switch: an ESC would join what is closer."""
RETRY = 0.003
"""s until the firmware switches all the same, where D8 was high at the end of its own pulse."""

PinEdge = tuple[float, str, int | None]


class MockPins:
    """Levels and their log; ``cutoff`` is the parameter safety_out.

    Nothing is driven from ``reset_at`` until the program starts at ``starts``;
    ``before``: edges of the run before that nobody has taken yet.
    The multiplexer's select changes as the firmware does it: when the own pulse
    has ended, and the board's is low as far as D8 shows it.
    """

    def __init__(self, cutoff: int, reset_at: float, starts: float,
                 before: list[PinEdge]) -> None:
        self.levels: dict[str, int | None] = {"D5": 0, "D6": 0, "D9": 0}
        self._cutoff = cutoff
        self._log: list[PinEdge] = [*before, *((starts, name, 0) for name in self.levels)]
        if starts > reset_at:
            self._log += [(reset_at, name, None) for name in self.levels]
        self._rise = self._next = starts + FIRST
        self._wanted: deque[tuple[float, int]] = deque()
        self._pass = 0
        self._board: deque[tuple[float, bool]] = deque(maxlen=4)
        self.behind_mux = False

    def board(self, level: bool, t: float) -> bool:
        """The spare channel changes at t; the level at D8."""
        self._board.append((t, level))
        return level and (not self.behind_mux or self.levels["D5"] == 1)

    def follow(self, state: Output, t: float) -> None:
        """The supervisor is in ``state`` from t on."""
        if self._cutoff == 2:
            self._wanted.append((t, int(state is Output.LIVE)))
        self._drive("D6", int(self._cutoff == 1 and state in (Output.LINKED, Output.LIVE)), t)

    def take(self, now: float) -> list[PinEdge]:
        """Edges since the last call; the own neutral pulse runs at 50 Hz."""
        while self._cutoff == 2 and self._next <= now:
            self._step()
        log = sorted((e for e in self._log if e[0] <= now), key=lambda e: e[:2])
        self._log = [e for e in self._log if e[0] > now]
        return log

    def _step(self) -> None:
        """Begin the own pulse, end it and switch, or switch later because the board's was high."""
        t, rise = self._next, self._rise
        if t == rise:
            self._log.append((t, "D9", 1))
            self._next = rise + WIDTH
            return
        if t == rise + WIDTH:
            self._log.append((t, "D9", 0))
            self._next = t + SWITCH_GAP
            return
        if t < rise + WIDTH + RETRY and self._wants(t) and self._board_high(t):
            self._next = t + RETRY
            return
        self._drive("D5", self._pass, t)
        self._rise = self._next = rise + PWM_FRAME

    def _wants(self, t: float) -> bool:
        """Whether the select shall change."""
        while self._wanted and self._wanted[0][0] <= t:
            self._pass = self._wanted.popleft()[1]
        return self._pass != self.levels["D5"]

    def _board_high(self, t: float) -> bool:
        return next((level for at, level in reversed(self._board) if at <= t), False)

    def _drive(self, name: str, level: int, t: float) -> None:
        if self.levels[name] != level:
            self.levels[name] = level
            self._log.append((t, name, level))
