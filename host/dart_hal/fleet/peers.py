"""The table of the other members of a room, fed with datagrams, with time as an argument.

A session is one run of one program: (name, boot). Its frames count up.

Order. A frame that came before (a copy), or that is more than ``REPLAY_WINDOW`` frames older than
the newest of its session, is dropped and counted. One that was overtaken by less is late: it
informs where nothing newer is known, and never beats.

Liveness. A member repeats the newest frame that it has received from each other member (HEARD). A
receiver that finds the number of its own frame in it knows, by its own clock, a time at which the
sender was still alive: ``Sender.proof``. No recording contains the number of a frame that was
sent after it was made, so a replay never moves this time, whatever clocks the members have and
however often they were restarted.

- A BEAT counts from ``proof``, in every room. Delay on the way makes it older, not younger.
- With a key all other frames count only while ``proof`` is at most ``LATEST`` s old; a STOP also
  later, once its session was proven. Frames of a session that is not proven change nothing, but
  are echoed, so that it is proven with the next frame if it lives.
- Without a key poses, health and stops count without a proof.

Age. The sender says how old its pose was when it left. From then on this car's own clock counts,
whose rate need not be the sender's. How long the frame travelled is given by the lines' clocks, in
excess of the quickest frame of the last 10 s: a delay that all frames have cannot be observed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, NamedTuple

import numpy as np

from dart_hal.core.types import CHANGES, FloatArray, Pose, Tracking
from dart_hal.fleet import messages as m
from dart_hal.fleet.codec import Decoder, Heard
from dart_hal.fleet.key import RoomKey
from dart_hal.fleet.sender import Order, Sender, Session
from dart_hal.fleet.transports import Datagram, Transport

LOST_AFTER = 0.5
"""s, ten poses: beyond, a car is lost."""
MOST = 256
"""Sessions in the table: a flood of names must not fill the memory."""
SENT_KEPT = 512
"""Own frames whose times are remembered: at 100 a second all of the last ``LATEST`` s and more."""
KNOWN = 5.0
"""s within which a session was received that is waited for when all are stopped."""
LATEST = 2.0
"""s that a frame may travel; a session that is heard later than that has not ended."""
UNPROVEN = ("it does not repeat the numbers of this member's frames: it is a recording or an "
            "earlier version, or the network carries frames in one direction only")
"""Why a session that is not proven to be alive is ignored."""
TRACKINGS = tuple(Tracking)


@dataclass(frozen=True, slots=True)
class OtherPlan:
    """Where another car means to be: points (n, 4) of x, y [m], yaw [rad], speed [m/s], ``step``
    s apart; the first was at ``age`` s ago."""

    frame: str
    age: float
    step: float
    points: FloatArray


@dataclass(frozen=True, slots=True)
class OtherHealth:
    """How another car is: mode of its supervisor, frames of its Nano lost, names of doubts;
    held: what keeps it from driving, "" = nothing."""

    mode: str
    lost: int
    doubts: frozenset[str]
    held: str


@dataclass(frozen=True, slots=True)
class OtherPose:
    """The last known pose of another car, as it was ``age`` s ago by this car's clock.

    pose: of its rear axle in ``frame``, with a covariance that has grown by how far it may have
    gone since; speed [m/s], yaw_rate [rad/s]: of then; lost: it is older than 0.5 s.
    """

    name: str
    age: float
    lost: bool
    pose: Pose
    frame: str
    speed: float
    yaw_rate: float
    tracking: Tracking
    plan: OtherPlan | None = None
    health: OtherHealth | None = None


class Coordination(NamedTuple):
    """What another car's law told last: age [s] by this car's clock, session and number of the
    frame, the law's own bytes."""

    age: float
    boot: int
    seq: int
    payload: bytes


class Peers:
    """The table of one member of a room. ``own``: its name; ``boot``: its session, whose frames
    come back; ``key``: of the room.

    ``on_stop`` (number, sender's name, reason), ``on_beat`` (sender's name, time from which it
    counts), ``on_stopped`` (number, session), ``on_health`` (session, mode) are called as frames
    arrive. ``senders``: by name the session that counts; ``sessions``: all of them. ``namesakes``:
    names that two programs use at once. Counts: ``retired``: frames of a session that another has
    displaced; ``unproven``: frames of sessions that are not proven to be alive.
    """

    def __init__(self, own: str, boot: int, key: RoomKey | None = None) -> None:
        self.own, self.boot = own, boot
        self.decoder = Decoder(key)
        self.senders: dict[str, Sender] = {}
        self.sessions: dict[Session, Sender] = {}
        self.namesakes: set[str] = set()
        self.retired = self.unproven = 0
        self.on_stop: Callable[[int, str, str], None] = lambda number, who, why: None
        self.on_stopped: Callable[[int, Session], None] = lambda number, session: None
        self.on_beat: Callable[[str, float], None] = lambda who, since: None
        self.on_health: Callable[[Session, str], None] = lambda session, mode: None
        self._looked = -inf
        self._sent: dict[int, float] = {}
        self._echoed = 0

    def note_sent(self, seq: int, now: float) -> None:
        """An own frame leaves at ``now`` [s] of this car's clock."""
        self._sent[seq] = now
        if len(self._sent) > SENT_KEPT:
            del self._sent[next(iter(self._sent))]

    def echoes(self) -> tuple[tuple[int, int], ...]:
        """(boot, seq) of the newest frame of each session; of more than fit, others each time."""
        newest = [(boot, sender.newest) for (_, boot), sender in self.sessions.items()]
        if len(newest) <= m.POINTS:
            return tuple(newest)
        self._echoed = (self._echoed + m.POINTS) % len(newest)
        return tuple((newest[self._echoed:] + newest)[:m.POINTS])

    def take(self, transport: Transport, now: float) -> None:
        """All that has come until ``now`` [s] of this car's clock, whatever it is.

        Raises OSError where the line cannot be read."""
        came: Sequence[Datagram] = transport.poll(now)
        for data, age, source in came:
            heard = self.decoder.decode(data)
            if heard is None or heard.boot == self.boot:
                continue
            transport.answer(source)
            # Since the last look it has come; a car whose time passes slower than the
            # computer's must not take the computer's seconds for its own.
            arrived = max(now - age, min(self._looked, now))
            self.hear(heard, arrived, transport.stamp(now) - age, source)
        self._looked = now

    def hear(self, heard: Heard, arrived: float, line: float, source: object = None) -> None:
        """A good frame: arrived [s] of this car's clock, line [s] of the line's.

        1. Order: copies and old frames end here.
        2. Proof: its echo of an own frame, if it is a HEARD.
        3. With a key: what is not proven ends here.
        4. What it asks for: a stop, an answer, a beat.
        5. What it informs of.
        """
        keyed = self.decoder.key is not None
        sender = self._sender(heard, arrived, source)
        order = sender.place(heard.seq)
        sender.last = max(sender.last, arrived)
        if order in (Order.COPY, Order.OLD):
            if order is Order.OLD and heard.kind in (m.STOP, m.HEALTH) and not keyed:
                # A forged number may have made the own frames of a session old. They can still
                # stop this car, and show that a car has not obeyed.
                self._act(sender, heard, order)
            return
        if heard.kind is m.HEARD:
            self._prove(sender, heard, arrived)
        if keyed and arrived - sender.proof > LATEST:
            self.unproven += 1
            if heard.kind is m.STOP and sender.proof > -inf:
                self._act(sender, heard, order)
            return
        if heard.name == self.own:
            self.namesakes.add(self.own)
        sender.heard = max(sender.heard, arrived)
        transit = line - heard.sent
        sender.travelled(transit, line)
        self._act(sender, heard, order)
        self._choose(sender, arrived)
        before = sender.told.get(heard.kind.id)
        if before is None or before[2].seq < heard.seq:
            sender.told[heard.kind.id] = (arrived, transit, heard)

    def _sender(self, heard: Heard, arrived: float, source: object) -> Sender:
        """The session of a frame; a new one takes the place of the longest silent of ``MOST``,
        of one without a proof if there is any."""
        session = Session(heard.name, heard.boot)
        found = self.sessions.get(session)
        if found is not None:
            return found
        if len(self.sessions) >= MOST:
            oldest = min(self.sessions.values(), key=lambda s: (s.proof > -inf, s.heard))
            del self.sessions[oldest.session]
            if self.senders.get(oldest.session.name) is oldest:
                del self.senders[oldest.session.name]
        new = Sender(session, arrived, arrived, arrived, source, first=heard.seq)
        self.sessions[session] = new
        return new

    def _prove(self, sender: Sender, heard: Heard, arrived: float) -> None:
        """Note when the newest own frame that a HEARD echoes was sent."""
        for boot, seq in heard.values[1]:
            if boot == self.boot:
                sender.proof = max(sender.proof, min(self._sent.get(seq, -inf), arrived))

    def _choose(self, sender: Sender, arrived: float) -> None:
        """Which session of a name counts: the one that appeared last, until it falls silent while
        an earlier one goes on."""
        name = sender.session.name
        current = self.senders.get(name)
        if current is sender:
            return
        if sender.displaced is not None and current is not None:
            self.retired += 1
            if arrived - sender.displaced > LATEST:
                self.namesakes.add(name)
            if arrived - current.heard <= LOST_AFTER:
                return
        if current is not None:
            current.displaced = arrived
        sender.displaced = None
        self.senders[name] = sender

    def _act(self, sender: Sender, heard: Heard, order: Order) -> None:
        if heard.kind is m.STOP:
            self.on_stop(heard.values[1], heard.name, heard.values[2])
        elif heard.kind is m.STOPPED:
            self.on_stopped(heard.values[1], sender.session)
        elif heard.kind is m.HEALTH:
            self.on_health(sender.session, heard.values[1])
        elif heard.kind is m.BEAT and order is Order.NEWEST:
            self.on_beat(heard.name, sender.proof)

    # -- what is known -------------------------------------------------------------

    def cars(self, now: float) -> set[Session]:
        """Sessions that have told of a pose or a health, received within the last ``KNOWN`` s.

        Two of one name are two: a car that was displaced in the table of names by a frame of
        another session still has to answer. Dropped frames count as well: a forged number that
        makes the own frames of a car old must not hide the car."""
        return {session for session, sender in self.sessions.items()
                if now - sender.last <= KNOWN
                and (m.HEALTH.id in sender.told or m.POSE.id in sender.told)}

    def ignored(self, now: float) -> dict[str, str]:
        """Members whose frames do not count, by the name that they give, and why."""
        found = dict(self.decoder.ignored)
        for session, sender in self.sessions.items():
            matters = self.decoder.key is not None or m.BEAT.id in sender.told
            if matters and now - sender.last < LATEST < now - max(sender.proof, sender.began):
                found.setdefault(session.name, UNPROVEN)
        return found

    def other_poses(self, now: float) -> dict[str, OtherPose]:
        """The last known pose of each other car by name, at ``now`` [s] of this car's clock."""
        return {name: self._pose(name, sender, now)
                for name, sender in sorted(self.senders.items()) if m.POSE.id in sender.told}

    def coordination(self, now: float) -> dict[str, Coordination]:
        """What the law of each other car told last, by name, at ``now`` [s]."""
        return {name: Coordination(sender.age(m.COORDINATION, now), heard.boot, heard.seq,
                                   heard.values[1])
                for name, sender in sorted(self.senders.items()) if m.COORDINATION.id in sender.told
                for heard in (sender.told[m.COORDINATION.id][2],)}

    def _pose(self, name: str, sender: Sender, now: float) -> OtherPose:
        _, said, frame, x, y, yaw, var, cov, speed, yaw_rate, tracking = \
            sender.told[m.POSE.id][2].values
        age = said + sender.age(m.POSE, now)
        return OtherPose(name, age, age > LOST_AFTER,
                         Pose(x, y, yaw, grown(var, cov, speed, yaw_rate, age)), frame, speed,
                         yaw_rate, TRACKINGS[tracking], self._plan(sender, now),
                         self.health(sender))

    def _plan(self, sender: Sender, now: float) -> OtherPlan | None:
        if m.PLAN.id not in sender.told:
            return None
        _, said, frame, step, points = sender.told[m.PLAN.id][2].values
        rows = np.array(points).reshape(-1, 4)
        rows.setflags(write=False)
        return OtherPlan(frame, said + sender.age(m.PLAN, now), step, rows)

    def health(self, sender: Sender) -> OtherHealth | None:
        """What a sender said of itself last."""
        if m.HEALTH.id not in sender.told:
            return None
        _, mode, lost, doubts, held = sender.told[m.HEALTH.id][2].values
        return OtherHealth(mode, lost, frozenset(doubts.split()), held)



def grown(var: Sequence[float], cov: Sequence[float], speed: float, yaw_rate: float,
          age: float) -> FloatArray:
    """Covariance (3, 3) of a pose ``age`` s later, where nobody says which way it went.

    One sigma more: the whole way at the last speed, and what a change of it by ``CHANGES`` adds;
    of the yaw likewise.
    """
    (xx, yy, tt), (xy, xt, yt) = var, cov
    way = abs(speed) * age + 0.5 * CHANGES[0] * age**2
    turn = abs(yaw_rate) * age + 0.5 * CHANGES[1] * age**2
    out = np.array(((xx + way**2, xy, xt), (xy, yy + way**2, yt), (xt, yt, tt + turn**2)))
    out.setflags(write=False)
    return out


def values_of_pose(name: str, age: float, frame: str, pose: Pose, speed: float, yaw_rate: float,
                   tracking: Tracking) -> tuple[Any, ...]:
    """The values of a POSE."""
    c = pose.cov
    return (name, max(age, 0.0), frame, pose.x, pose.y, pose.yaw,
            (c[0, 0], c[1, 1], c[2, 2]), (c[0, 1], c[0, 2], c[1, 2]), speed, yaw_rate,
            TRACKINGS.index(tracking))
