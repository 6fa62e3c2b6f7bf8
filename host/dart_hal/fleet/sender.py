"""One session of a member: the order of its frames, and how long they travel."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from enum import Enum, auto
from math import inf
from typing import NamedTuple

from dart_hal.fleet import messages as m
from dart_hal.fleet.codec import Heard

WINDOW = 10.0
"""s over which the quickest frame is looked for: two quartzes part by 1 ms in it at the most."""
REPLAY_WINDOW = 64
"""Frames by which one may be overtaken: 1 s of a car that sends three at 20 Hz. The numbers
within are remembered, so a copy is recognised; older ones are refused whether new or not."""


class Session(NamedTuple):
    """One run of one program in a room."""

    name: str
    boot: int


class Order(Enum):
    """Where a frame comes among those of its session."""

    NEWEST = auto()
    LATE = auto()
    COPY = auto()
    OLD = auto()


@dataclass
class Sender:
    """One session.

    ``began``: own car's time of its first frame; ``last``: of its last one, also of one that was
    dropped; ``heard``: of its last frame that counted; ``newest``, ``came``: see ``place``;
    ``told``: of each kind when the newest frame arrived, what it took, and the frame; ``proof``:
    own car's time of the newest own frame that it has echoed; ``displaced``: when another session
    of its name took its place in the table of names. Counts: frames taken, late (overtaken), twice
    (came again).
    """

    session: Session
    began: float
    heard: float
    last: float
    source: object = None
    newest: int = -1
    came: int = 0
    first: int = 0
    taken: int = 0
    late: int = 0
    twice: int = 0
    proof: float = -inf
    displaced: float | None = None
    told: dict[int, tuple[float, float, Heard]] = field(default_factory=dict)
    transits: deque[tuple[float, float]] = field(default_factory=deque)

    @property
    def boot(self) -> int:
        """Number of the session."""
        return self.session.boot

    @property
    def lost(self) -> int:
        """Frames of this session that have not come, or not yet."""
        return self.newest - self.first + 1 - self.taken if self.taken else 0

    def place(self, seq: int) -> Order:
        """Count a frame by its number, and remember it.

        1. Larger than all: NEWEST.
        2. ``REPLAY_WINDOW`` or more below the largest: OLD; whether it came is not known.
        3. Among the numbers within the window that came: COPY; else LATE.

        Bit n of ``came`` is set where the number ``newest - n`` has come.
        """
        behind = self.newest - seq
        if behind < 0:
            shifted = self.came << -behind if -behind < REPLAY_WINDOW else 0
            self.came = (shifted | 1) & ((1 << REPLAY_WINDOW) - 1)
            self.newest = seq
            self.taken += 1
            return Order.NEWEST
        if behind >= REPLAY_WINDOW:
            self.late += 1
            return Order.OLD
        if self.came >> behind & 1:
            self.twice += 1
            return Order.COPY
        self.came |= 1 << behind
        self.late += 1
        self.taken += 1
        self.first = min(self.first, seq)
        return Order.LATE

    def travelled(self, transit: float, line: float) -> None:
        """A frame took so long, by two clocks that differ; ``quickest`` of the last 10 s."""
        kept = self.transits  # from the quickest to the newest, each slower than those before it
        while kept and kept[-1][1] >= transit:
            kept.pop()
        kept.append((line, transit))
        while kept[0][0] < line - WINDOW:
            kept.popleft()

    def age(self, kind: m.Kind, now: float) -> float:
        """s since what it told last of this kind left it, by the quickest frame known now."""
        arrived, transit, _ = self.told[kind.id]
        return max(now - arrived, 0.0) + max(transit - self.transits[0][1], 0.0)
