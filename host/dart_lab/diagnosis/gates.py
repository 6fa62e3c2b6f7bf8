"""The gates of a diagnosis: conditions that an accepted effect of the catalogue fulfils."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from dart_hal.vehicle.effect import Effect
from dart_lab.report.numbers import describe_change

from .policy import Policy
from .result import Cost
from .search.size_search import scanned_parameters


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """Quantities of an effect that the gates test.

    gain, threshold: drop of the loss by the linear solution, and the drop that chance reaches at
    the false-alarm rate. size: as ``relative_size``, by the linear solution, or by the full fit
    after it. chosen: effect that is accepted in this round, or "". fit_gain: drop of the loss by
    the full fit. remaining_gain: the same in a fit with all causes found later.

    structure_after, structure_before: loss of the structure in a channel where the effect acts,
    with it and without it; structure_removed: the drop of the whole loss there.
    impossible: why no car has this size, or "". probability: share of draws in which held-out data
    are predicted better. cost: errors of the test recordings without it, over those with it, and
    the interval of this ratio.
    """

    gain: float = math.inf
    threshold: float = 0.0
    size: float = math.inf
    chosen: str = ""
    fit_gain: float = math.inf
    remaining_gain: float = math.inf
    structure_after: float = 0.0
    structure_before: float = 0.0
    structure_removed: float = 0.0
    impossible: str = ""
    probability: float = 1.0
    cost: Cost = (math.inf, math.inf, math.inf)

    def confirmation(self, policy: Policy) -> float:
        """Return what must exceed 1: the ratio if confident, else the lower end of its interval."""
        ratio, low, _ = self.cost
        confident = self.probability >= policy.grade.confident_probability
        return ratio if confident or not math.isfinite(low) else low

    def errors_without(self) -> str:
        """Return the errors of the test recordings without the effect, in words."""
        return f"without it the test errors are {describe_change(*self.cost)}"


class AcceptanceGate(NamedTuple):
    """One condition of an accepted effect.

    stage: one of STAGES. test: whether a candidate passes. condition: the same in words, with the
    thresholds of a policy. message: why a candidate did not pass.
    """

    name: str
    stage: str
    test: Callable[[Candidate, Policy], bool]
    condition: Callable[[Policy], str]
    message: Callable[[Candidate], str]


# Effects and data of each stage, in the order of a diagnosis.
STAGES = {
    "scan": "each effect in each round of the search, by the linear answer",
    "fit": "the best of them, by the full fit",
    "search": "each candidate once another was found",
    "structure": "all candidates",
    "grade": "all candidates, by their size and by training data left out of the fit",
    "test": "all candidates, by the test recordings",
}

TOO_SMALL = "so small that sampling or time stamps alone could cause it"
WITHDRAWN = "withdrawn: with it as much structure is left as without it"
IMPROBABLE = "too few of the data left out of its fit are predicted better with it"

# All gates, in the order of a diagnosis.
GATES = (
    AcceptanceGate("significance", "scan", lambda c, p: c.gain > c.threshold,
         lambda p: "its gain is above the threshold of the null distribution",
         lambda c: "its gain is below the threshold of chance"),
    AcceptanceGate("largest gain", "scan", lambda c, p: not c.chosen,
         lambda p: "no other effect has entered in this round",
         lambda c: f"{c.chosen} has entered in this round"),
    AcceptanceGate("size", "scan", lambda c, p: c.size >= p.naming.min_tried_size,
         lambda p: f"at least {p.naming.min_tried_size:g} of its small size", lambda c: TOO_SMALL),
    AcceptanceGate("gain of the fit", "fit", lambda c, p: c.fit_gain > c.threshold,
         lambda p: "the gain of the full fit is above the same threshold",
         lambda c: "the full fit does not keep the gain of the linear answer"),
    AcceptanceGate("size of the fit", "fit", lambda c, p: c.size >= p.naming.min_size,
         lambda p: f"at least {p.naming.min_size:g} of its small size", lambda c: TOO_SMALL),
    AcceptanceGate("gain with the others", "search", lambda c, p: c.remaining_gain >= c.threshold,
         lambda p: "without it the loss rises by at least its threshold",
         lambda c: "effects found later explain what it did"),
    AcceptanceGate("structure", "structure",
         lambda c, p: (c.structure_after <= c.structure_removed
                       or c.structure_after
                       <= p.conclusion.max_remaining_share * c.structure_before),
         lambda p: ("the structure left where it acts is less than what it removes, or than "
                    f"{p.conclusion.max_remaining_share:g} of the structure without it"),
         lambda c: WITHDRAWN),
    AcceptanceGate("possible size", "grade", lambda c, p: not c.impossible,
         lambda p: "a car can have its size", lambda c: c.impossible),
    AcceptanceGate("probability", "grade", lambda c, p: c.probability >= p.grade.likely_probability,
         lambda p: (f"in at least {p.grade.likely_probability:g} of draws data left out are "
                    "predicted better"),
         lambda c: IMPROBABLE),
    AcceptanceGate("confirmation", "test", lambda c, p: c.confirmation(p) > 1.0,
         lambda p: ("the test errors without it are larger; the interval of their ratio is above "
                    f"1 where the probability is below {p.grade.confident_probability:g}"),
         lambda c: f"the test recordings do not confirm it: {c.errors_without()}"),
)


def relative_size(effect: Effect, values: Mapping[str, float]) -> float:
    """Return the largest deviation of a parameter from its null, over its small size."""
    return max(abs(values.get(q.name, q.null) - q.null) / q.sizes[0]
               for q in scanned_parameters(effect))


def find_failed_gate(stage: str, candidate: Candidate, policy: Policy) -> AcceptanceGate | None:
    """Return the first gate of a stage that a candidate does not pass."""
    return next((g for g in GATES if g.stage == stage and not g.test(candidate, policy)), None)


def explain_failure(stage: str, candidate: Candidate, policy: Policy) -> str:
    """Return why a candidate does not pass a stage; empty if it does."""
    gate = find_failed_gate(stage, candidate, policy)
    return gate.message(candidate) if gate else ""
