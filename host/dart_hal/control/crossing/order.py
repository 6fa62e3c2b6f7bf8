"""Who goes before whom: a total order of the cars of a crossing that every car has acknowledged.

    FREE ----> WANT ----> DONE ----> FREE          BACK: restarted among the zones, stamp lost
      takes a stamp   past its last zone            stays, grants nobody

A car that wants to cross takes a stamp above every stamp it has heard, and waits until each other
car is known to be before it (then it keeps behind that car's line) or has granted it this stamp.
i grants j if it wants nothing itself, or if (stamp, id) of j is the smaller one. A grant is a
promise to yield and never expires; there is no time-out. Each message is the sender's whole state:
the next one is retransmission and acknowledgement.

Safe: of two cars that both want, each was granted by the other or knows it to be before. Grants
both ways would need both stamps below each other: the one that granted first, while it wanted
nothing, took a stamp above the one it granted. Live: waits point to smaller (stamp, id), so there
is no ring; the first waits for messages alone.

Each crossing, and each start of the program, is a session (``boot``). A car asks only when every
car has told that it hears this session: whoever may go by the one before, behind this car or by
its grant, has then told its stamp, and the new one is above it. A car that restarts lost what it
heard and granted; amid the zones it goes on under its stamp, which was put on disk before it was
told. Everything here is a value: the model check of the tests runs this code.
"""

from __future__ import annotations

from enum import Enum, IntEnum
from typing import NamedTuple


class Phase(IntEnum):
    """What a car wants."""

    FREE = 0
    WANT = 1
    DONE = 2
    BACK = 3


class Verdict(str, Enum):
    """What became of a message. OLDER: overtaken by a newer one, or come twice; RETIRED: of a
    session that another has followed; UNMET: passed on, of one that this car has not heard itself;
    OWN: of this car; STRANGER: of another roster."""

    TAKEN = "TAKEN"
    OLDER = "OLDER"
    RETIRED = "RETIRED"
    UNMET = "UNMET"
    OWN = "OWN"
    STRANGER = "STRANGER"


class Right(Enum):
    """Of a car against another: never heard; before it, so keep behind its line; it has granted;
    it has not."""

    UNHEARD = "UNHEARD"
    AFTER = "AFTER"
    GRANTED = "GRANTED"
    UNGRANTED = "UNGRANTED"


class Message(NamedTuple):
    """id: place in the roster; boot: of this session; ts: stamp [us], 0 = none; s_minus [m]: it is
    at least so far; grants: the stamp of each car granted last, heard: the session of each heard
    last, (n,) each, 0 = none."""

    id: int
    boot: int
    seq: int
    path: int
    phase: Phase
    ts: int
    s_minus: float
    grants: tuple[int, ...]
    heard: tuple[int, ...]


class Known(NamedTuple):
    """What another car told last. grant: my stamp that it granted, heard: my session, as it told;
    retired: its sessions before."""

    boot: int
    seq: int
    path: int
    phase: Phase
    ts: int
    s_minus: float
    grant: int
    heard: int
    retired: tuple[int, ...] = ()


class Standing(NamedTuple):
    """One car's side of the order. highest: of all stamps heard; others: by roster, None for
    itself and whom it never heard."""

    id: int
    boot: int
    path: int
    phase: Phase
    ts: int
    s_minus: float
    seq: int
    highest: int
    grants: tuple[int, ...]
    others: tuple[Known | None, ...]


# Sessions of a car that are remembered as over.
SESSIONS = 16


def begun(
    id: int, n: int, boot: int, path: int, s_minus: float, phase: Phase = Phase.FREE, ts: int = 0
) -> Standing:
    """Car id of n at the start of a session. It is FREE, but after a restart: behind its last zone
    DONE; WANT with the stamp that it kept; without one, amid the zones, BACK."""
    return Standing(id, boot, path, phase, ts, s_minus, 0, ts, (0,) * n, (None,) * n)


def hear(car: Standing, m: Message, *, passed: bool = False) -> tuple[Standing, Verdict]:
    """What the car knows behind a message.

    passed: by another car. It is as true as one that came late, so it is taken; but it begins no
    session, as it may be of one that is over.
    """
    n = len(car.others)
    if not 0 <= m.id < n or len(m.grants) != n or len(m.heard) != n:
        return car, Verdict.STRANGER
    if m.id == car.id:
        return car, Verdict.OWN
    before = car.others[m.id]
    if passed and (before is None or before.boot != m.boot):
        return car, Verdict.UNMET
    retired: tuple[int, ...] = ()
    if before is not None:
        retired = before.retired
        if m.boot in retired:
            return car, Verdict.RETIRED
        if m.boot == before.boot and m.seq <= before.seq:
            return car, Verdict.OLDER
        if m.boot != before.boot:
            retired = (*retired, before.boot)[-SESSIONS:]
    ts = m.ts
    s_minus = m.s_minus
    grant = m.grants[car.id]
    if before is not None:
        grant = max(grant, before.grant)  # of an earlier session as well: it never expires
        lost_it = m.phase is Phase.BACK and before.phase in (Phase.WANT, Phase.BACK)
        if lost_it and m.path == before.path:
            ts = before.ts
        if ts == before.ts and m.path == before.path:
            s_minus = max(s_minus, before.s_minus)
    known = Known(m.boot, m.seq, m.path, m.phase, ts, s_minus, grant, m.heard[car.id], retired)
    highest = max(car.highest, m.ts, m.grants[car.id])
    others = (*car.others[: m.id], known, *car.others[m.id + 1 :])
    return _granting(car._replace(others=others, highest=highest)), Verdict.TAKEN


def _granting(car: Standing) -> Standing:
    """Grant whom it can: whoever wants, and is before."""
    free = car.phase in (Phase.FREE, Phase.DONE)
    grants = tuple(
        o.ts
        if o is not None
        and o.phase is Phase.WANT
        and (free or (car.phase is Phase.WANT and (o.ts, j) < (car.ts, car.id)))
        else g
        for j, (o, g) in enumerate(zip(car.others, car.grants, strict=True))
    )
    return car._replace(grants=grants)


def tell(car: Standing) -> tuple[Standing, Message]:
    """Its next message."""
    car = car._replace(seq=car.seq + 1)
    heard = tuple(0 if o is None else o.boot for o in car.others)
    return car, Message(
        car.id, car.boot, car.seq, car.path, car.phase, car.ts, car.s_minus, car.grants, heard
    )


def moved(car: Standing, s_minus: float) -> Standing:
    """It is at least so far [m]; never less than before."""
    return car._replace(s_minus=max(car.s_minus, s_minus))


def unknown_to(car: Standing) -> int | None:
    """A car that has not told that it hears this session; None: all have."""
    for j, other in enumerate(car.others):
        if j != car.id and (other is None or other.heard != car.boot):
            return j
    return None


def want(car: Standing, clock: int) -> Standing:
    """Takes a stamp by its clock [us]; the same car where it may not yet."""
    if car.phase is not Phase.FREE or unknown_to(car) is not None:
        return car
    ts = max(clock, car.highest + 1)
    return car._replace(phase=Phase.WANT, ts=ts, highest=ts)


def done(car: Standing) -> Standing:
    """Past its last zone."""
    if car.phase not in (Phase.WANT, Phase.BACK):
        return car
    return _granting(car._replace(phase=Phase.DONE))


def again(car: Standing, boot: int, path: int, s_minus: float) -> Standing:
    """Another crossing, from before the line of another path, in a session of its own: who is
    behind this car in the last one may go without its grant, so its stamp must be heard first."""
    if car.phase is not Phase.DONE:
        return car
    begin = begun(car.id, len(car.others), boot, path, s_minus)
    return _granting(begin._replace(highest=car.highest, grants=car.grants, others=car.others))


def right(car: Standing, j: int) -> Right:
    """Of a car that wants, against another."""
    other = car.others[j]
    if other is None:
        return Right.UNHEARD
    if other.phase is not Phase.FREE and other.ts > 0 and (other.ts, j) < (car.ts, car.id):
        return Right.AFTER
    return Right.GRANTED if other.grant == car.ts > 0 else Right.UNGRANTED
