"""The Nano's output supervisor as MockNano plays it: heartbeats in, state out.

The same states and limits as the firmware's: LINKED after 500 ms of beats
with this boot's token and no gap above 60 ms, LIVE while a beat says armed or
raw, TRIPPED when beats stop or one says stop, LOCKED on the third trip in 60 s.
"""

from __future__ import annotations

from collections import deque
from enum import IntEnum

GOOD_FOR, GAP = 0.5, 0.060
TRIPS, WINDOW = 3, 60.0


class Output(IntEnum):
    """States of the output, as EVENT code 2 carries them (old << 8 | new)."""

    BOOT = 0
    IDLE = 1
    LINKED = 2
    LIVE = 3
    TRIPPED = 4
    LOCKED = 5


class Supervisor:
    """Fed with beats and time [s]; ``changes`` collects (old, new) pairs."""

    def __init__(self, token: int, timeout: float = 0.110) -> None:
        self.state = Output.IDLE
        self.timeout = timeout
        self.changes: list[tuple[Output, Output]] = []
        self._token = token
        self._last = float("-inf")
        self._good_since = 0.0
        self._trips: deque[float] = deque(maxlen=TRIPS)

    def age(self, t: float) -> float:
        """Seconds since the last valid beat (inf = none)."""
        return t - self._last

    def beat(self, t: float, token: int, mode: int) -> None:
        """A valid HEARTBEAT; one with another token keeps the link alive, no more."""
        if t - self._last > GAP or token != self._token:
            self._good_since = t
        self._last = t
        good = token == self._token and t - self._good_since >= GOOD_FOR
        state = self.state
        if mode == 3 and state in (Output.LINKED, Output.LIVE):
            self._leave(t, Output.TRIPPED if state is Output.LIVE else Output.IDLE)
        elif state is Output.IDLE and good and mode != 3:
            self._go(Output.LINKED)
        elif state is Output.LINKED and mode in (1, 2) and token == self._token:
            self._go(Output.LIVE)
        elif state is Output.LIVE and (mode == 0 or token != self._token):
            self._go(Output.LINKED)
        elif state is Output.TRIPPED and mode != 0:
            self._good_since = t
        elif state is Output.TRIPPED and good:
            self._go(Output.LINKED)

    def check(self, t: float) -> None:
        """Called each slot: are the beats still coming?"""
        if t - self._last > self.timeout:
            if self.state is Output.LIVE:
                self._leave(t, Output.TRIPPED)
            elif self.state is Output.LINKED:
                self._go(Output.IDLE)

    def _leave(self, t: float, to: Output) -> None:
        self._good_since = t
        if to is Output.TRIPPED:
            self._trips.append(t)
            full = len(self._trips) == TRIPS and t - self._trips[0] <= WINDOW
            to = Output.LOCKED if full else to
        self._go(to)

    def _go(self, to: Output) -> None:
        self.changes.append((self.state, to))
        self.state = to
