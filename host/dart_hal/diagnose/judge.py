"""What each name is worth on the test recordings: all errors without it, and where it shows most.

Every fit is taken at the timing that suits these recordings, and the weight that errors have in the
fits. What is shown of one channel is of the same predictions as the table of errors step by step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.parameters import Vehicle

from .gains import Fitted, Side, gained
from .grade.names import Judged
from .parameters.cost import ratio
from .parameters.unseen import Unseen
from .search.fit import Point
from .search.selection import Settings

Predictor = Callable[[Point], tuple[Vehicle, Vehicle]]
"""The vehicles of a fit, as they predict from the logs of the train and the test recordings."""


def judge(train: Side, test: Side, settings: Settings, unseen: Unseen,
          predicting: Predictor, names: Sequence[str],
          points: Sequence[Point]) -> list[Judged]:
    """Each name by the fit before it and that with it.

    unseen: the test recordings; predicting: the vehicles of a fit as they predict from the logs;
    points: the base, then with one name more each.
    """
    some = points[:len(names) + 1]
    timings = [unseen.timing(point) for point in some]
    losses = [unseen.everything(*one) for one in zip(some, timings, strict=True)]
    fits = [Fitted(point.vehicle, predicting(point), (point.timing, timing), settings.refit)
            for point, timing in zip(some, timings, strict=True)]
    return [Judged(ratio(losses[i + 1], losses[i]),
                   gained(catalogue()[name], fits[i], fits[i + 1], train, test, settings.seed,
                          settings.policy.conclusion.gain_block_s))
            for i, name in enumerate(names)]
