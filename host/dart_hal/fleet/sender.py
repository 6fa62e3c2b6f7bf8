"""State of one session of a member: order of its frames, and their transit time."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from enum import Enum, auto
from math import inf
from typing import NamedTuple

from dart_hal.fleet import messages as m
from dart_hal.fleet.codec import ReceivedFrame

# s over which the fastest frame is searched: two quartzes drift by at most 1 ms in it.
TRANSIT_WINDOW = 10.0
# Frames by which one may be overtaken: 1 s of a car that sends three at 20 Hz. The numbers within
# are stored, so a copy is detected; older ones are rejected.
REPLAY_WINDOW = 64


class Session(NamedTuple):
    """One run of one program in a room."""

    name: str
    boot: int


class Order(Enum):
    """Order of a frame among those of its session."""

    NEWEST = auto()
    LATE = auto()
    COPY = auto()
    OLD = auto()


@dataclass
class Sender:
    """State of one session.

    ``began``: own time of its first frame; ``last``: of its last one, also if it was dropped;
    ``heard``: of its last accepted one; ``newest``, ``received_bits``: see ``classify``;
    ``newest_frames``: by kind, arrival and transit of the newest frame, and the frame; ``proof``:
    own time of the newest own frame that it has echoed; ``displaced``: when another session of its
    name replaced it in the table of names. Counts: frames accepted, late (overtaken), copies.
    """

    session: Session
    began: float
    heard: float
    last: float
    source: object = None
    newest: int = -1
    received_bits: int = 0
    first: int = 0
    accepted: int = 0
    late: int = 0
    copies: int = 0
    proof: float = -inf
    displaced: float | None = None
    newest_frames: dict[int, tuple[float, float, ReceivedFrame]] = field(default_factory=dict)
    transits: deque[tuple[float, float]] = field(default_factory=deque)

    @property
    def boot(self) -> int:
        """Number of the session."""
        return self.session.boot

    @property
    def lost(self) -> int:
        """Number of frames of this session that are missing."""
        return self.newest - self.first + 1 - self.accepted if self.accepted else 0

    def classify(self, seq: int) -> Order:
        """Classify a frame by its number, and store the number.

        1. Larger than all: NEWEST.
        2. ``REPLAY_WINDOW`` or more below the largest: OLD; whether it was received is unknown.
        3. Among the received numbers within the window: COPY; else LATE.

        Bit n of ``received_bits`` is set if the number ``newest - n`` was received.
        """
        behind = self.newest - seq
        if behind < 0:
            shifted = self.received_bits << -behind if -behind < REPLAY_WINDOW else 0
            self.received_bits = (shifted | 1) & ((1 << REPLAY_WINDOW) - 1)
            self.newest = seq
            self.accepted += 1
            return Order.NEWEST
        if behind >= REPLAY_WINDOW:
            self.late += 1
            return Order.OLD
        if self.received_bits >> behind & 1:
            self.copies += 1
            return Order.COPY
        self.received_bits |= 1 << behind
        self.late += 1
        self.accepted += 1
        self.first = min(self.first, seq)
        return Order.LATE

    def add_transit(self, transit: float, line: float) -> None:
        """Add the transit time of a frame, by two clocks with an unknown offset.

        ``transits`` stays sorted from the fastest to the newest, each slower than those before it:
        its first entry is the minimum of the window.
        """
        transits = self.transits
        while transits and transits[-1][1] >= transit:
            transits.pop()
        transits.append((line, transit))
        while transits[0][0] < line - TRANSIT_WINDOW:
            transits.popleft()

    def age(self, kind: m.Kind, now: float) -> float:
        """Age [s] of the content of the newest frame of this kind, by the fastest transit."""
        arrived, transit, _ = self.newest_frames[kind.id]
        return max(now - arrived, 0.0) + max(transit - self.transits[0][1], 0.0)
