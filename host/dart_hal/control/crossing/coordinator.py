"""One car of a crossing: takes messages, requests, and finds where it has to stop and why.

Ten times a second: ``receive`` new messages, ``step``, send ``next_message``. With its own message
each car relays the newest one of another car, in turn: a link that fails for a second is bypassed.
It has no clock and no transport of its own, so it is the same on the road, in the emulator and in
the tests.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from math import inf
from typing import NamedTuple

from dart_hal.control.crossing import order
from dart_hal.control.crossing.layout import CrossingLayout
from dart_hal.control.crossing.message import (
    MAX_DATAGRAM_BYTES,
    MessageFault,
    decode,
    encode,
    split_datagram,
)
from dart_hal.control.crossing.order import CrossingPhase, MessageVerdict, Precedence
from dart_hal.control.crossing.speed import safe_speed
from dart_hal.core.errors import UsageError
from dart_hal.core.types import TextEnum

# Distance before the ground at which a car requests [m]: 1 m to stop from 1 m/s, and 1.6 s for an
# answer, which at 80 % loss arrives in time in four of five cases.
REQUEST_DISTANCE = 2.6
# Margin of the pose [m], by which the reported arc length is less.
POSE_MARGIN = 0.02
# Time without messages after which a car is silent [s]: at 80 % loss 20 messages in a row are lost
# once in a hundred times.
MAX_SILENCE = 2.0
# Age from which on a message is counted as old [s]: its content stays true.
MAX_MESSAGE_AGE = 2.0


class CrossingWait(TextEnum):
    """Why a car is slower than its target speed; GOING: it is not.

    TO_BE_KNOWN: a car has not reported that it receives this session; FOR_LEADER: the car ahead in
    its lane has no request; STRANDED: restarted within the ground without its stamp, it stays until
    it is carried away.
    """

    GOING = "GOING"
    TO_BE_KNOWN = "WAITING_TO_BE_KNOWN"
    FOR_LEADER = "WAITING_FOR_LEADER"
    FOR_GRANT = "WAITING_FOR_GRANT"
    FOR_CAR = "WAITING_FOR_CAR"
    SILENT = "SILENT_CAR"
    FOLLOWING = "FOLLOWING"
    STRANDED = "STRANDED"


class StopLine(NamedTuple):
    """line [m]: arc length before which the car has to stop, inf: none; who: the car that it waits
    for.
    """

    line: float
    wait: CrossingWait
    who: str


class Coordinator:
    """Coordinator of car ``own`` of the roster ``names``, on a route of the layout from s [m] on.

    ``counts``: of messages by ``MessageVerdict``, ``MessageFault`` and OLD. ``events``: (t, wait,
    who) at each change. ``store_stamp(stamp)``: called with a stamp before it is sent, and with 0
    after the ground: a program that can restart within the ground writes it to disk.
    """

    def __init__(
        self,
        layout: CrossingLayout,
        names: tuple[str, ...],
        own: str,
        route: str,
        s: float,
        boot: int,
        *,
        leader: str = "",
        stored_stamp: int | None = None,
        store_stamp: Callable[[int], object] = lambda stamp: None,
    ) -> None:
        """boot: random number of this session, not 0; leader: the car ahead in its lane;
        stored_stamp: after a restart the last argument of ``store_stamp``, 0 if that is lost.
        Raises UsageError for names that are not in the roster and for a first start too near the
        ground.
        """
        for name in (own, *((leader,) if leader else ())):
            if name not in names:
                raise UsageError(
                    f"no car {name} in this crossing", found=name, expected=", ".join(names)
                )
        self.layout = layout
        self.names = names
        self.route = layout.number(route)
        self.key = layout.key(names)
        self.store_stamp = store_stamp
        self._leader = names.index(leader) if leader else None
        if stored_stamp is None:
            layout.check_start(self.route, s)
        self.car = order.start_session(
            names.index(own),
            len(names),
            boot,
            self.route,
            s - POSE_MARGIN,
            self._initial_phase(s, stored_stamp or 0),
            stored_stamp or 0,
        )
        self.counts: Counter[str] = Counter()
        self.events: list[tuple[float, CrossingWait, str]] = []
        self._received_t: dict[int, float] = {}
        self._newest_data: dict[int, bytes] = {}
        self._turn = self.car.id
        self._t0: float | None = None

    def _initial_phase(self, s: float, stored_stamp: int) -> CrossingPhase:
        """Return the phase at the start of a session."""
        if s - POSE_MARGIN > self.layout.exit[self.route]:
            return CrossingPhase.DONE
        if stored_stamp:
            return CrossingPhase.WANT
        return CrossingPhase.FREE if s <= self.layout.entry[self.route] else CrossingPhase.BACK

    @property
    def phase(self) -> CrossingPhase:
        """Phase of this car."""
        return self.car.phase

    def receive(self, data: bytes, t: float, age: float = 0.0) -> MessageVerdict | MessageFault:
        """Take a datagram received at t [s] of this car's clock, ``age`` s after it was sent.

        Returns the classification of the sender's own message; the relayed one is only counted.
        """
        own, relayed = split_datagram(data)
        verdict = self._take(own, t, age)
        if relayed and isinstance(verdict, MessageVerdict):
            self._take(relayed, t, age, relayed=True)
        return verdict

    def _take(
        self, data: bytes, t: float, age: float, *, relayed: bool = False
    ) -> MessageVerdict | MessageFault:
        """Decode, classify and apply one message."""
        m = decode(data, self.key)
        if isinstance(m, MessageFault):
            self.counts[m.value] += 1
            return m
        verdict = MessageVerdict.STRANGER
        if m.path < len(self.layout.routes):
            self.car, verdict = order.receive(self.car, m, relayed=relayed)
        if verdict is MessageVerdict.TAKEN:
            self._received_t[m.id] = t - age
            self._newest_data[m.id] = data
            self.counts["OLD"] += age > MAX_MESSAGE_AGE
        self.counts[verdict.value] += 1
        return verdict

    def step(self, t: float, s: float, free: float = inf) -> StopLine:
        """Return the stop line at t [s] and s [m] of the path.

        1. Request as soon as possible; finish after the ground.
        2. Nearest line of all cars that precede or have not granted.
        3. A car ahead in the lane may be nearer; free [m]: distance to its centre by the lidar.
        4. GOING if the line does not limit the speed.
        """
        if self._t0 is None:
            self._t0 = t
        self.car = order.advance(self.car, s - POSE_MARGIN)
        reason = self._try_request(t, s)
        if s - POSE_MARGIN > self.layout.exit[self.route] and self.phase in (
            CrossingPhase.WANT,
            CrossingPhase.BACK,
        ):
            self.car = order.finish(self.car)
            self.store_stamp(0)
        answer = self._nearest_line(t, reason)
        if self.phase is CrossingPhase.BACK:
            answer = StopLine(s, CrossingWait.STRANDED, "")
        car_ahead = s + free - self.layout.min_distance
        if car_ahead < answer.line:
            answer = StopLine(car_ahead, CrossingWait.FOLLOWING, "")
        if safe_speed(answer.line - s) >= self.layout.speed:
            answer = StopLine(answer.line, CrossingWait.GOING, "")
        if not self.events or self.events[-1][1:] != answer[1:]:
            self.events.append((t, answer.wait, answer.who))
        return answer

    def next_message(self) -> bytes:
        """Return the next datagram."""
        self.car, m = order.next_message(self.car)
        own = encode(m, self.key)
        return own + (self._next_relayed() if 2 * len(own) <= MAX_DATAGRAM_BYTES else b"")

    def _next_relayed(self) -> bytes:
        """Return the newest message of the next car with a new one, or b""."""
        for _ in self.names:
            self._turn = (self._turn + 1) % len(self.names)
            if self._turn in self._newest_data:
                return self._newest_data.pop(self._turn)
        return b""

    def _try_request(self, t: float, s: float) -> tuple[CrossingWait, int] | None:
        """Request as soon as possible; return why it is not possible yet."""
        if self.phase is not CrossingPhase.FREE:
            return None
        leader = None if self._leader is None else self.car.others[self._leader]
        if self._leader is not None and (leader is None or leader.phase is CrossingPhase.FREE):
            return CrossingWait.FOR_LEADER, self._leader
        if s > self.layout.entry[self.route] - REQUEST_DISTANCE:
            requested = order.request(self.car, round(t * 1e6))
            if requested is not self.car:
                self.store_stamp(requested.ts)
                self.car = requested
                return None
        unknown = order.first_unaware(self.car)
        return None if unknown is None else (CrossingWait.TO_BE_KNOWN, unknown)

    def _nearest_line(self, t: float, reason: tuple[CrossingWait, int] | None) -> StopLine:
        """Return the nearest line of all cars."""
        entry = self.layout.entry[self.route]
        if self.phase in (CrossingPhase.FREE, CrossingPhase.BACK):
            return self._stop_line(t, entry, *(reason or (CrossingWait.FOR_GRANT, self.car.id)))
        line = inf
        wait = CrossingWait.GOING
        who = self.car.id
        for j, other in enumerate(self.car.others):
            if j == self.car.id:
                continue
            precedence = order.precedence(self.car, j)
            if precedence is Precedence.GRANTED or (
                self.phase is CrossingPhase.DONE and precedence is not Precedence.AFTER
            ):
                continue
            if precedence is Precedence.AFTER and other is not None:
                limit = self.layout.line(other.path, other.s_minus, self.route)
                wait_for_j = CrossingWait.FOR_CAR
            else:
                limit = entry
                wait_for_j = CrossingWait.FOR_GRANT
            if limit < line:
                line = limit
                wait = wait_for_j
                who = j
        return self._stop_line(t, line, wait, who)

    def _stop_line(self, t: float, line: float, wait: CrossingWait, who: int) -> StopLine:
        """Return the stop line, with SILENT_CAR if that car sent nothing for long."""
        if who == self.car.id:
            return StopLine(line, wait, "")
        last_t = self._received_t.get(who, self._t0 or 0.0)
        return StopLine(
            line, CrossingWait.SILENT if t - last_t > MAX_SILENCE else wait, self.names[who]
        )
