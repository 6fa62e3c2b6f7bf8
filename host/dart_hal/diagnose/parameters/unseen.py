"""The losses of any fit on recordings that it has not seen.

When a command was given before its message is of a recording and not of the car: where the
driver's clock and that of the messages differ, every log has another age. So the timing, and it
alone, is fitted to these recordings; what their commands do at ages of their own counts less, as
in the recordings to learn from.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from dart_hal.types import FloatArray, IntArray

from ..evidence.ages import AGES, older
from ..evidence.noise import WAIT, Noise, measure
from ..evidence.residuals import Evidence
from ..evidence.rows import rows_of
from ..evidence.space import Space, Timing
from ..search.fit import QUICK, Point, loss_at, refit
from .sets import Set, Sets


class Unseen:
    """The test recordings: loss of whitened errors by block of any fit, once each."""

    def __init__(self, evidence: Evidence, of: Sets) -> None:
        self._evidence, self._of, self.policy = evidence, of, of.policy.claims
        self._kept: dict[Set, FloatArray] = {}
        self._block: IntArray | None = None

    def losses(self, free: Set) -> FloatArray:
        """(blocks,) with some groups free."""
        if free not in self._kept:
            self._kept[free] = self.of_point(self._of.fit(free))
        return self._kept[free]

    def of_point(self, point: Point) -> FloatArray:
        """(blocks,) of a fit, at the timing that suits these recordings best."""
        noise = self._noise
        r = self._evidence.residuals(point.vehicle, self._timing(point, noise))
        values = noise.loss(noise.whiten(r)[0].ravel())
        if self._block is None:
            rows = rows_of(self._evidence, r, self._of.policy.blocks)
            many = int(rows.recording.max()) + 1 >= self._of.policy.blocks.units
            motion = rows.channel >= 0
            label = (rows.recording if many else rows.block)[motion]
            self._block = np.unique(label, return_inverse=True)[1].ravel()
        return np.asarray(np.bincount(self._block, values), dtype=np.float64)

    @cached_property
    def _noise(self) -> Noise:
        """That of the last fit, with the windows of these recordings."""
        evidence, point, policy = self._evidence, self._of.full, self._of.policy
        noise = replace(point.noise, certain=1.0)
        timing = self._timing(point, noise)
        r = evidence.residuals(point.vehicle, timing)
        moved = older(evidence, point.vehicle, timing, r, policy.noise.age_s)
        here = measure(r, evidence.blocks(policy.blocks.seconds), evidence.overlap, moved,
                       policy.noise, WAIT if evidence.commands_stamped else None)
        return replace(noise, certain=here.certain)

    def _timing(self, point: Point, noise: Noise) -> Timing:
        """Of these recordings, the parameters as they were fitted."""
        evidence, p = self._evidence, point.vehicle
        space = Space(p, (), late=evidence.late, policy=self._of.policy.prior)
        starts = [space.start(p, t) for t in (point.timing, *(
            replace(point.timing, command_age=age, spread=spread) for age, spread in AGES))]
        x = min(starts, key=lambda z: loss_at(evidence, noise, space, z))
        held = slice(len(space.names))
        space.low[held] = space.high[held] = x[held]
        return refit(evidence, noise, space, x, rounds=QUICK).timing
