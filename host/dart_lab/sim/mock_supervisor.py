"""The Nano's output supervisor in MockNano: heartbeats in, state out.

States and limits are those of the firmware: LINKED after 500 ms of beats with the token of this
boot and no gap above 60 ms, LIVE while the beats have mode armed or raw, TRIPPED when beats end or
one has mode stop, LOCKED on the third trip in 60 s.
"""

from __future__ import annotations

from collections import deque
from enum import IntEnum

# Duration of good beats until the link is accepted, and their longest gap [s].
LINK_TIME = 0.5
MAX_BEAT_GAP = 0.060
# Number of trips within a time [s] that locks the output.
LOCK_TRIPS = 3
LOCK_WINDOW = 60.0


class OutputState(IntEnum):
    """States of the output, as EVENT code 2 carries them (old << 8 | new)."""

    BOOT = 0
    IDLE = 1
    LINKED = 2
    LIVE = 3
    TRIPPED = 4
    LOCKED = 5


class MockSupervisor:
    """State machine of the output; ``changes`` collects pairs (old, new)."""

    def __init__(self, token: int, timeout: float = 0.110) -> None:
        self.state = OutputState.IDLE
        self.timeout = timeout
        self.changes: list[tuple[OutputState, OutputState]] = []
        self._token = token
        self._last = float("-inf")
        self._good_since = 0.0
        self._trips: deque[float] = deque(maxlen=LOCK_TRIPS)

    def age(self, t: float) -> float:
        """Return the time since the last valid beat [s], inf without one."""
        return t - self._last

    def beat(self, t: float, token: int, mode: int) -> None:
        """Take over a valid HEARTBEAT; one with another token only prevents the timeout."""
        if t - self._last > MAX_BEAT_GAP or token != self._token:
            self._good_since = t
        self._last = t
        good = token == self._token and t - self._good_since >= LINK_TIME
        state = self.state
        if mode == 3 and state in (OutputState.LINKED, OutputState.LIVE):
            self._leave(t, OutputState.TRIPPED if state is OutputState.LIVE else OutputState.IDLE)
        elif state is OutputState.IDLE and good and mode != 3:
            self._enter(OutputState.LINKED)
        elif state is OutputState.LINKED and mode in (1, 2) and token == self._token:
            self._enter(OutputState.LIVE)
        elif state is OutputState.LIVE and (mode == 0 or token != self._token):
            self._enter(OutputState.LINKED)
        elif state is OutputState.TRIPPED and mode != 0:
            self._good_since = t
        elif state is OutputState.TRIPPED and good:
            self._enter(OutputState.LINKED)

    def check(self, t: float) -> None:
        """Leave LIVE or LINKED when the beats have ended; called in each slot."""
        if t - self._last > self.timeout:
            if self.state is OutputState.LIVE:
                self._leave(t, OutputState.TRIPPED)
            elif self.state is OutputState.LINKED:
                self._enter(OutputState.IDLE)

    def _leave(self, t: float, state: OutputState) -> None:
        self._good_since = t
        if state is OutputState.TRIPPED:
            self._trips.append(t)
            full = len(self._trips) == LOCK_TRIPS and t - self._trips[0] <= LOCK_WINDOW
            state = OutputState.LOCKED if full else state
        self._enter(state)

    def _enter(self, state: OutputState) -> None:
        self.changes.append((self.state, state))
        self.state = state
