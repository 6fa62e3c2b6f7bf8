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

from dart_hal.core.timing import PWM_WAIT_STD
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle

from ..evidence.ages import START_AGES, age_sensitivity
from ..evidence.noise import Noise, estimate_noise
from ..evidence.residuals import Evidence, Residuals
from ..evidence.rows import label_rows
from ..evidence.space import MESSAGE_AGE_REACH, MessageTiming, Space
from ..policy import MANY_RECORDINGS, Policy
from ..search.fit import MAX_REUSE_ITERATIONS, FittedModel, Point, loss_at, refit

BEYOND = 0.010
"""s, by which an age may leave its range here, where delays are held: how a fit divides a time into
delay and age is uncertain, by two standard errors of the 5 ms that files state of a delay."""


class Unseen:
    """The test recordings: loss of whitened errors of any fit, by stretch (or whole recording)."""

    def __init__(self, evidence: Evidence, last: Point, policy: Policy) -> None:
        """last: the fit whose noise weighs the errors of all."""
        self._evidence, self._policy, self.last = evidence, policy, last
        self._timings: dict[tuple[Vehicle, MessageTiming], MessageTiming] = {}

    def motion(self, point: Point) -> FloatArray:
        """(stretches,) of the motion alone, every read-out alike."""
        r = self._evidence.residuals(point.vehicle, self.timing(point))
        return self._by_stretch(r, self._noise.loss(self._noise.whiten(r)[0].ravel()))

    def everything(self, point: Point, timing: MessageTiming) -> FloatArray:
        """(stretches,) of motion and sensors, weighted as in the fits; timing: as ``timing``."""
        r = self._evidence.residuals(point.vehicle, timing)
        residual, weight = self._noise.stack(r)
        return self._by_stretch(r, weight * self._noise.loss(residual))

    def timing(self, point: FittedModel) -> MessageTiming:
        """That which suits these recordings best; of each fit found once."""
        key = point.vehicle, point.timing
        if key not in self._timings:
            self._timings[key] = self._timing(point, self._noise)
        return self._timings[key]

    def _by_stretch(self, r: Residuals, losses: FloatArray) -> FloatArray:
        stretches = replace(self._policy.blocks, seconds=self._policy.claims.stretch_s)
        rows = label_rows(self._evidence, r, stretches)
        many = int(rows.recording.max()) + 1 >= MANY_RECORDINGS
        label = (rows.recording if many else rows.block)[:len(losses)]
        block = np.unique(label, return_inverse=True)[1].ravel()
        return np.asarray(np.bincount(block, losses), dtype=np.float64)

    @cached_property
    def _noise(self) -> Noise:
        """That of the last fit, with the windows of these recordings."""
        evidence, point, policy = self._evidence, self.last, self._policy
        noise = replace(point.noise, age_scale=1.0)
        timing = self._timing(point, noise)
        r = evidence.residuals(point.vehicle, timing)
        moved = age_sensitivity(evidence, point.vehicle, timing, r, policy.noise.age_s)
        here = estimate_noise(r, evidence.blocks(policy.blocks.seconds), evidence.overlap, moved,
                       policy.noise, PWM_WAIT_STD if evidence.commands_stamped else None)
        return replace(noise, age_scale=here.age_scale)

    def _timing(self, point: FittedModel, noise: Noise) -> MessageTiming:
        """Of these recordings, the parameters as they were fitted."""
        evidence, p = self._evidence, point.vehicle
        space = Space(p, (), message_age=evidence.message_age, policy=self._policy.prior)
        starts = [space.start(p, t) for t in (point.timing, *(replace(point.timing, command_age=age,
                                                                      age_spread=spread) for age,
                                                              spread in START_AGES))]
        x = min(starts, key=lambda z: loss_at(evidence, noise, space, z))
        held, age = slice(len(space.names)), len(space.names) + 1
        space.low[held] = space.high[held] = x[held]
        space.low[age] -= BEYOND / MESSAGE_AGE_REACH
        space.high[age] += BEYOND / MESSAGE_AGE_REACH
        return refit(evidence, noise, space, x, max_iterations=MAX_REUSE_ITERATIONS).timing
