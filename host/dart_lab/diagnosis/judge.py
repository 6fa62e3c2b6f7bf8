"""What causes are worth on the test recordings: all errors without each, and where each shows most.

Every fit is taken at the timing that suits these recordings, and the weight that errors have in the
fits. What is shown of one channel is of the same predictions as the table of errors step by step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.parameters import Vehicle

from .gains import Fitted, Side, gained
from .parameters.cost import ratio
from .parameters.unseen import Unseen
from .result import Cost, Gained
from .search.fit import FittedModel, Point
from .search.selection import Settings

Predictor = Callable[[FittedModel], tuple[Vehicle, Vehicle]]
"""The vehicles of a fit, as they predict from the logs of the train and the test recordings."""


def compute_costs(unseen: Unseen, fit: Point, without: Mapping[str, Point]) -> dict[str, Cost]:
    """Compare the errors of fits without one effect each with those of the fit with all of them."""
    def losses(point: Point) -> FloatArray:
        return unseen.everything(point, unseen.timing(point))

    with_all = losses(fit)
    return {name: ratio(with_all, losses(point)) for name, point in without.items()}


def compute_gains(train: Side, test: Side, settings: Settings, unseen: Unseen,
                  predicting: Predictor, names: Sequence[str], points: Sequence[FittedModel]
                  ) -> list[Gained]:
    """Compute what each effect gains in the channel where it shows most.

    unseen: the test recordings; predicting: the vehicles of a fit as they predict from the logs;
    points: the base, then with one effect more each.
    """
    fits = [Fitted(point.vehicle, predicting(point), (point.timing, unseen.timing(point)),
                   settings.refit)
            for point in points[:len(names) + 1]]
    return [gained(catalogue()[name], before, after, train, test, settings.seed,
                   settings.policy.conclusion.gain_block_s)
            for name, before, after in zip(names, fits[:-1], fits[1:], strict=True)]
