"""Table of the other members of a room, updated by datagrams; time is an argument.

A session is one run of one program: (name, boot). Its frames count up.

**Order.** A frame that was received before (a copy), or that is at least ``REPLAY_WINDOW`` frames
older than the newest of its session, is dropped and counted. One that was overtaken by less is
late: it is used where nothing newer is known, but never as a beat.

**Liveness.** A member repeats the number of the newest frame of each other member (HEARD). A
receiver that finds the number of its own frame in it knows, by its own clock, a time at which the
sender was still alive: ``Sender.proof``. No recording contains the number of a frame that was
sent later, so a replay never changes this time. It does not depend on the clocks of the members, or
on how often they were restarted.

- A BEAT counts from ``proof``, in every room. Transmission delay makes it older, not younger.
- With a key all other frames are used only while ``proof`` is at most ``MAX_TRANSIT`` s old; a
  STOP also later, once its session was proven. Frames of an unproven session change nothing, but
  are echoed, so that its next frame proves it if it is alive.
- Without a key poses, health and stops are used without a proof.

**Age.** The sender reports the age of its pose at transmission. From then on the clock of this car
is used, whose rate may differ. The transit is measured by the clocks of the transports, in excess
of the fastest frame of the last 10 s: a delay common to all frames cannot be observed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, NamedTuple

import numpy as np

from dart_hal.core.types import ACCELERATION_STDS, FloatArray, Pose, Tracking
from dart_hal.fleet import messages as m
from dart_hal.fleet.codec import Decoder, ReceivedFrame
from dart_hal.fleet.key import RoomKey
from dart_hal.fleet.sender import Order, Sender, Session
from dart_hal.fleet.transports import Datagram, Transport

# s, ten poses, after which a car is lost.
LOST_AFTER = 0.5
# Sessions in the table, so that a flood of names cannot fill the memory.
MAX_SESSIONS = 256
# Stored send times of own frames: at 100 a second more than the last ``MAX_TRANSIT`` s.
MAX_SENT_TIMES = 512
# s since its last frame for which an answer of a session to a stop is required.
SESSION_MEMORY = 5.0
# s of transit of a frame; a session that was received later has not ended.
MAX_TRANSIT = 2.0
# Reason for ignoring a session that is not proven to be alive.
UNPROVEN_REASON = (
    "it does not repeat the numbers of this member's frames: it is a recording or an "
    "earlier version, or the network carries frames in one direction only")
# s after which a voltage is unknown: as that of the own car.
MAX_BATTERY_AGE = 1.0
TRACKINGS = tuple(Tracking)


@dataclass(frozen=True, slots=True)
class OtherPlan:
    """Planned path of another car.

    points (n, 4) of x, y [m], yaw [rad], speed [m/s], one each ``step`` s; the first is for
    ``age`` s ago.
    """

    frame: str
    age: float
    step: float
    points: FloatArray


@dataclass(frozen=True, slots=True)
class OtherHealth:
    """State of another car.

    mode of its supervisor, lost frames of its Nano, names of doubts; held: reason why it may not
    drive, "" if it may; battery [V]: voltage of its battery, None without a reading.
    """

    mode: str
    lost: int
    doubts: frozenset[str]
    held: str
    battery: float | None = None


@dataclass(frozen=True, slots=True)
class OtherPose:
    """Last known pose of another car, ``age`` s ago by the clock of this car.

    pose: of its rear axle in ``frame``; the covariance includes its possible motion since;
    speed [m/s], yaw_rate [rad/s]: at that time; lost: it is older than 0.5 s.
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
    """Newest message of the control law of another car.

    age [s] by the clock of this car, session and number of the frame, content.
    """

    age: float
    boot: int
    seq: int
    payload: bytes


class Peers:
    """Table of the other members. ``own``: name of this one; ``boot``: its session; ``key``.

    ``on_stop`` (number, name of the sender, reason), ``on_beat`` (name of the sender, time from
    which it counts), ``on_stopped`` (number, session), ``on_health`` (session, mode) are called for
    each frame. ``senders``: the current session of each name; ``sessions``: all of them.
    ``namesakes``: names that two programs use at once. Counts: ``retired``: frames of a session
    that was displaced by another; ``unproven``: frames of sessions not proven to be alive.
    """

    def __init__(self, own: str, boot: int, key: RoomKey | None = None) -> None:
        self.own = own
        self.boot = boot
        self.decoder = Decoder(key)
        self.senders: dict[str, Sender] = {}
        self.sessions: dict[Session, Sender] = {}
        self.namesakes: set[str] = set()
        self.retired = self.unproven = 0
        self.on_stop: Callable[[int, str, str], None] = lambda number, who, why: None
        self.on_stopped: Callable[[int, Session], None] = lambda number, session: None
        self.on_beat: Callable[[str, float], None] = lambda who, since: None
        self.on_health: Callable[[Session, str], None] = lambda session, mode: None
        self._last_poll = -inf
        self._send_times: dict[int, float] = {}
        self._first_echo = 0

    def note_sent(self, seq: int, now: float) -> None:
        """Store that an own frame is sent at ``now`` [s] of the clock of this car."""
        self._send_times[seq] = now
        if len(self._send_times) > MAX_SENT_TIMES:
            del self._send_times[next(iter(self._send_times))]

    def echoes(self) -> tuple[tuple[int, int], ...]:
        """Return (boot, seq) of the newest frame of each session, in turn if there are too many."""
        newest = [(boot, sender.newest) for (_, boot), sender in self.sessions.items()]
        if len(newest) <= m.MAX_ROWS:
            return tuple(newest)
        self._first_echo = (self._first_echo + m.MAX_ROWS) % len(newest)
        return tuple((newest[self._first_echo:] + newest)[:m.MAX_ROWS])

    def receive(self, transport: Transport, now: float) -> None:
        """Process all received datagrams until ``now`` [s] of the clock of this car.

        Raises OSError if the transport cannot be read.
        """
        datagrams: Sequence[Datagram] = transport.poll(now)
        for data, age, source in datagrams:
            heard = self.decoder.decode(data)
            if heard is None or heard.boot == self.boot:
                continue
            transport.answer(source)
            # It arrived after the last poll. This bounds its age if the time of the car passes
            # more slowly than that of the computer.
            arrived = max(now - age, min(self._last_poll, now))
            self.process(heard, arrived, transport.stamp(now) - age, source)
        self._last_poll = now

    def process(self, heard: ReceivedFrame, arrived: float, line: float,
                source: object = None) -> None:
        """Process a valid frame: arrived [s] by the clock of this car, line [s] of the transport.

        1. Order: copies and old frames end here.
        2. Proof: its echo of an own frame, if it is a HEARD.
        3. With a key: unproven frames end here.
        4. Requests: a stop, an answer, a beat.
        5. Information: stored if newer than before.
        """
        keyed = self.decoder.key is not None
        sender = self._sender(heard, arrived, source)
        order = sender.classify(heard.seq)
        sender.last = max(sender.last, arrived)
        if order in (Order.COPY, Order.OLD):
            if order is Order.OLD and heard.kind in (m.STOP, m.HEALTH) and not keyed:
                # A forged number may have made the own frames of a session old. They can still
                # stop this car, and show that a car has not obeyed.
                self._notify(sender, heard, order)
            return
        if heard.kind is m.HEARD:
            self._prove(sender, heard, arrived)
        if keyed and arrived - sender.proof > MAX_TRANSIT:
            self.unproven += 1
            if heard.kind is m.STOP and sender.proof > -inf:
                self._notify(sender, heard, order)
            return
        if heard.name == self.own:
            self.namesakes.add(self.own)
        sender.heard = max(sender.heard, arrived)
        transit = line - heard.sent
        sender.add_transit(transit, line)
        self._notify(sender, heard, order)
        self._choose_session(sender, arrived)
        before = sender.newest_frames.get(heard.kind.id)
        if before is None or before[2].seq < heard.seq:
            sender.newest_frames[heard.kind.id] = (arrived, transit, heard)

    def _sender(self, heard: ReceivedFrame, arrived: float, source: object) -> Sender:
        """Return the session of a frame.

        A new one replaces the longest silent of ``MAX_SESSIONS``, an unproven one if there is any.
        """
        session = Session(heard.name, heard.boot)
        found = self.sessions.get(session)
        if found is not None:
            return found
        if len(self.sessions) >= MAX_SESSIONS:
            oldest = min(self.sessions.values(), key=lambda s: (s.proof > -inf, s.heard))
            del self.sessions[oldest.session]
            if self.senders.get(oldest.session.name) is oldest:
                del self.senders[oldest.session.name]
        new = Sender(session, arrived, arrived, arrived, source, first=heard.seq)
        self.sessions[session] = new
        return new

    def _prove(self, sender: Sender, heard: ReceivedFrame, arrived: float) -> None:
        """Store the send time of the newest own frame that a HEARD echoes."""
        for boot, seq in heard.values[1]:
            if boot == self.boot:
                sender.proof = max(sender.proof, min(self._send_times.get(seq, -inf), arrived))

    def _choose_session(self, sender: Sender, arrived: float) -> None:
        """Choose the current session of a name.

        It is the one that appeared last, until it is silent while an earlier one goes on.
        """
        name = sender.session.name
        current = self.senders.get(name)
        if current is sender:
            return
        if sender.displaced is not None and current is not None:
            self.retired += 1
            if arrived - sender.displaced > MAX_TRANSIT:
                self.namesakes.add(name)
            if arrived - current.heard <= LOST_AFTER:
                return
        if current is not None:
            current.displaced = arrived
        sender.displaced = None
        self.senders[name] = sender

    def _notify(self, sender: Sender, heard: ReceivedFrame, order: Order) -> None:
        """Call the callback of a stop, an answer, a health or a beat."""
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
        """Return the sessions with a pose or health, received within ``SESSION_MEMORY`` s.

        Two of one name count twice: a car that was displaced in the table of names by a frame of
        another session must still answer. Dropped frames count as well: a forged number that makes
        the own frames of a car old must not hide the car.
        """
        return {session for session, sender in self.sessions.items()
                if now - sender.last <= SESSION_MEMORY
                and (m.HEALTH.id in sender.newest_frames or m.POSE.id in sender.newest_frames)}

    def list_ignored(self, now: float) -> dict[str, str]:
        """Return the names of members whose frames are not used, with the reason."""
        found = dict(self.decoder.ignored)
        for session, sender in self.sessions.items():
            matters = self.decoder.key is not None or m.BEAT.id in sender.newest_frames
            if matters and now - sender.last < MAX_TRANSIT < now - max(sender.proof, sender.began):
                found.setdefault(session.name, UNPROVEN_REASON)
        return found

    def other_poses(self, now: float) -> dict[str, OtherPose]:
        """Last known pose of each other car by name, at ``now`` [s] of the clock of this car."""
        return {name: self._other_pose(name, sender, now)
                for name, sender in sorted(self.senders.items())
                if m.POSE.id in sender.newest_frames}

    def coordination(self, now: float) -> dict[str, Coordination]:
        """Newest message of the control law of each other car, by name, at ``now`` [s]."""
        return {name: Coordination(sender.age(m.COORDINATION, now), heard.boot, heard.seq,
                                   heard.values[1])
                for name, sender in sorted(self.senders.items())
                if m.COORDINATION.id in sender.newest_frames
                for heard in (sender.newest_frames[m.COORDINATION.id][2],)}

    def _other_pose(self, name: str, sender: Sender, now: float) -> OtherPose:
        _, age_at_sending, frame, x, y, yaw, var, cov, speed, yaw_rate, tracking = \
            sender.newest_frames[m.POSE.id][2].values
        age = age_at_sending + sender.age(m.POSE, now)
        predicted = Pose(x, y, yaw, grow_covariance(var, cov, speed, yaw_rate, age))
        return OtherPose(name, age, age > LOST_AFTER, predicted, frame, speed, yaw_rate,
                         TRACKINGS[tracking], self._other_plan(sender, now),
                         self.health(sender, now))

    def _other_plan(self, sender: Sender, now: float) -> OtherPlan | None:
        if m.PLAN.id not in sender.newest_frames:
            return None
        _, age_at_sending, frame, step, points = sender.newest_frames[m.PLAN.id][2].values
        rows = np.array(points).reshape(-1, 4)
        rows.setflags(write=False)
        return OtherPlan(frame, age_at_sending + sender.age(m.PLAN, now), step, rows)

    def health(self, sender: Sender, now: float) -> OtherHealth | None:
        """Newest health of a sender at ``now`` [s], or None."""
        if m.HEALTH.id not in sender.newest_frames:
            return None
        _, mode, lost, doubts, held = sender.newest_frames[m.HEALTH.id][2].values
        battery = None
        if m.BATTERY.id in sender.newest_frames and sender.age(m.BATTERY, now) < MAX_BATTERY_AGE:
            battery = sender.newest_frames[m.BATTERY.id][2].values[1]
        return OtherHealth(mode, lost, frozenset(doubts.split()), held, battery)


def grow_covariance(var: Sequence[float], cov: Sequence[float], speed: float, yaw_rate: float,
                    age: float) -> FloatArray:
    """Covariance (3, 3) of a pose ``age`` s later, if the motion is unknown.

    Additional standard deviation: the whole distance at the last speed, and that of a change of it
    by ``ACCELERATION_STDS``; for the yaw likewise.
    """
    (xx, yy, tt) = var
    (xy, xt, yt) = cov
    distance = abs(speed) * age + 0.5 * ACCELERATION_STDS[0] * age**2
    turn = abs(yaw_rate) * age + 0.5 * ACCELERATION_STDS[1] * age**2
    out = np.array(((xx + distance**2, xy, xt), (xy, yy + distance**2, yt), (xt, yt, tt + turn**2)))
    out.setflags(write=False)
    return out


def pose_values(name: str, age: float, frame: str, pose: Pose, speed: float, yaw_rate: float,
                tracking: Tracking) -> tuple[Any, ...]:
    """Return the values of a POSE message."""
    c = pose.cov
    return (name, max(age, 0.0), frame, pose.x, pose.y, pose.yaw,
            (c[0, 0], c[1, 1], c[2, 2]), (c[0, 1], c[0, 2], c[1, 2]), speed, yaw_rate,
            TRACKINGS.index(tracking))
