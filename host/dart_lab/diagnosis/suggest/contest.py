"""Comparison of two hypotheses on one drive: how well the wrong one can imitate the right one.

The data are predictions of the true car. The confounder may have any size that fits the data at
hand. Base parameters and timing are fitted to it, to first order. The remaining loss is the
expected loss difference in a diagnosis with both, independent of the noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.errors import ConfigError
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.effect import Parameter
from dart_hal.vehicle.effects import apply, catalogue, effect_for
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evidence.residuals import Residuals

from ..search.size_search import scanned_parameters
from .side import RecordingComparison

SIZE_LADDER = (0.1, 0.35, 1.0, 2.2, 5.0)  # of the medium size
SIZE_TOLERANCE = 0.01  # of the medium size
MAX_SIZE_ITERATIONS = 12
NULL_PREFERENCE = 1e-3  # loss per medium size: without information the size is zero
# (effect, parameter, value) -> robust loss of this size on other data.
SizeLoss = Callable[[str, str, float], float]


@dataclass(frozen=True, slots=True)
class FittedConfounder:
    """A confounder at its best size. loss: robust loss that the true hypothesis saves.

    values: its size, that of the first recording if each has its own. car: the base fitted to it,
    with the confounder. differences: (N,) of each recording, before anything is fitted. other_loss:
    part of the loss from other data.
    """

    values: Mapping[str, float]
    loss: float
    car: Vehicle
    differences: tuple[FloatArray, ...]
    other_loss: float = 0.0

    @property
    def separation(self) -> float:
        """Separation from the true hypothesis, in standard deviations."""
        return math.sqrt(max(self.loss, 0.0))


@dataclass(frozen=True, slots=True)
class DriveComparison:
    """The recordings of one drive. base: the model without any hypothesis.

    size_loss: loss of sizes on the data at hand; None if there is none.
    """

    recordings: Sequence[RecordingComparison]
    base: Vehicle
    size_loss: SizeLoss | None = None

    def fit_confounder(self, name: str) -> FittedConfounder | None:
        """Fit the size of an effect to the true hypothesis; None if there are no data."""
        if not self.recordings:
            return None
        if is_per_recording(name):
            parts = [DriveComparison([recording], self.base)._fit_best(name)
                     for recording in self.recordings]
            return FittedConfounder(parts[0].values, sum(m.loss for m in parts), parts[0].car,
                         tuple(d for m in parts for d in m.differences))
        return self._fit_best(name)

    def correct_share(self, fitted: FittedConfounder, draw: Callable[[RecordingComparison],
                                                                     Residuals],
                      repeats: int) -> float:
        """Share of simulated repeats of the drive in which the true hypothesis fits better.

        draw: noise for a recording. Free coordinates are fitted under both hypotheses.
        """
        correct = 0
        for _ in range(repeats):
            correct += sum(recording.loss_increase(draw(recording), d)
                       for recording, d in zip(self.recordings, fitted.differences, strict=True)
                       ) + fitted.other_loss > 0.0
        return correct / repeats

    def _fit_best(self, name: str) -> FittedConfounder:
        """Fit each parameter of an effect alone, and return the best."""
        effect = effect_for(self.base, name)
        found = [self._fit_parameter(name, q) for q in scanned_parameters(effect)]
        return min(found, key=lambda m: m.loss)

    def loss_of_size(self, name: str, q: Parameter, k: float) -> float:
        """Robust loss of an effect of that size relative to the truth, on this drive."""
        try:
            p = apply(self.base, name, **{q.name: k})
        except ConfigError:  # the vehicle has no valid parameters with this size
            return math.inf
        return sum(recording.loss(p) for recording in self.recordings)

    def _fit_parameter(self, name: str, q: Parameter) -> FittedConfounder:
        """Fit one parameter of an effect."""
        def other_loss(k: float) -> float:
            return self.size_loss(name, q.name, k) if self.size_loss is not None else 0.0

        best = find_minimum(lambda k: self.loss_of_size(name, q, k) + other_loss(k), q)
        values = {q.name: best}
        p = apply(self.base, name, **values)
        return FittedConfounder(values, self.loss_of_size(name, q, best) + other_loss(best),
                                apply(self.recordings[0].fit_base(p), name, **values),
                                tuple(recording.difference(p) for recording in self.recordings),
                                other_loss(best))


def is_per_recording(name: str) -> bool:
    """Check whether the size of an effect may differ between recordings."""
    return catalogue()[name].parameters[0].per_recording


def find_minimum(cost: Callable[[float], float], q: Parameter) -> float:
    """Minimise a function of a size: the best of a ladder, then a bounded search around it."""
    from scipy.optimize import minimize_scalar

    medium = q.sizes[1]
    ks = sorted({q.null, *(float(np.clip(q.null + sign * share * medium, q.low, q.high))
                           for share in SIZE_LADDER for sign in (-1.0, 1.0))})
    costs = [cost(k) + NULL_PREFERENCE * abs(k - q.null) / medium for k in ks]
    i = int(np.argmin(costs))
    ends = ks[max(i - 1, 0)], ks[min(i + 1, len(ks) - 1)]
    finer = minimize_scalar(cost, bounds=ends, method="bounded",
                            options={"xatol": SIZE_TOLERANCE * medium,
                                     "maxiter": MAX_SIZE_ITERATIONS})
    return float(finer.x) if finer.fun < costs[i] else ks[i]
