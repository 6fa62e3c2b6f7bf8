"""One car that shares its plans: it proposes, acknowledges, adopts, and gives the motion to drive.

Twenty times a second: ``receive`` new messages, ``step``, send ``next_message``; ``motion_at`` is
what to drive in between. It has no clock and no transport of its own.

Each car executes its committed plan c, which ends at rest. To change it, a car proposes a plan q
that is c up to a branch time in the future. Every message of a car contains its c and its q.

1. Car j acknowledges q of car i only if q keeps the distance from c_j and from q_j. From then on j
   proposes only plans that keep the distance from q as well, until a newer message of i does not
   contain q. (If q is only in the way of q_j, and precedes it, j first withdraws q_j.)
2. Car i adopts q only when each other car has acknowledged q, before the branch time. Else it
   withdraws q and continues with c.

*No two committed plans come nearer than the distance, even if messages are lost, delayed or
repeated.* At first all cars are at rest at separate places. Suppose i adopts q, as j acknowledged
it at a time T. The committed plan of j is then one of these:

- c_j or q_j of time T: compared with q before it was acknowledged (1);
- a plan proposed by j after T: compared with c_i and q, since j still held the message of i that
  contains q. A newer message of i that j may have received contains q too, as i adopts only what it
  has not withdrawn (2).

Two cars that adopt at the same moment are no exception: of their acknowledgements one was sent
later, and its sender compared the other's q with its own q. Without any message each car completes
its own plan, which keeps the distance from all others, and rests.

*Progress.* All plans end where ``PlanSpace.rests`` allows it, so of cars at rest one always has a
free path. Of two proposals in conflict the one with the smaller priority is acknowledged, and a
car plans around proposals of others only if it has acknowledged them or they precede its own. So
the first car has its plan adopted as soon as messages arrive; a ring of waiting is impossible.

A car that restarts has lost its acknowledgements: its new session (``boot``) is refused, and the
others rest before its paths.
"""

from __future__ import annotations

from collections import Counter
from math import ceil, inf
from typing import NamedTuple

import numpy as np

from dart_hal.control.shared_plans.message import PlanMessage, decode, encode
from dart_hal.control.shared_plans.search import comparison_times, find_plan, score
from dart_hal.control.shared_plans.space import PlanSpace
from dart_hal.control.shared_plans.timed_plan import (
    TIME_STEP,
    TimedPlan,
    cut_before,
    motion_at,
    replace_after,
    rest_plan,
)
from dart_hal.core.errors import UsageError
from dart_hal.core.types import TextEnum

# Time from a proposal to its branch [s]: at least, since an answer takes 0.2 s where no message is
# lost; at first; at most. It grows by one step after a proposal that was not acknowledged in time,
# and falls by one step after one that was.
MIN_LEAD = 0.25
FIRST_LEAD = 0.4
MAX_LEAD = 1.5
# Time after which the search is repeated although nothing has changed [s].
MAX_SEARCH_AGE = 1.0
# Least gain of a proposal, in the mean of its arc lengths [m].
MIN_SCORE_GAIN = 0.02


class PlanVerdict(TextEnum):
    """Classification of a message.

    INVALID: no message of these cars; OLDER: overtaken or repeated; RETIRED: of a car that has
    restarted.
    """

    TAKEN = "TAKEN"
    INVALID = "INVALID"
    OLDER = "OLDER"
    RETIRED = "RETIRED"
    OWN = "OWN"


class OtherPlans(NamedTuple):
    """Last message of another car; the times of its plans are of the own clock."""

    message: PlanMessage
    committed: TimedPlan
    proposal: TimedPlan | None


class PlanSharer:
    """Car ``own`` of a space, at rest at s [m] of its first path.

    ``committed``: the plan that it executes; ``proposal``: the one that waits for acknowledgements,
    or None; ``counts``: of messages by ``PlanVerdict``, and of proposals PROPOSED, ADOPTED, EXPIRED
    and WITHDRAWN.
    """

    def __init__(self, space: PlanSpace, own: int, s: float, boot: int, t: float = 0.0) -> None:
        """boot: random number of this session, not 0. Raises UsageError for a place at which the
        car may not rest.
        """
        path = space.paths[own][0]
        rests = space.rests[own][0]
        if not rests[min(round(s / path.spacing), len(rests) - 1)]:
            raise UsageError(
                f"car {own} starts on a path of another car",
                found=f"{s:.2f} m of its path",
                expected=f"{space.min_distance:g} m from the paths of all other cars",
            )
        self.space = space
        self.own = own
        self.boot = boot
        self.committed = rest_plan(0, t, s)
        self.proposal: TimedPlan | None = None
        self.counts: Counter[str] = Counter()
        self._start_s = s
        self._first_score: float | None = None
        self._key = space.key
        self._others: list[OtherPlans | None] = [None] * len(space.paths)
        self._accepted = [0] * len(space.paths)
        self._seq = 0
        self._version = 0
        self._number = 0
        self._branch_t = inf
        # Remaining distance [m] at the last search: the nearest car precedes.
        self._priority = inf
        self._lead = FIRST_LEAD
        self._searched: tuple[object, ...] = ()
        self._searched_t = -inf

    def motion_at(self, t: float) -> tuple[float, float, float]:
        """Return arc length [m], speed [m/s] and acceleration [m/s2] to drive at t [s]."""
        return motion_at(self.committed, t)

    @property
    def path(self) -> int:
        """Number of the path of the committed plan."""
        return self.committed.path

    def receive(self, data: bytes, t: float, age: float) -> PlanVerdict:
        """Take a message received at t [s] of the own clock, ``age`` s after it was sent."""
        verdict = self._take(decode(data, self._key), t, age)
        self.counts[verdict.value] += 1
        return verdict

    def step(self, t: float) -> None:
        """Adopt, withdraw or make a proposal at t [s]."""
        if self.proposal is not None:
            # The committed plan has left the proposal at its branch.
            if t >= self._branch_t:
                self._withdraw("EXPIRED")
                self._lead = min(self._lead + TIME_STEP, MAX_LEAD)
            elif self.is_acknowledged():
                self.committed = self.proposal
                self._version = self._number
                self.proposal = None
                self.counts["ADOPTED"] += 1
                self._lead = max(self._lead - TIME_STEP, MIN_LEAD)
        if self.proposal is None:
            self._propose(t)

    def next_message(self, t: float) -> bytes:
        """Return the message to send at t [s]."""
        self._seq += 1
        committed = cut_before(self.committed, t)
        proposal = self.proposal and cut_before(self.proposal, t)
        return encode(
            PlanMessage(
                self.own,
                self.boot,
                self._seq,
                self._version,
                committed._replace(t=committed.t - t),
                self._number,
                proposal and proposal._replace(t=proposal.t - t),
                self._priority,
                tuple(self._accepted),
                tuple(0 if o is None else o.message.boot for o in self._others),
            ),
            self._key,
        )

    def is_acknowledged(self) -> bool:
        """Return whether each other car has acknowledged the proposal."""
        return all(
            o is not None
            and o.message.heard[self.own] == self.boot
            and o.message.accepted[self.own] == self._number
            for j, o in enumerate(self._others)
            if j != self.own
        )

    def _take(self, m: PlanMessage | None, t: float, age: float) -> PlanVerdict:
        """Store a message and answer its proposal."""
        n = len(self._others)
        if m is None or m.id >= n or len(m.accepted) != n:
            return PlanVerdict.INVALID
        paths = len(self.space.paths[m.id])
        if m.committed.path >= paths or (m.proposal and m.proposal.path >= paths):
            return PlanVerdict.INVALID
        if m.id == self.own:
            return PlanVerdict.OWN
        last = self._others[m.id]
        if last is not None and last.message.boot != m.boot:
            return PlanVerdict.RETIRED
        if last is not None and m.seq <= last.message.seq:
            return PlanVerdict.OLDER
        # Clocks differ, so the message has ages, and this car has its own times of them.
        sent_t = t - age
        other = OtherPlans(
            m,
            m.committed._replace(t=sent_t + m.committed.t),
            m.proposal and m.proposal._replace(t=sent_t + m.proposal.t),
        )
        self._others[m.id] = other
        # The other car will not acknowledge what meets its committed plan.
        if self.proposal and not self._are_separated(t, self.proposal, m.id, other.committed):
            self._withdraw()
        if other.proposal and self._accepted[m.id] != m.number:
            self._answer(t, m.id, other.proposal, m)
        return PlanVerdict.TAKEN

    def _answer(self, t: float, j: int, plan: TimedPlan, m: PlanMessage) -> None:
        """Acknowledge the proposal of car j if no own plan is in its way."""
        if not self._are_separated(t, self.committed, j, plan):
            return
        if self.proposal and not self._are_separated(t, self.proposal, j, plan):
            if (self._priority, self.own) < (m.priority, j):
                return
            self._withdraw()
        self._accepted[j] = m.number

    def _withdraw(self, reason: str = "WITHDRAWN") -> None:
        """Give the proposal up: it is never adopted."""
        self.proposal = None
        self._branch_t = inf
        self._searched = ()
        self.counts[reason] += 1

    def _are_separated(self, t: float, own: TimedPlan, j: int, plan: TimedPlan) -> bool:
        """Return whether an own plan keeps the distance from a plan of car j from t [s] on."""
        return self.space.distance(self.own, own, j, plan, t) >= self.space.min_distance

    def _constraints(self) -> list[tuple[int, int, TimedPlan]]:
        """Return (car, number, plan) of all plans that the next proposal keeps away from.

        Committed plans, and proposals that were acknowledged or precede the own one.
        """
        found = []
        for j, other in enumerate(self._others):
            if other is None:
                continue
            m = other.message
            found.append((j, m.version, other.committed))
            if other.proposal and (
                self._accepted[j] == m.number or (m.priority, j) < (self._priority, self.own)
            ):
                found.append((j, m.number, other.proposal))
        return found

    def _propose(self, t: float) -> None:
        """Search a plan that branches from the committed one, and propose it if it is better."""
        path = self.space.paths[self.own][self.path]
        self._priority = float(np.float32(path.length - self.motion_at(t)[0]))
        constraints = self._constraints()
        state = (self._version, tuple(c[:2] for c in constraints))
        if state == self._searched and t < self._searched_t + MAX_SEARCH_AGE:
            return
        self._searched = state
        self._searched_t = t
        base = cut_before(self.committed, t)
        # A car at rest may start at any time, not only at a knot.
        if base.levels == (0,):
            base = rest_plan(base.path, t + self._lead, base.s)
        k = max(ceil((t + self._lead - base.t) / TIME_STEP - 1e-6), 0)
        branch_t = base.t + k * TIME_STEP
        branch = cut_before(base, branch_t + 1e-6)
        best: TimedPlan | None = None
        best_score = score(branch) + MIN_SCORE_GAIN
        times = comparison_times(branch_t)
        others = [self.space.positions(j, plan, times) for j, _, plan in constraints]
        # A car that has not started may choose another of its paths.
        is_at_start = branch.s == self._start_s and branch.levels == (0,)
        choices = range(len(self.space.paths[self.own])) if is_at_start else (base.path,)
        for choice in choices:
            found = find_plan(
                self.space.paths[self.own][choice],
                self.space.rests[self.own][choice],
                branch.s,
                branch.levels[0],
                others,
                self.space.min_distance,
            )
            if found is not None and found.score > best_score:
                best_score = found.score
                best = replace_after(base, k, choice, found.levels)
            # No other path can be better than the first one without cars.
            if len(choices) > 1 and best_score >= self._free_score() - MIN_SCORE_GAIN:
                break
        if best is not None:
            self.proposal = best
            self._branch_t = branch_t
            self._number += 1
            self.counts["PROPOSED"] += 1

    def _free_score(self) -> float:
        """Return the score of the first path from the start without other cars."""
        if self._first_score is None:
            path = self.space.paths[self.own][0]
            rests = self.space.rests[self.own][0]
            found = find_plan(path, rests, self._start_s, 0, [], self.space.min_distance)
            self._first_score = inf if found is None else found.score
        return self._first_score
