"""Loss of the sizes of each hypothesis on the data at hand."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from dart_hal.vehicle.effect import Parameter
from dart_hal.vehicle.effects import effect_for

from ..search.size_search import scanned_parameters
from .contest import SIZE_LADDER, DriveComparison, is_per_recording

SIZE_OFFSETS = (0.02, 0.05, *SIZE_LADDER)  # multiples of the medium size, on both sides


class SizeLossCurves:
    """Curves through the losses at some sizes, callable as ``contest.SizeLoss``.

    comparison: on the data at hand. best: size by effect and parameter. A size that may differ
    between recordings has no loss on another recording.
    """

    def __init__(self, comparison: DriveComparison, best: Mapping[str, Mapping[str,
                                                                               float]]) -> None:
        self._curves: dict[tuple[str, str], Callable[[float], float]] = {}
        for name, values in best.items():
            for q in () if is_per_recording(name) else scanned_parameters(
                    effect_for(comparison.base, name)):
                self._curves[name, q.name] = _curve(comparison, name, q, values.get(q.name, q.null))

    def __call__(self, name: str, parameter: str, value: float) -> float:
        curve = self._curves.get((name, parameter))
        return curve(value) if curve is not None else 0.0


def _curve(comparison: DriveComparison, name: str, q: Parameter, best: float) -> Callable[[float],
                                                                                          float]:
    """Interpolate the loss above its minimum; constant beyond the ends."""
    ks = sorted({q.null, best, *(float(np.clip(best + sign * share * q.sizes[1], q.low, q.high))
                                 for share in SIZE_OFFSETS for sign in (-1.0, 1.0))})
    found = [(k, c) for k in ks if math.isfinite(c := comparison.loss_of_size(name, q, k))]
    k, costs = np.array(found).T
    root = np.sqrt(costs - costs.min())  # the root of a parabola is linear on both sides of it
    return lambda value: float(np.interp(value, k, root))**2
