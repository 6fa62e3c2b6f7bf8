"""One car of the team: from its motion and the messages of the others to steering and speed.

    position -> X on the curve -> theta' = Omega + k sum sin(theta_i - theta_j)   (kuramoto)
          -> v = |dr/dX| X', within the bends and the limits of the car           (follow)
          -> 0 if another car may be in the way, or one is silent                 (guard)

The position determines X; with alpha = 1, which a formation of cars needs, X is the phase.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from math import hypot, inf, pi

import numpy as np

from dart_hal.control.ending import Phase
from dart_hal.control.follow import DriveCommand, Follower, Rules
from dart_hal.control.lap import CRAWL_SPEED
from dart_hal.control.monitoring.course import Course
from dart_hal.control.monitoring.drivable import check_drivable, check_rate, max_rate
from dart_hal.control.monitoring.formation import Formation
from dart_hal.control.monitoring.guard import CollisionGuard, reachable_section
from dart_hal.control.monitoring.kuramoto import repulsion
from dart_hal.control.monitoring.peer import (
    PLAN_POINTS,
    PLAN_STEP,
    Contact,
    Peer,
    ReceivedPlan,
    phase_difference,
)
from dart_hal.control.plant import Plant
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray, MotionEstimate, TextEnum

# Largest error of a neighbour's phase from its slot [rad]: 4 % of the distance from one robot to
# the next of five.
MAX_PHASE_ERROR = 0.2

# Range of the rate of a car, relative to the rate of the formation: no car of the team is slower,
# so none obstructs others because of its phase, or faster, which the others assume. The law is
# still a descent: clipping keeps its sign.
MIN_RATE_FACTOR = 0.3
MAX_RATE_FACTOR = 2.0


class MonitorMode(TextEnum):
    """Mode of a car of the team.

    WAITING: its position is unknown; SPREADING: the phases are not even yet; MONITORING;
    EXTRAPOLATING: no message of a neighbour for 0.5 s; YIELDING: it waits for a car that may be in
    its way; ALONE: a car of the team is silent, and its position is unknown; ENDED.
    """

    WAITING = "WAITING"
    SPREADING = "SPREADING"
    MONITORING = "MONITORING"
    EXTRAPOLATING = "EXTRAPOLATING"
    YIELDING = "YIELDING"
    ALONE = "ALONE"
    ENDED = "ENDED"


MODE_OF_PHASE = {
    Phase.WAITING: MonitorMode.WAITING,
    Phase.STOPPING: MonitorMode.ENDED,
    Phase.ENDED: MonitorMode.ENDED,
}


class Monitor:
    """Robot ``own`` of a formation. Call ``answer`` once per State, ``plan`` whenever it is sent.

    names: of all cars, in the order of the ring. omega, k [rad/s]: rate of the formation and
    coupling. guard False: for tests, it ignores collisions. ``mode``; ``why``: the cars it waits
    for; ``answers``: calls in each mode; ``follower``: the drive, its end and its record.
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
        plant.gains.interpolate(0.0)  # created now: this takes a second, in which no car may drive
        fastest = max_rate(self.course, self.follower.profile)
        check_rate(omega, fastest)
        self.fastest = min(fastest, MAX_RATE_FACTOR * omega)
        self.peers = {name: Peer(self.course) for name in names if name != own}
        self.names = tuple(names)
        self._index = names.index(own)
        self._ring = tuple(names[(self._index + d) % len(names)] for d in (-1, 1))
        self._guard = CollisionGuard(self.course) if guard else None
        curve = formation.curve
        self._max_slope = hypot(curve.A * curve.a, curve.B * curve.b)
        """Upper bound of |dr/dX| [m/rad]."""
        self.mode = MonitorMode.WAITING
        self.why = ""
        self.answers = Counter[MonitorMode]()
        self.X = self.rate = self._speed = 0.0

    def answer(
        self, motion: MotionEstimate, plans: Mapping[str, ReceivedPlan] | None = None
    ) -> DriveCommand:
        """Return the command at ``motion.t``; plans: the newest plans of the others.

        Raises UsageError for a start that is too far from the curve.
        """
        now = motion.t
        for name, plan in (plans or {}).items():
            if name in self.peers:
                self.peers[name].receive(plan, now)
        self.follower.cap = self._cap(motion)
        command = self.follower.answer(motion)
        if self.follower.phase in MODE_OF_PHASE:
            self.mode = MODE_OF_PHASE[self.follower.phase]
            self.rate = 0.0
        self.X = self.course.parameter(self.follower.tracker.s)
        self.answers[self.mode] += 1
        return command

    def plan(self) -> FloatArray:
        """Return the plan for ``member.tell_plan``: points (13, 4) of x, y [m], yaw [rad], speed
        [m/s].

        They are ``PLAN_STEP`` s after each other, the first one now; empty before the position is
        known.
        """
        if self.mode is MonitorMode.WAITING:
            return np.empty((0, 4))
        X = self.X + self.rate * PLAN_STEP * np.arange(PLAN_POINTS, dtype=np.float64)
        points = [self.course.point_at(float(one)) for one in X]
        speed = self.rate * self.formation.curve.rate(X)
        speed[0] = max(self._speed, 0.0)
        return np.array([(p.x, p.y, p.heading, v) for p, v in zip(points, speed, strict=True)])

    @property
    def max_offset(self) -> float:
        """Largest distance to the curve [m], by its own estimate, after the start."""
        largest = self.follower.driven.offset_max
        return largest if largest >= 0.0 else 0.0

    def disagreement(self, now: float) -> float:
        """Return the largest error [rad] of a neighbour's phase from its slot, by its extrapolated
        report.

        The closest spread counts: cars with any initial phases reach one of ``formation.windings``.
        """
        previous, following = (self.peers[name].phase(now) for name in self._ring)
        steps = (2.0 * pi * p / self.formation.n for p in self.formation.windings)
        return min(
            max(
                abs(phase_difference(self.X - previous, step)),
                abs(phase_difference(following - self.X, step)),
            )
            for step in steps
        )

    def _cap(self, motion: MotionEstimate) -> float:
        """Return the speed limit [m/s]; 0: wait."""
        self._speed = motion.speed
        now = motion.t
        self.why = ""
        if self.follower.phase is Phase.WAITING:
            self.rate = 0.0
            return 0.0
        self.mode = self._select_mode(now)
        if self.mode in (MonitorMode.ALONE, MonitorMode.YIELDING):
            self.rate = 0.0
            return 0.0
        previous, following = (self.peers[name].phase(now) for name in self._ring)
        rate = self.omega + repulsion(self.X, previous, following, self.k)
        self.rate = min(max(rate, MIN_RATE_FACTOR * self.omega), self.fastest)
        speed = self.rate * float(self.formation.curve.rate(np.array(self.X)))
        return speed if speed >= CRAWL_SPEED else 0.0

    def _select_mode(self, now: float) -> MonitorMode:
        """Select the mode and store the cars that it waits for."""
        contact = {name: peer.contact(now) for name, peer in self.peers.items()}
        silent = [name for name, how in contact.items() if how is Contact.SILENT]
        if silent and self._guard is not None:
            self.why = ", ".join(silent)
            return MonitorMode.ALONE
        self.why = ", ".join(name for name in self.peers if not self._may_continue(name, now))
        if self.why:
            return MonitorMode.YIELDING
        if any(contact[name] is not Contact.IN_TOUCH for name in self._ring):
            return MonitorMode.EXTRAPOLATING
        return (
            MonitorMode.MONITORING
            if self.disagreement(now) < MAX_PHASE_ERROR
            else MonitorMode.SPREADING
        )

    def _may_continue(self, name: str, now: float) -> bool:
        """Return whether it may continue with regard to another car."""
        if self._guard is None:
            return True
        peer = self.peers[name]
        s = self.follower.tracker.s
        length = self.course.path.length
        s_other = self.course.arc_length(peer.reported_X)
        s_other += length * np.floor((s - s_other) / length)  # less than a lap behind this car
        max_speed = MAX_RATE_FACTOR * self.omega * self._max_slope
        other = reachable_section(s_other, peer.reported_speed, max(peer.age(now), 0.0), max_speed)
        return self._guard.may_continue(
            s,
            self._speed,
            other,
            yields=self.names.index(name) < self._index,
            is_recent=peer.contact(now) is Contact.IN_TOUCH,
        )


def _check_team(formation: Formation, names: Sequence[str], own: str) -> None:
    """Raise UsageError if the names do not fit the formation."""
    if len(names) != formation.n or len(set(names)) != formation.n or own not in names:
        raise UsageError("the team is not the formation's", found=f"{own} of {', '.join(names)}",
                         expected=f"{formation.n} different names, including {own}")
    if formation.alpha != 1:
        raise UsageError("cars find their phase by their position, so X must be the phase",
                         found=f"alpha = {formation.alpha}", expected="alpha = 1",
                         remedy=f"Formation(curve, {formation.n}, p) with another p")
