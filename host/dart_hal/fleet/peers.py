"""What the others of a room told last: one table, fed with datagrams, with time as an argument.

Every frame carries the number of its sender's session (boot) and counts up. A frame that was
overtaken by a newer one, that came twice, or that belongs to a session that another has followed
changes nothing and is counted.

Age. The sender says how old its pose was when it left. From then on this car's own clock counts,
whose rate need not be the sender's. How long the frame travelled is told by the lines' clocks, in
excess of the quickest frame of the last 10 s: a delay that all frames have cannot be seen.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any, NamedTuple

import numpy as np

from dart_hal.fleet import messages as m
from dart_hal.fleet.codec import Decoder, Heard
from dart_hal.fleet.transports import Datagram, Transport
from dart_hal.types import CHANGES, FloatArray, Pose, Tracking

LOST_AFTER = 0.5
"""s, ten poses: beyond, a car is lost."""
MOST = 256
"""Cars in the table: a flood of names must not fill the memory."""
WINDOW = 10.0
"""s over which the quickest frame is looked for: two quartzes part by 1 ms in it at the most."""
SESSIONS = 16
"""Sessions of a car that are remembered as over."""
LATEST = 2.0
"""s that a frame may travel; a session that is heard later than that has not ended."""
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


@dataclass
class Sender:
    """Who sends, in this session. ``heard``: own car's time of the last frame; ``told``: of each
    kind when the newest frame arrived, what it took, and the frame; ``retired``: earlier sessions
    and when they were followed. Counts: frames taken, late (overtaken), twice (came again)."""

    boot: int
    heard: float
    source: object = None
    newest: int = -1
    first: int = 0
    taken: int = 0
    late: int = 0
    twice: int = 0
    told: dict[int, tuple[float, float, Heard]] = field(default_factory=dict)
    retired: dict[int, float] = field(default_factory=dict)
    recent: deque[int] = field(default_factory=lambda: deque(maxlen=64))
    transits: deque[tuple[float, float]] = field(default_factory=deque)

    @property
    def lost(self) -> int:
        """Frames of this session that have not come, or not yet."""
        return self.newest - self.first + 1 - self.taken if self.taken else 0

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


class Peers:
    """The table of one car of a room. ``own``: its name and session, whose frames come back.

    ``on_stop`` (number, who, why), ``on_beat``, ``on_stopped`` (number, who) are called as they
    come. ``namesakes``: names that two programs use at once.
    """

    def __init__(self, own: str, boot: int) -> None:
        self.own, self.boot = own, boot
        self.decoder = Decoder()
        self.senders: dict[str, Sender] = {}
        self.namesakes: set[str] = set()
        self.retired = 0
        self.on_stop: Callable[[int, str, str], None] = lambda number, who, why: None
        self.on_stopped: Callable[[int, str], None] = lambda number, who: None
        self.on_beat: Callable[[str], None] = lambda who: None
        self._looked = -inf

    def take(self, transport: Transport, now: float) -> None:
        """All that has come until ``now`` [s] of this car's clock, whatever it is.

        Raises OSError where the line cannot be read."""
        came: Sequence[Datagram] = transport.poll(now)
        for data, age, source in came:
            heard = self.decoder.decode(data)
            if heard is None or heard.boot == self.boot:
                continue
            if heard.name == self.own:
                self.namesakes.add(self.own)
            transport.answer(source)
            # Since the last look it has come; a car whose time passes slower than the
            # computer's must not take the computer's seconds for its own.
            arrived = max(now - age, min(self._looked, now))
            self.hear(heard, arrived, transport.stamp(now) - age, source)
        self._looked = now

    def hear(self, heard: Heard, arrived: float, line: float, source: object = None) -> None:
        """A good frame: arrived [s] of this car's clock, line [s] of the line's."""
        sender = self._sender(heard, arrived, source)
        if sender is None:
            return
        sender.heard = max(sender.heard, arrived)
        transit = line - heard.sent
        sender.travelled(transit, line)
        if heard.seq > sender.newest:
            sender.newest = heard.seq
        elif heard.seq in sender.recent:
            sender.twice += 1
            return
        else:
            sender.late += 1
            sender.first = min(sender.first, heard.seq)
        sender.recent.append(heard.seq)
        sender.taken += 1
        self._note(sender, heard, arrived, transit)

    def _sender(self, heard: Heard, arrived: float, source: object) -> Sender | None:
        """Of the session that counts; None for one that was followed by another."""
        name, found = heard.name, self.senders.get(heard.name)
        if found is not None and heard.boot == found.boot:
            return found
        if found is not None and heard.boot in found.retired:
            self.retired += 1
            if arrived - found.retired[heard.boot] > LATEST:
                self.namesakes.add(name)
            self._act(heard)  # an old program may not move the car in the table, but may stop us
            return None
        if found is None and len(self.senders) >= MOST:
            del self.senders[min(self.senders, key=lambda n: self.senders[n].heard)]
        new = Sender(heard.boot, arrived, source, first=heard.seq)
        if found is not None:
            sessions = {**found.retired, found.boot: arrived}
            new.retired = dict(list(sessions.items())[-SESSIONS:])
        self.senders[name] = new
        return new

    def _note(self, sender: Sender, heard: Heard, arrived: float, transit: float) -> None:
        self._act(heard)
        before = sender.told.get(heard.kind.id)
        if before is None or before[2].seq < heard.seq:
            sender.told[heard.kind.id] = (arrived, transit, heard)

    def _act(self, heard: Heard) -> None:
        if heard.kind is m.STOP:
            self.on_stop(heard.values[1], heard.name, heard.values[2])
        elif heard.kind is m.STOPPED:
            self.on_stopped(heard.values[1], heard.name)
        elif heard.kind is m.BEAT:
            self.on_beat(heard.name)

    # -- what is known -------------------------------------------------------------

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
