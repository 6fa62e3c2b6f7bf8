"""Two hypotheses on one drive: how well can the wrong one pretend to be the right one?

The truth's predictions are the data. The confounder may have any size that suits the
data at hand, and base parameters and timing follow it, to first order; what loss
is left is what a diagnosis of both would see on average, whatever the noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.errors import ConfigError
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.effect import Parameter
from dart_hal.vehicle.effects import apply, catalogue
from dart_hal.vehicle.parameters import Vehicle

from ..evidence.residuals import Residuals
from ..search.size_search import scanned_parameters
from .side import Side

LADDER = (0.1, 0.35, 1.0, 2.2, 5.0)  # of the medium size
TOLERANCE = 0.01  # of the medium size
ROUNDS = 12
FLAT = 1e-3  # of loss
Size = Callable[[str, str, float], float]
"""(effect, parameter, value) -> robust loss that this size costs on other data."""


@dataclass(frozen=True, slots=True)
class Mimic:
    """A confounder at its best. loss: robust loss that the truth saves.

    values: its size, on the first side where each has its own; car: the base
    as it follows, with the confounder; differences: (N,) of each side, before
    anything follows; elsewhere: part of the loss that its size costs on other data.
    """

    values: Mapping[str, float]
    loss: float
    car: Vehicle
    differences: tuple[FloatArray, ...]
    elsewhere: float = 0.0

    @property
    def separation(self) -> float:
        """Standard deviations."""
        return math.sqrt(max(self.loss, 0.0))


@dataclass(frozen=True, slots=True)
class Contest:
    """The recordings of one drive; ``base`` is the model without any hypothesis.

    size: what the data at hand say about sizes; None = nothing.
    """

    sides: Sequence[Side]
    base: Vehicle
    size: Size | None = None

    def mimic(self, name: str) -> Mimic | None:
        """The size of an effect that comes nearest to the truth; None: there is no data."""
        if not self.sides:
            return None
        if per_recording(name):
            parts = [Contest([side], self.base)._best(name) for side in self.sides]
            return Mimic(parts[0].values, sum(m.loss for m in parts), parts[0].car,
                         tuple(d for m in parts for d in m.differences))
        return self._best(name)

    def right(self, mimic: Mimic, draw: Callable[[Side], Residuals], repeats: int) -> float:
        """Share of simulated repeats of the drive in which the truth fits better.

        draw: noise for a side. What is free follows it under both hypotheses.
        """
        won = 0
        for _ in range(repeats):
            won += sum(side.worse(draw(side), d)
                       for side, d in zip(self.sides, mimic.differences, strict=True)
                       ) + mimic.elsewhere > 0.0
        return won / repeats

    def _best(self, name: str) -> Mimic:
        found = [self._along(name, q) for q in scanned_parameters(catalogue()[name])]
        return min(found, key=lambda m: m.loss)

    def cost(self, name: str, q: Parameter, k: float) -> float:
        """Robust loss by which an effect of that size is worse than the truth, here alone."""
        try:
            p = apply(self.base, name, **{q.name: k})
        except ConfigError:  # the effect leads out of what a car can be
            return math.inf
        return sum(side.loss(p) for side in self.sides)

    def _along(self, name: str, q: Parameter) -> Mimic:
        def elsewhere(k: float) -> float:
            return self.size(name, q.name, k) if self.size is not None else 0.0

        best = lowest(lambda k: self.cost(name, q, k) + elsewhere(k), q)
        values = {q.name: best}
        p = apply(self.base, name, **values)
        return Mimic(values, self.cost(name, q, best) + elsewhere(best),
                     apply(self.sides[0].followed(p), name, **values),
                     tuple(side.difference(p) for side in self.sides), elsewhere(best))


def per_recording(name: str) -> bool:
    """Whether the size of an effect belongs to the recording."""
    return catalogue()[name].parameters[0].per_recording


def lowest(cost: Callable[[float], float], q: Parameter) -> float:
    """Where a cost is lowest: the best of a ladder, then between its neighbours."""
    from scipy.optimize import minimize_scalar

    medium = q.sizes[1]
    ks = sorted({q.null, *(float(np.clip(q.null + side * share * medium, q.low, q.high))
                           for share in LADDER for side in (-1.0, 1.0))})
    # where the data say nothing, nothing is the answer
    costs = [cost(k) + FLAT * abs(k - q.null) / medium for k in ks]
    i = int(np.argmin(costs))
    ends = ks[max(i - 1, 0)], ks[min(i + 1, len(ks) - 1)]
    finer = minimize_scalar(cost, bounds=ends, method="bounded",
                            options={"xatol": TOLERANCE * medium, "maxiter": ROUNDS})
    return float(finer.x) if finer.fun < costs[i] else ks[i]
