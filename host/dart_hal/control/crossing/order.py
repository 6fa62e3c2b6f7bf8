"""Order of the cars of a crossing: a total order that every car has acknowledged.

    FREE ----> WANT ----> DONE ----> FREE          BACK: restarted among the zones, stamp lost
      takes a stamp   past its last zone            stays, grants nothing

A car that requests to cross takes a stamp above every stamp that it has received. It waits until
each other car is known to precede it (then it stays behind that car's line) or has granted this
stamp. Car i grants car j if i has no request, or if (stamp, id) of j is smaller. A grant is a
promise to yield and never expires; there is no time-out. Each message contains the whole state of
its sender, so the next one is retransmission and acknowledgement.

Safety: of two cars with requests, each was granted by the other or knows that the other precedes
it. Mutual grants would need both stamps below each other: the car that granted first, while it had
no request, took a stamp above the one that it granted. Liveness: waits point to a smaller
(stamp, id), so there is no cycle; the first car only waits for messages.

Each crossing, and each start of the program, is a session (``boot``). A car requests only when
every car has reported that it receives this session: a car that may still use the previous session,
behind this car or by its grant, has then reported its stamp, and the new stamp is above it. A car
that restarts has lost what it received and granted; within the zones it continues with its stamp,
which was stored on disk before it was sent. Everything here is a value: the model checker of the
tests runs this code.
"""

from __future__ import annotations

from enum import Enum, IntEnum
from typing import NamedTuple


class CrossingPhase(IntEnum):
    """Phase of a car in a crossing."""

    FREE = 0
    WANT = 1
    DONE = 2
    BACK = 3


class MessageVerdict(str, Enum):
    """Classification of a message.

    OLDER: overtaken by a newer one, or a duplicate; RETIRED: of a session that was replaced;
    UNMET: relayed, of a session that this car has not received directly; OWN: of this car;
    STRANGER: of another roster.
    """

    TAKEN = "TAKEN"
    OLDER = "OLDER"
    RETIRED = "RETIRED"
    UNMET = "UNMET"
    OWN = "OWN"
    STRANGER = "STRANGER"


class Precedence(Enum):
    """Precedence of a car relative to another one.

    UNHEARD: nothing was received from the other car; AFTER: the other car precedes, stay behind its
    line; GRANTED: it has granted this stamp; UNGRANTED: it has not.
    """

    UNHEARD = "UNHEARD"
    AFTER = "AFTER"
    GRANTED = "GRANTED"
    UNGRANTED = "UNGRANTED"


class OrderMessage(NamedTuple):
    """State of a car.

    id: number in the roster; boot: of this session; ts: stamp [us], 0 = none; s_minus [m]: lower
    bound of its arc length; grants: for each car its stamp that was granted last; heard: for each
    car its session that was received last, (n,) each, 0 = none.
    """

    id: int
    boot: int
    seq: int
    path: int
    phase: CrossingPhase
    ts: int
    s_minus: float
    grants: tuple[int, ...]
    heard: tuple[int, ...]


class OtherCar(NamedTuple):
    """Last report of another car.

    grant: stamp of this car that it granted; heard: session of this car that it reports;
    retired: its previous sessions.
    """

    boot: int
    seq: int
    path: int
    phase: CrossingPhase
    ts: int
    s_minus: float
    grant: int
    heard: int
    retired: tuple[int, ...] = ()


class CarOrder(NamedTuple):
    """State of one car in the protocol.

    highest: of all received stamps; others: by roster, None for itself and for cars without a
    message.
    """

    id: int
    boot: int
    path: int
    phase: CrossingPhase
    ts: int
    s_minus: float
    seq: int
    highest: int
    grants: tuple[int, ...]
    others: tuple[OtherCar | None, ...]


# Number of ended sessions of a car that are stored.
MAX_RETIRED_SESSIONS = 16


def start_session(
    id: int,
    n: int,
    boot: int,
    path: int,
    s_minus: float,
    phase: CrossingPhase = CrossingPhase.FREE,
    ts: int = 0,
) -> CarOrder:
    """Return the state of car id of n at the start of a session.

    It is FREE, except after a restart: DONE after its last zone; WANT with the stored stamp; BACK
    among the zones without one.
    """
    return CarOrder(id, boot, path, phase, ts, s_minus, 0, ts, (0,) * n, (None,) * n)


def receive(
    car: CarOrder, m: OrderMessage, *, relayed: bool = False
) -> tuple[CarOrder, MessageVerdict]:
    """Return the state after a message, and the message's classification.

    relayed: by another car. Its content is as true as a delayed message, so it is accepted; but it
    starts no session, as its session may be over.
    """
    n = len(car.others)
    if not 0 <= m.id < n or len(m.grants) != n or len(m.heard) != n:
        return car, MessageVerdict.STRANGER
    if m.id == car.id:
        return car, MessageVerdict.OWN
    last = car.others[m.id]
    if relayed and (last is None or last.boot != m.boot):
        return car, MessageVerdict.UNMET
    retired: tuple[int, ...] = ()
    if last is not None:
        retired = last.retired
        if m.boot in retired:
            return car, MessageVerdict.RETIRED
        if m.boot == last.boot and m.seq <= last.seq:
            return car, MessageVerdict.OLDER
        if m.boot != last.boot:
            retired = (*retired, last.boot)[-MAX_RETIRED_SESSIONS:]
    ts = m.ts
    s_minus = m.s_minus
    grant = m.grants[car.id]
    if last is not None:
        grant = max(grant, last.grant)  # of an earlier session too: a grant never expires
        has_lost_stamp = m.phase is CrossingPhase.BACK and last.phase in (
            CrossingPhase.WANT,
            CrossingPhase.BACK,
        )
        if has_lost_stamp and m.path == last.path:
            ts = last.ts
        if ts == last.ts and m.path == last.path:
            s_minus = max(s_minus, last.s_minus)
    known = OtherCar(m.boot, m.seq, m.path, m.phase, ts, s_minus, grant, m.heard[car.id], retired)
    highest = max(car.highest, m.ts, m.grants[car.id])
    others = (*car.others[: m.id], known, *car.others[m.id + 1 :])
    return _grant(car._replace(others=others, highest=highest)), MessageVerdict.TAKEN


def _grant(car: CarOrder) -> CarOrder:
    """Grant all requests that precede this car."""
    needs_nothing = car.phase in (CrossingPhase.FREE, CrossingPhase.DONE)
    # A request is granted if this car has none, or if (stamp, id) of the other is smaller.
    grants = tuple(
        o.ts
        if o is not None
        and o.phase is CrossingPhase.WANT
        and (needs_nothing or (car.phase is CrossingPhase.WANT and (o.ts, j) < (car.ts, car.id)))
        else g
        for j, (o, g) in enumerate(zip(car.others, car.grants, strict=True))
    )
    return car._replace(grants=grants)


def next_message(car: CarOrder) -> tuple[CarOrder, OrderMessage]:
    """Return the next message."""
    car = car._replace(seq=car.seq + 1)
    heard = tuple(0 if o is None else o.boot for o in car.others)
    return car, OrderMessage(
        car.id, car.boot, car.seq, car.path, car.phase, car.ts, car.s_minus, car.grants, heard
    )


def advance(car: CarOrder, s_minus: float) -> CarOrder:
    """Raise the lower bound of the arc length to s_minus [m]."""
    return car._replace(s_minus=max(car.s_minus, s_minus))


def first_unaware(car: CarOrder) -> int | None:
    """Return a car that has not reported this session; None: all have."""
    for j, other in enumerate(car.others):
        if j != car.id and (other is None or other.heard != car.boot):
            return j
    return None


def request(car: CarOrder, clock: int) -> CarOrder:
    """Take a stamp by the clock [us]; unchanged if it may not yet."""
    if car.phase is not CrossingPhase.FREE or first_unaware(car) is not None:
        return car
    ts = max(clock, car.highest + 1)
    return car._replace(phase=CrossingPhase.WANT, ts=ts, highest=ts)


def finish(car: CarOrder) -> CarOrder:
    """Finish: the car is past its last zone."""
    if car.phase not in (CrossingPhase.WANT, CrossingPhase.BACK):
        return car
    return _grant(car._replace(phase=CrossingPhase.DONE))


def restart_session(car: CarOrder, boot: int, path: int, s_minus: float) -> CarOrder:
    """Start another crossing, before the line of another path, in a session of its own.

    A car behind this one in the last session may cross without its grant, so its stamp must be
    received first.
    """
    if car.phase is not CrossingPhase.DONE:
        return car
    begin = start_session(car.id, len(car.others), boot, path, s_minus)
    return _grant(begin._replace(highest=car.highest, grants=car.grants, others=car.others))


def precedence(car: CarOrder, j: int) -> Precedence:
    """Return the precedence of a car with a request relative to another one."""
    other = car.others[j]
    if other is None:
        return Precedence.UNHEARD
    if other.phase is not CrossingPhase.FREE and other.ts > 0 and (other.ts, j) < (car.ts, car.id):
        return Precedence.AFTER
    return Precedence.GRANTED if other.grant == car.ts > 0 else Precedence.UNGRANTED


# Name of version 0.1.
Phase = CrossingPhase
