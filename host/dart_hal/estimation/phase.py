"""Which way the wheels turn, by the phase of two rings on one shaft.

An edge of ring B falls at the phase u in (0, 1) of the interval of ring A that it is in:

    u = (t_b - t_a0) / (t_a1 - t_a0)        t_a0 < t_b <= t_a1: edges of A around it

Forwards it has a density p_f(u), backwards p_b(u). Nobody glues a ring at a known angle, no ring
is even, and a Hall switch opens at a weaker field than it closes at, so that p_b(u) is not quite
p_f(1 - u): both are learnt, each while command and acceleration vouch for its direction, as a
histogram. The newest edges say

    sum of log p_f(u) - log p_b(u)        > 0: forwards

With one of the two learnt, the other is uniform and only a contradiction counts: what does not
fall where it falls forwards is not forwards. Rings whose densities are alike, B on the edges of A
or half way between, sum to nothing and never speak. Unlike the acceleration (``direction.py``) it
needs no change of speed, and a wheel that slips is no trap: it tells of the shaft.
"""

from __future__ import annotations

from collections import deque
from math import log

BINS = 16
"""Around the circle of u, 6 % of an interval each. An edge is shared by the two whose middles it
lies between, and a density read in the same way: nothing hangs on a border."""
PRIOR = 0.5
"""Edges in each bin before any was seen (Jeffreys)."""
LEARNT = 40.0
"""Edges of a density before it counts: 16 cm of travel. A bin without one has 0.5 / 48 then, a
sixth of uniform."""
MEMORY = 400.0
"""Edges: what is older fades, so that a magnet that moved is learnt anew within 2 m."""
VOICE = 3.0
"""Most that one edge may say: three have to agree, a reversal within an interval fakes one."""
SAYS = 8.0
"""Sum that tells: by chance once in exp(8) = 3000 edges."""
HEARD = 5
"""Newest edges that are summed."""
CONTRADICTED = 100
"""Frames since the last agreement in which the acceleration said the opposite, after which what was
learnt is wrong: a wheel that catches again after a spin makes it err for some ten."""
SILENCE = 0.3
"""s without an edge of B after which the wheels may have turned round: below 1.4 cm/s."""


class RingPhase:
    """Give ``add`` each frame: 1 forwards, -1 backwards, 0 where it cannot be told."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Learn anew: the Nano counts from other edges, or what was learnt proved wrong."""
        self._seen = {1: [PRIOR] * BINS, -1: [PRIOR] * BINS}
        self._learnt = {1: 0.0, -1: 0.0}
        self._count_b = -1
        self._contradicted = 0
        self._heard: deque[tuple[float, float]] = deque(maxlen=HEARD)

    def add(self, now: float, edge_t: float, edge_dt: float, count_b: int, edge_b_t: float,
            witnessed: int, felt: int) -> int:
        """One frame at device time ``now`` [s].

        edge_t, edge_dt [s]: newest edge of ring A and the interval before it, 0 = unknown;
        count_b, edge_b_t: edges of ring B, unwrapped, and the newest one's time; witnessed: the
        direction where command and acceleration vouch for it; felt: where the acceleration says
        something; 0 = nothing.
        """
        phase = self._phase(edge_t, edge_dt, count_b, edge_b_t)
        if phase is not None:
            self._heard.append((edge_b_t, phase))
        while self._heard and now - self._heard[0][0] > SILENCE:
            self._heard.popleft()
        total = sum(self._voice(phase) for _, phase in self._heard)
        doubted = total * witnessed < 0.0 or felt == -witnessed
        if phase is not None and witnessed and not doubted:
            self._learn(witnessed, phase)
        verdict = self._verdict(total)
        if self._is_contradicted(verdict * felt):
            self.forget()
            return 0
        return verdict

    def _is_contradicted(self, agreement: int) -> bool:
        if agreement:
            self._contradicted = 0 if agreement > 0 else self._contradicted + 1
        return self._contradicted > CONTRADICTED

    def _phase(self, edge_t: float, edge_dt: float, count_b: int, edge_b_t: float) -> float | None:
        """Of an edge of B not seen before within the newest whole interval of A."""
        if count_b == self._count_b or edge_dt <= 0.0 or edge_b_t > edge_t:
            return None
        self._count_b = count_b
        phase = 1.0 - (edge_t - edge_b_t) / edge_dt
        return phase if phase > 0.0 else None

    def _voice(self, phase: float) -> float:
        ratio = log(self._density(1, phase) / self._density(-1, phase))
        return max(-VOICE, min(VOICE, ratio))

    def _density(self, way: int, phase: float) -> float:
        """p(u) of a direction; 1 while it is not learnt."""
        learnt, seen = self._learnt[way], self._seen[way]
        if learnt < LEARNT:
            return 1.0
        return sum(share * seen[k] for k, share in _shares(phase)) / (learnt / BINS + PRIOR)

    def _learn(self, way: int, phase: float) -> None:
        seen = self._seen[way]
        for k, share in _shares(phase):
            seen[k] += share
        self._learnt[way] += 1.0
        if self._learnt[way] > MEMORY:
            self._learnt[way] *= 0.5
            self._seen[way] = [0.5 * (n + PRIOR) for n in seen]

    def _verdict(self, total: float) -> int:
        """What the newest edges say in sum, where it is against a direction that is learnt."""
        way = (total > SAYS) - (total < -SAYS)
        return way if way and self._learnt[-way] >= LEARNT else 0


def _shares(phase: float) -> tuple[tuple[int, float], tuple[int, float]]:
    """The two bins around u and what each has of it."""
    below, share = divmod(phase * BINS - 0.5, 1.0)
    k = int(below)
    return ((k % BINS, 1.0 - share), ((k + 1) % BINS, share))
