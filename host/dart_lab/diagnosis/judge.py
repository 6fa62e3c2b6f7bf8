"""Errors on the test recordings: the cost of each effect, and its gain in one channel.

Each fit predicts at the timing that suits these recordings. ``compute_costs`` weighs all errors as
the fits do. ``compute_gains`` uses the predictions of the table of errors step by step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.parameters import Vehicle

from .gains import Fitted, RecordingSet, measure_gain
from .parameters.cost import loss_ratio
from .parameters.unseen import RecordingLosses
from .result import Cost, ErrorReduction
from .search.fit import FittedModel, Point
from .search.selection import Settings

# Returns the vehicles that predict from the logs of the training and of the test recordings.
Predictor = Callable[[FittedModel], tuple[Vehicle, Vehicle]]


def compute_costs(test: RecordingLosses, fit: Point, removed: Mapping[str, Point]
                  ) -> dict[str, Cost]:
    """Compare the errors of fits without one effect each with those of the fit with all of them."""
    def losses(point: Point) -> FloatArray:
        return test.everything(point, test.timing(point))

    with_all = losses(fit)
    return {name: loss_ratio(with_all, losses(point)) for name, point in removed.items()}


def compute_gains(train: RecordingSet, test: RecordingSet, settings: Settings,
                  losses: RecordingLosses, predictor: Predictor, names: Sequence[str],
                  points: Sequence[FittedModel]) -> list[ErrorReduction]:
    """Compute the gain of each effect in the channel where it changes most.

    losses: the test recordings; points: fits of the base, then with one effect more each.
    """
    fits = [Fitted(point.vehicle, predictor(point), (point.timing, losses.timing(point)),
                   settings.refit)
            for point in points[:len(names) + 1]]
    return [measure_gain(catalogue()[name], reference, changed, train, test, settings.seed)
            for name, reference, changed in zip(names, fits[:-1], fits[1:], strict=True)]
