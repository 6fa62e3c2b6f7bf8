"""One car of the team: from its motion and what the others told to steering and speed.

    place -> X on the curve -> theta' = Omega + k sum sin(theta_i - theta_j)   (kuramoto)
          -> v = |dr/dX| X', within the bends and the car's limits             (follow)
          -> 0 where another car may be in the way, or one is silent           (guard)

A place tells X; with alpha = 1, which a formation of cars needs, X is the phase.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from enum import Enum
from math import hypot, inf, pi

import numpy as np

from dart_hal.control.ending import Phase
from dart_hal.control.follow import Command, Follower, Rules
from dart_hal.control.lap import CRAWL
from dart_hal.control.monitoring.course import Course
from dart_hal.control.monitoring.drivable import check_drivable, check_rate, fastest_rate
from dart_hal.control.monitoring.formation import Formation
from dart_hal.control.monitoring.guard import Guard, reachable
from dart_hal.control.monitoring.kuramoto import repulsion
from dart_hal.control.monitoring.peer import POINTS, STEP, Peer, Told, Touch, apart
from dart_hal.control.plant import Plant
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray, MotionEstimate

# rad of a neighbour's phase from its slot: 4 % of the way from one robot to the next of five.
IN_STEP = 0.2

# Times the rate of the formation, which no car of the team falls below (none stands in another's
# way for the sake of its phase) or exceeds (by that the others reckon). The law is still a
# descent: what is cut keeps its sign.
LINGER = 0.3
HURRY = 2.0


class Mode(str, Enum):
    """What a car of the team does.

    WAITING: it does not know its place; SPREADING: the phases are not even yet; MONITORING;
    EXTRAPOLATING: one of its neighbours was not heard for 0.5 s; YIELDING: it stands for a car that
    may be in its way; ALONE: a car of the team is silent, and nobody knows where it is; ENDED.
    """

    WAITING = "WAITING"
    SPREADING = "SPREADING"
    MONITORING = "MONITORING"
    EXTRAPOLATING = "EXTRAPOLATING"
    YIELDING = "YIELDING"
    ALONE = "ALONE"
    ENDED = "ENDED"

    def __str__(self) -> str:
        return self.value


MODES = {Phase.WAITING: Mode.WAITING, Phase.STOPPING: Mode.ENDED, Phase.ENDED: Mode.ENDED}


class Monitor:
    """Robot ``own`` of a formation. ``answer`` once per State, ``plan`` whenever it is told.

    names: of all cars, in the order of the ring. omega, k [rad/s]: rate of the formation and
    coupling. guard: False is for tests, it then drives as if it were alone. ``mode``, ``why`` (of
    whom it waits), ``answers`` (answers in each mode), ``follower`` (the drive, its end and its
    record).
    """

    def __init__(self, formation: Formation, names: Sequence[str], own: str, plant: Plant,
                 omega: float, k: float, *, duration: float = inf, tracker: str = "lqr",
                 guard: bool = True) -> None:
        """Raises UsageError for a curve, a rate or a team that this car cannot drive in."""
        _check_team(formation, names, own)
        check_drivable(formation.curve, plant)
        self.formation = formation
        self.course = Course(formation.curve)
        self.follower = Follower(self.course.path, plant, tracker=tracker,
                                 rules=Rules(laps=inf, duration=duration))
        self.omega = omega
        self.k = k
        plant.gains.at(0.0)  # made here: that takes a second, in which no car may drive
        fastest = fastest_rate(self.course, self.follower.profile)
        check_rate(omega, fastest)
        self.fastest = min(fastest, HURRY * omega)
        self.peers = {name: Peer(self.course) for name in names if name != own}
        self.names = tuple(names)
        self._at = names.index(own)
        self._ring = tuple(names[(self._at + d) % len(names)] for d in (-1, 1))
        self._guard = Guard(self.course) if guard else None
        curve = formation.curve
        self._top = hypot(curve.A * curve.a, curve.B * curve.b)
        """m/rad; |dr/dX| is nowhere larger."""
        self.mode = Mode.WAITING
        self.why = ""
        self.answers = Counter[Mode]()
        self.X = self.rate = self._moves = 0.0

    def answer(self, motion: MotionEstimate, told: Mapping[str, Told] | None = None) -> Command:
        """What to command at ``motion.t``; told: of the others, what came by now.

        Raises UsageError for a start that is too far from the curve.
        """
        now = motion.t
        for name, message in (told or {}).items():
            if name in self.peers:
                self.peers[name].hear(message, now)
        self.follower.cap = self._cap(motion)
        command = self.follower.answer(motion)
        if self.follower.phase in MODES:
            self.mode = MODES[self.follower.phase]
            self.rate = 0.0
        self.X = self.course.parameter(self.follower.tracker.s)
        self.answers[self.mode] += 1
        return command

    def plan(self) -> FloatArray:
        """Where it means to be: points (13, 4) of x, y [m], yaw [rad], speed [m/s], ``STEP`` s
        apart, the first now, for ``member.tell_plan``; none before it knows its place."""
        if self.mode is Mode.WAITING:
            return np.empty((0, 4))
        X = self.X + self.rate * STEP * np.arange(POINTS, dtype=np.float64)
        spots = [self.course.spot(float(one)) for one in X]
        speed = self.rate * self.formation.curve.rate(X)
        speed[0] = max(self._moves, 0.0)
        return np.array([(p.x, p.y, p.heading, v) for p, v in zip(spots, speed, strict=True)])

    @property
    def most_beside(self) -> float:
        """m beside the curve at most, by its own belief, once it was under way."""
        offset = self.follower.driven.table[self.follower.joined:, 3]
        return float(np.abs(offset).max(initial=0.0))

    def disagreement(self, now: float) -> float:
        """Largest error [rad] of a neighbour's phase from its slot, by what is known of it, in the
        spread that is nearest: cars that begin anywhere find one of ``formation.windings``."""
        before, after = (self.peers[name].phase(now) for name in self._ring)
        steps = (2.0 * pi * p / self.formation.n for p in self.formation.windings)
        return min(max(abs(apart(self.X - before, step)), abs(apart(after - self.X, step)))
                   for step in steps)

    def _cap(self, motion: MotionEstimate) -> float:
        """m/s; 0: it stands."""
        self._moves = motion.speed
        now = motion.t
        self.why = ""
        if self.follower.phase is Phase.WAITING:
            self.rate = 0.0
            return 0.0
        self.mode = self._judged(now)
        if self.mode in (Mode.ALONE, Mode.YIELDING):
            self.rate = 0.0
            return 0.0
        before, after = (self.peers[name].phase(now) for name in self._ring)
        wanted = self.omega + repulsion(self.X, before, after, self.k)
        self.rate = min(max(wanted, LINGER * self.omega), self.fastest)
        speed = self.rate * float(self.formation.curve.rate(np.array(self.X)))
        return speed if speed > 0.5 * CRAWL else 0.0

    def _judged(self, now: float) -> Mode:
        touch = {name: peer.touch(now) for name, peer in self.peers.items()}
        silent = [name for name, how in touch.items() if how is Touch.SILENT]
        if silent and self._guard is not None:
            self.why = ", ".join(silent)
            return Mode.ALONE
        self.why = ", ".join(name for name in self.peers if not self._free(name, now))
        if self.why:
            return Mode.YIELDING
        if any(touch[name] is not Touch.IN_TOUCH for name in self._ring):
            return Mode.EXTRAPOLATING
        return Mode.MONITORING if self.disagreement(now) < IN_STEP else Mode.SPREADING

    def _free(self, name: str, now: float) -> bool:
        """Whether it may go on beside another car."""
        if self._guard is None:
            return True
        peer = self.peers[name]
        s = self.follower.tracker.s
        length = self.course.path.length
        at = self.course.arc(peer.heard_at)
        at += length * np.floor((s - at) / length)  # behind this car, by less than a lap
        top = HURRY * self.omega * self._top
        other = reachable(at, peer.heard_speed, max(peer.age(now), 0.0), top)
        return self._guard.free(s, self._moves, other, yields=self.names.index(name) < self._at,
                                sure=peer.touch(now) is Touch.IN_TOUCH)


def _check_team(formation: Formation, names: Sequence[str], own: str) -> None:
    if len(names) != formation.n or len(set(names)) != formation.n or own not in names:
        raise UsageError("the team is not the formation's", found=f"{own} of {', '.join(names)}",
                         expected=f"{formation.n} names, no two alike, {own} among them")
    if formation.alpha != 1:
        raise UsageError("cars find their phase by their place, so X must be the phase",
                         found=f"alpha = {formation.alpha}", expected="alpha = 1",
                         remedy=f"Formation(curve, {formation.n}, p) with another p")
