"""One car of a crossing: what it hears, when it asks, where it has to stand, why it waits.

Ten times a second: ``hear`` what came, ``step``, send ``tell``. With its own message each car
passes on the newest of another, of each in turn: a way that carries nothing for a second is gone
around. No time and no line is its own, so it is the same on the road, in the emulator and in the
tests.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from enum import Enum
from math import inf
from typing import NamedTuple

from dart_hal.control.crossing import order
from dart_hal.control.crossing.layout import Layout
from dart_hal.control.crossing.message import ROOM, Fault, decode, encode, parts
from dart_hal.control.crossing.order import Phase, Right, Verdict
from dart_hal.control.crossing.speed import safe_speed
from dart_hal.core.errors import UsageError

# m before its ground at which a car asks: 1 m to stop from 1 m/s, and 1.6 s for an answer, which
# at 80 % loss comes in time in four of five cases.
ASKS = 2.6
# m of the pose: what a car tells of itself is so much less.
SURE = 0.02
# s: at 80 % loss 20 messages in a row are lost once in a hundred times.
SILENT = 2.0
# s that a message may travel without being counted: it is as true as when it left.
OLD = 2.0


class Wait(str, Enum):
    """Why a car is slower than it wants to be; GOING: it is not.

    TO_BE_KNOWN: a car has not told that it hears this session; FOR_LEADER: the car ahead in its
    lane has not asked; STRANDED: restarted amid the ground without its stamp, it stays until it is
    carried away.
    """

    GOING = "GOING"
    TO_BE_KNOWN = "WAITING_TO_BE_KNOWN"
    FOR_LEADER = "WAITING_FOR_LEADER"
    FOR_GRANT = "WAITING_FOR_GRANT"
    FOR_CAR = "WAITING_FOR_CAR"
    SILENT = "SILENT_CAR"
    FOLLOWING = "FOLLOWING"
    STRANDED = "STRANDED"

    def __str__(self) -> str:
        return self.value


class Answer(NamedTuple):
    """line [m]: it has to stand before it; inf: none; who: the car that it waits for."""

    line: float
    wait: Wait
    who: str


class Coordinator:
    """Of car ``own`` of the roster ``names``, on a route of the layout from s [m] on.

    ``counts``: of what came, by ``Verdict``, ``Fault`` and OLD. ``events``: (t, wait, who) where
    that changed. ``keep(stamp)``: called with a stamp before it is told, and with 0 behind the
    ground: whoever wants to restart amid it writes the number to disk.
    """

    def __init__(
        self,
        layout: Layout,
        names: tuple[str, ...],
        own: str,
        route: str,
        s: float,
        boot: int,
        *,
        leader: str = "",
        kept: int | None = None,
        keep: Callable[[int], object] = lambda stamp: None,
    ) -> None:
        """boot: drawn for this session, not 0; leader: the car ahead in its lane; kept, after a
        restart: what ``keep`` was given last, 0 where that is lost. Raises UsageError for names
        that are not in the roster and for a first start too near the ground."""
        for name in (own, *((leader,) if leader else ())):
            if name not in names:
                raise UsageError(
                    f"no car {name} in this crossing", found=name, expected=", ".join(names)
                )
        self.layout = layout
        self.names = names
        self.route = layout.number(route)
        self.key = layout.key(names)
        self.keep = keep
        self._leader = names.index(leader) if leader else None
        if kept is None:
            layout.checked_start(self.route, s)
        self.car = order.begun(
            names.index(own),
            len(names),
            boot,
            self.route,
            s - SURE,
            self._place(s, kept or 0),
            kept or 0,
        )
        self.counts: Counter[str] = Counter()
        self.events: list[tuple[float, Wait, str]] = []
        self._heard: dict[int, float] = {}
        self._newest: dict[int, bytes] = {}
        self._turn = self.car.id
        self._t0: float | None = None

    def _place(self, s: float, kept: int) -> Phase:
        """What it is at the start of a session."""
        if s - SURE > self.layout.exit[self.route]:
            return Phase.DONE
        if kept:
            return Phase.WANT
        return Phase.FREE if s <= self.layout.entry[self.route] else Phase.BACK

    @property
    def phase(self) -> Phase:
        """What it wants."""
        return self.car.phase

    def hear(self, data: bytes, t: float, age: float = 0.0) -> Verdict | Fault:
        """Take what came at t [s] of this car's clock, ``age`` s after it was sent.

        Returns what became of the sender's own message; what it passes on is counted alone.
        """
        own, passed = parts(data)
        verdict = self._take(own, t, age)
        if passed and isinstance(verdict, Verdict):
            self._take(passed, t, age, passed=True)
        return verdict

    def _take(
        self, data: bytes, t: float, age: float, *, passed: bool = False
    ) -> Verdict | Fault:
        m = decode(data, self.key)
        if isinstance(m, Fault):
            self.counts[m.value] += 1
            return m
        verdict = Verdict.STRANGER
        if m.path < len(self.layout.routes):
            self.car, verdict = order.hear(self.car, m, passed=passed)
        if verdict is Verdict.TAKEN:
            self._heard[m.id] = t - age
            self._newest[m.id] = data
            self.counts["OLD"] += age > OLD
        self.counts[verdict.value] += 1
        return verdict

    def step(self, t: float, s: float, free: float = inf) -> Answer:
        """Where to stand, at t [s] and s [m] of its path; free [m]: to the middle of the car
        ahead in its lane, as the lidar sees it."""
        if self._t0 is None:
            self._t0 = t
        self.car = order.moved(self.car, s - SURE)
        why = self._ask(t, s)
        if s - SURE > self.layout.exit[self.route] and self.phase in (Phase.WANT, Phase.BACK):
            self.car = order.done(self.car)
            self.keep(0)
        answer = self._line(t, why)
        if self.phase is Phase.BACK:
            answer = Answer(s, Wait.STRANDED, "")
        ahead = s + free - self.layout.apart
        if ahead < answer.line:
            answer = Answer(ahead, Wait.FOLLOWING, "")
        if safe_speed(answer.line - s) >= self.layout.speed:
            answer = Answer(answer.line, Wait.GOING, "")
        if not self.events or self.events[-1][1:] != answer[1:]:
            self.events.append((t, answer.wait, answer.who))
        return answer

    def tell(self) -> bytes:
        """Its next message."""
        self.car, m = order.tell(self.car)
        own = encode(m, self.key)
        return own + (self._passed_on() if 2 * len(own) <= ROOM else b"")

    def _passed_on(self) -> bytes:
        """The newest message of the next car of which something new came; b"": of none."""
        for _ in self.names:
            self._turn = (self._turn + 1) % len(self.names)
            if self._turn in self._newest:
                return self._newest.pop(self._turn)
        return b""

    def _ask(self, t: float, s: float) -> tuple[Wait, int] | None:
        """Ask as soon as it may; else why it may not yet."""
        if self.phase is not Phase.FREE:
            return None
        leader = None if self._leader is None else self.car.others[self._leader]
        if self._leader is not None and (leader is None or leader.phase is Phase.FREE):
            return Wait.FOR_LEADER, self._leader
        if s > self.layout.entry[self.route] - ASKS:
            wants = order.want(self.car, round(t * 1e6))
            if wants is not self.car:
                self.keep(wants.ts)
                self.car = wants
                return None
        unknown = order.unknown_to(self.car)
        return None if unknown is None else (Wait.TO_BE_KNOWN, unknown)

    def _line(self, t: float, why: tuple[Wait, int] | None) -> Answer:
        """The nearest line of all cars."""
        entry = self.layout.entry[self.route]
        if self.phase in (Phase.FREE, Phase.BACK):
            return self._answer(t, entry, *(why or (Wait.FOR_GRANT, self.car.id)))
        line = inf
        wait = Wait.GOING
        who = self.car.id
        for j, other in enumerate(self.car.others):
            if j == self.car.id:
                continue
            right = order.right(self.car, j)
            if right is Right.GRANTED or (self.phase is Phase.DONE and right is not Right.AFTER):
                continue
            if right is Right.AFTER and other is not None:
                at = self.layout.line(other.path, other.s_minus, self.route)
                because = Wait.FOR_CAR
            else:
                at = entry
                because = Wait.FOR_GRANT
            if at < line:
                line = at
                wait = because
                who = j
        return self._answer(t, line, wait, who)

    def _answer(self, t: float, line: float, wait: Wait, who: int) -> Answer:
        """With SILENT_CAR where who is waited for has not been heard for long."""
        if who == self.car.id:
            return Answer(line, wait, "")
        since = self._heard.get(who, self._t0 or 0.0)
        return Answer(line, Wait.SILENT if t - since > SILENT else wait, self.names[who])
