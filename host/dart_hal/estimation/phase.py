"""Direction of travel from the phase of two encoder rings on one shaft.

An edge of ring B falls at the phase u in (0, 1) of the current interval of ring A:

    u = (t_b - t_a0) / (t_a1 - t_a0)        t_a0 < t_b <= t_a1: edges of A around it

Forwards u has a density p_f(u), backwards p_b(u). The angle between the rings is unknown, the
teeth are uneven, and a Hall switch opens at a weaker field than it closes at, so p_b(u) is not
quite p_f(1 - u). Both densities are therefore learnt as histograms, each while command and
acceleration agree on the direction. The sum over the newest edges decides:

    sum of log p_f(u) - log p_b(u)        > 0: forwards

While only one density is learnt, the other is uniform and only a contradiction counts: an edge
that is improbable forwards suggests reverse. Rings with equal densities (B on the edges of A, or
half way between) sum to zero and give no decision. Unlike the acceleration (``direction.py``) the
method needs no change of speed, and slip does not matter: it observes the shaft.
"""

from __future__ import annotations

from collections import deque
from math import log

# Around the circle of u, 6 % of an interval each. An edge is divided between the two nearest bin
# centres, and a density is interpolated in the same way, so that bin borders do not matter.
PHASE_BINS = 16
# Edges in each bin before the first observation (Jeffreys prior).
PRIOR_COUNT = 0.5
# Edges of a density before it is used: 16 cm of travel. An empty bin then has 0.5 / 48, a sixth of
# the uniform density.
MIN_LEARNT_EDGES = 40.0
# Edges after which old ones are halved, so that a magnet that moved is re-learnt within 2 m.
MAX_LEARNT_EDGES = 400.0
# Largest contribution of one edge: three must agree, because a reversal within an interval gives
# one wrong phase.
MAX_LOG_RATIO = 3.0
# Sum that decides: exceeded by chance once in exp(8) = 3000 edges.
DECISION_LOG_RATIO = 8.0
# Number of newest edges that are summed.
SUMMED_EDGES = 5
# Frames since the last agreement in which the acceleration gave the opposite sign, after which the
# histograms are discarded. A wheel that regains grip after a spin causes about ten.
MAX_CONTRADICTIONS = 100
# s without an edge of B after which the wheels may have reversed: below 1.4 cm/s.
MAX_EDGE_AGE = 0.3


class RingPhase:
    """Estimates the direction; ``add`` returns 1 forwards, -1 backwards, 0 if undecided."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Discard the histograms: the Nano restarted its counts, or they proved wrong."""
        self._histogram = {1: [PRIOR_COUNT] * PHASE_BINS, -1: [PRIOR_COUNT] * PHASE_BINS}
        self._edges_learnt = {1: 0.0, -1: 0.0}
        self._count_b = -1
        self._contradictions = 0
        self._phases: deque[tuple[float, float]] = deque(maxlen=SUMMED_EDGES)

    def add(self, now: float, edge_t: float, edge_dt: float, count_b: int, edge_b_t: float,
            confirmed: int, inertial: int) -> int:
        """Process one frame at device time ``now`` [s] and return the direction.

        edge_t, edge_dt [s]: newest edge of ring A and the interval before it, 0 = unknown;
        count_b, edge_b_t: edges of ring B, unwrapped, and the time of the newest one [s];
        confirmed: direction on which command and acceleration agree; inertial: direction by the
        acceleration alone; 0 = none.
        """
        phase = self._new_phase(edge_t, edge_dt, count_b, edge_b_t)
        if phase is not None:
            self._phases.append((edge_b_t, phase))
        while self._phases and now - self._phases[0][0] > MAX_EDGE_AGE:
            self._phases.popleft()
        total = sum(self._log_ratio(phase) for _, phase in self._phases)
        inconsistent = total * confirmed < 0.0 or inertial == -confirmed
        if phase is not None and confirmed and not inconsistent:
            self._learn(confirmed, phase)
        direction = self._decide(total)
        if self._count_contradiction(direction * inertial):
            self.forget()
            return 0
        return direction

    def _count_contradiction(self, agreement: int) -> bool:
        """Count frames against the acceleration; return whether there are too many."""
        if agreement:
            self._contradictions = 0 if agreement > 0 else self._contradictions + 1
        return self._contradictions > MAX_CONTRADICTIONS

    def _new_phase(self, edge_t: float, edge_dt: float, count_b: int, edge_b_t: float
                   ) -> float | None:
        """Return the phase of a new edge of B within the newest complete interval of A, or None."""
        if count_b == self._count_b or edge_dt <= 0.0 or edge_b_t > edge_t:
            return None
        self._count_b = count_b
        phase = 1.0 - (edge_t - edge_b_t) / edge_dt
        return phase if phase > 0.0 else None

    def _log_ratio(self, phase: float) -> float:
        """Return log p_f(u) - log p_b(u), limited to MAX_LOG_RATIO."""
        ratio = log(self._density(1, phase) / self._density(-1, phase))
        return max(-MAX_LOG_RATIO, min(MAX_LOG_RATIO, ratio))

    def _density(self, direction: int, phase: float) -> float:
        """Return p(u) of a direction; 1 while it is not learnt."""
        learnt = self._edges_learnt[direction]
        histogram = self._histogram[direction]
        if learnt < MIN_LEARNT_EDGES:
            return 1.0
        return sum(weight * histogram[k] for k, weight in _bin_weights(phase)) / (
            learnt / PHASE_BINS + PRIOR_COUNT)

    def _learn(self, direction: int, phase: float) -> None:
        """Add one phase to the histogram of a direction, and halve the counts at the limit."""
        histogram = self._histogram[direction]
        for k, weight in _bin_weights(phase):
            histogram[k] += weight
        self._edges_learnt[direction] += 1.0
        if self._edges_learnt[direction] > MAX_LEARNT_EDGES:
            self._edges_learnt[direction] *= 0.5
            self._histogram[direction] = [0.5 * (n + PRIOR_COUNT) for n in histogram]

    def _decide(self, total: float) -> int:
        """Return the sign of the sum if it is decisive and the opposite direction is learnt."""
        direction = (total > DECISION_LOG_RATIO) - (total < -DECISION_LOG_RATIO)
        return direction if direction and self._edges_learnt[-direction] >= MIN_LEARNT_EDGES else 0


def _bin_weights(phase: float) -> tuple[tuple[int, float], tuple[int, float]]:
    """Return the two bins nearest to u, each with its weight."""
    below, share = divmod(phase * PHASE_BINS - 0.5, 1.0)
    k = int(below)
    return ((k % PHASE_BINS, 1.0 - share), ((k + 1) % PHASE_BINS, share))
