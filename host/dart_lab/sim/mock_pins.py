"""Option pins of MockNano: /OE gate D6, multiplexer select D5, own pulse D9."""

from __future__ import annotations

from collections import deque

from dart_hal.core.timing import PWM_FRAME
from dart_lab.sim.mock_supervisor import OutputState

# Width of the Nano's own pulses, and time from the start of the program to the first one [s].
OWN_PULSE_WIDTH = 0.0015
FIRST_PULSE = 0.005
# Time from the end of the own pulse to the switch [s]: an ESC would join pulses with a shorter gap.
SWITCH_GAP = 0.0001
# Time after which the firmware switches although D8 was high at the end of its own pulse [s].
SWITCH_RETRY = 0.003

PinEdge = tuple[float, str, int | None]


class MockPins:
    """Levels of the pins and their edges; ``cutoff`` is the parameter safety_out.

    No pin is driven from ``reset_at`` until the program starts at ``starts``. ``pending``: edges
    of the previous run that have not been taken yet. As in the firmware, the select of the
    multiplexer changes when the own pulse has ended and D8 shows that the board's pulse is low.
    /OE is switched at once if it is low, else after SWITCH_RETRY.
    """

    def __init__(self, cutoff: int, reset_at: float, starts: float,
                 pending: list[PinEdge]) -> None:
        self.levels: dict[str, int | None] = {"D5": 0, "D6": 0, "D9": 0}
        self._cutoff = cutoff
        self._log: list[PinEdge] = [*pending, *((starts, name, 0) for name in self.levels)]
        if starts > reset_at:
            self._log += [(reset_at, name, None) for name in self.levels]
        self._rise = self._next = starts + FIRST_PULSE
        self._select_changes: deque[tuple[float, int]] = deque()
        self._select = 0
        self._board: deque[tuple[float, bool]] = deque(maxlen=4)
        self._enable = 0
        self._enable_at: float | None = None
        self.capture_gate = ""

    def board_edge(self, level: bool, t: float) -> bool:
        """Take over a change of the spare channel at t; return the level at D8."""
        self._retry_enable(t)
        self._board.append((t, level))
        return level and (not self.capture_gate or self.levels[self.capture_gate] == 1)

    def apply_state(self, state: OutputState, t: float) -> None:
        """Drive the pins for a state of the supervisor that begins at t."""
        if self._cutoff == 2:
            self._select_changes.append((t, int(state is OutputState.LIVE)))
        self._retry_enable(t)
        self._enable = int(self._cutoff == 1
                           and state in (OutputState.LINKED, OutputState.LIVE))
        if self._enable_at is None and self._enable != self.levels["D6"]:
            self._enable_at = t + SWITCH_RETRY * self._board_high(t)
            self._retry_enable(t)

    def _retry_enable(self, now: float) -> None:
        """Switch /OE if that is due."""
        if self._enable_at is not None and self._enable_at <= now:
            self._drive("D6", self._enable, self._enable_at)
            self._enable_at = None

    def take(self, now: float) -> list[PinEdge]:
        """Return the edges since the last call; the own neutral pulse runs at 50 Hz."""
        self._retry_enable(now)
        while self._cutoff == 2 and self._next <= now:
            self._step()
        log = sorted((e for e in self._log if e[0] <= now), key=lambda e: e[:2])
        self._log = [e for e in self._log if e[0] > now]
        return log

    def _step(self) -> None:
        """Begin the own pulse, or end it, or switch; later if the board's pulse is high."""
        t = self._next
        rise = self._rise
        if t == rise:
            self._log.append((t, "D9", 1))
            self._next = rise + OWN_PULSE_WIDTH
            return
        if t == rise + OWN_PULSE_WIDTH:
            self._log.append((t, "D9", 0))
            self._next = t + SWITCH_GAP
            return
        early = t < rise + OWN_PULSE_WIDTH + SWITCH_RETRY
        if early and self._select_must_change(t) and self._board_high(t):
            self._next = t + SWITCH_RETRY
            return
        self._drive("D5", self._select, t)
        self._rise = self._next = rise + PWM_FRAME

    def _select_must_change(self, t: float) -> bool:
        """Return whether the select has to change."""
        while self._select_changes and self._select_changes[0][0] <= t:
            self._select = self._select_changes.popleft()[1]
        return self._select != self.levels["D5"]

    def _board_high(self, t: float) -> bool:
        return next((level for edge, level in reversed(self._board) if edge <= t), False)

    def _drive(self, name: str, level: int, t: float) -> None:
        if self.levels[name] != level:
            self.levels[name] = level
            self._log.append((t, name, level))
