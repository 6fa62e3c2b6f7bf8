"""What the data at hand say about the size of each hypothesis."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from dart_hal.vehicle.effect import Parameter
from dart_hal.vehicle.effects import catalogue

from ..search.size_search import scanned_parameters
from .contest import LADDER, Contest, per_recording

NEAR = (0.02, 0.05, *LADDER)  # of the medium size, to both sides of the best


class Sizes:
    """Callable as ``contest.Size``: a curve through the losses at some sizes.

    contest: on the data at hand; best: size by effect and parameter. A size
    that belongs to the recording costs nothing on another one.
    """

    def __init__(self, contest: Contest, best: Mapping[str, Mapping[str, float]]) -> None:
        self._curves: dict[tuple[str, str], Callable[[float], float]] = {}
        for name, values in best.items():
            for q in () if per_recording(name) else scanned_parameters(catalogue()[name]):
                self._curves[name, q.name] = _curve(contest, name, q, values.get(q.name, q.null))

    def __call__(self, name: str, parameter: str, value: float) -> float:
        curve = self._curves.get((name, parameter))
        return curve(value) if curve is not None else 0.0


def _curve(contest: Contest, name: str, q: Parameter, best: float) -> Callable[[float], float]:
    """Above its lowest point; flat beyond its ends."""
    ks = sorted({q.null, best, *(float(np.clip(best + side * share * q.sizes[1], q.low, q.high))
                                 for share in NEAR for side in (-1.0, 1.0))})
    found = [(k, c) for k in ks if math.isfinite(c := contest.cost(name, q, k))]
    k, costs = np.array(found).T
    root = np.sqrt(costs - costs.min())  # of a parabola: straight to both sides of the lowest
    return lambda value: float(np.interp(value, k, root))**2
