"""What each name is worth on the test recordings: all errors without it, and where it shows most.

Every fit is taken at the timing that suits these recordings, and the weight that errors have in the
fits. What is shown of one channel is predicted with commands as old as the log has them.
"""

from __future__ import annotations

from collections.abc import Sequence

from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.effects import catalogue

from .evidence.space import Timing
from .gains import Fitted, Side, gained
from .grade.names import Judged
from .parameters.cost import ratio
from .parameters.unseen import Unseen
from .search.fit import Point
from .search.selection import Settings


def judge(train: Side, test: Side, settings: Settings, unseen: Unseen, names: Sequence[str],
          points: Sequence[Point]) -> list[Judged]:
    """Each name by the fit before it and that with it.

    unseen: the test recordings; points: the base, then with one name more each.
    """
    some = points[:len(names) + 1]
    timings = [unseen.timing(point) for point in some]
    losses = [unseen.everything(*one) for one in zip(some, timings, strict=True)]
    judged = []
    for i, name in enumerate(names):
        ages = points[i + 1].timing, timings[i + 1]
        before, after = (_fitted(points[j], timings[j], ages) for j in (i, i + 1))
        judged.append(Judged(
            ratio(losses[i + 1], losses[i]),
            gained(catalogue()[name], before, after, train, test, settings.seed,
                   settings.policy.conclusion.gain_block_s)))
    return judged


def _fitted(point: Point, test: Timing, ages: tuple[Timing, Timing]) -> Fitted:
    """As it predicts by delays from the log, refitted or not: with the age of commands on top, one
    that is longer than the model's seems to be worse.

    test: timing of those recordings. ages: how old commands are in the logs of train and test; that
    is of the logs, and the same for a fit without an effect and one with it.
    """
    of_train, of_test = (age.advanced(settled(point.vehicle)) for age in ages)
    return Fitted(point.vehicle, (of_train, of_test), (point.timing, test))
