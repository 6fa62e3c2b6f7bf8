"""Losses of any fit on recordings that no fit used.

The age of a command belongs to a recording and not to the car: where the clocks of the driver and
of the messages differ, each log has another age. So the timing, and nothing else, is fitted to
these recordings. Read-outs that depend on the age of a single command have less weight, as in the
training recordings.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np

from dart_hal.core.timing import PWM_WAIT_STD
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evidence.ages import START_AGES, age_sensitivity
from dart_lab.identification.evidence.noise import Noise, estimate_noise
from dart_lab.identification.evidence.residuals import Evidence, Residuals
from dart_lab.identification.evidence.rows import label_rows
from dart_lab.identification.evidence.space import MESSAGE_AGE_REACH, MessageTiming, Space
from dart_lab.identification.objective import (
    MAX_REUSE_ITERATIONS,
    FittedModel,
    Point,
    loss_at,
    refit,
)

from ..policy import Policy
from ..result import Cost
from .cost import loss_ratio

# Time by which an age may leave its range here, where delays are fixed [s]. A fit divides a time
# into delay and age with some error: two standard errors of 5 ms, as files state for a delay.
AGE_TOLERANCE_S = 0.010


class RecordingLosses:
    """Losses of whitened errors of any fit on recordings, by stretch (or whole recording)."""

    def __init__(self, evidence: Evidence, last: Point, policy: Policy) -> None:
        """last: the fit whose noise weighs the errors of all."""
        self._evidence = evidence
        self._policy = policy
        self.last = last
        self._timings: dict[tuple[Vehicle, MessageTiming], MessageTiming] = {}

    def motion(self, point: Point) -> FloatArray:
        """Compute the losses (stretches,) of the motion, with equal weight for all read-outs."""
        r = self._evidence.residuals(point.vehicle, self.timing(point))
        return self._sum_by_stretch(r, self._noise.loss(self._noise.whiten(r)[0].ravel()))

    def compute_costs(self, fit: Point, removed: Mapping[str, Point]) -> dict[str, Cost]:
        """Compare the errors of fits without one effect each with those of the fit with all."""
        with_all = self.everything(fit)
        return {name: loss_ratio(with_all, self.everything(point))
                for name, point in removed.items()}

    def everything(self, point: Point) -> FloatArray:
        """Compute the losses (stretches,) of motion and sensors, weighted as in the fits."""
        r = self._evidence.residuals(point.vehicle, self.timing(point))
        residual, weight = self._noise.stack(r)
        return self._sum_by_stretch(r, weight * self._noise.loss(residual))

    def timing(self, point: FittedModel) -> MessageTiming:
        """Return the timing that suits these recordings best; it is cached for each fit."""
        key = point.vehicle, point.timing
        if key not in self._timings:
            self._timings[key] = self._fit_timing(point, self._noise)
        return self._timings[key]

    def _sum_by_stretch(self, r: Residuals, losses: FloatArray) -> FloatArray:
        """Sum losses by stretch; of many recordings by recording."""
        rows = label_rows(self._evidence, r, self._policy.claims.stretch_s)
        block = np.unique(rows.unit[:len(losses)], return_inverse=True)[1].ravel()
        return np.asarray(np.bincount(block, losses), dtype=np.float64)

    @cached_property
    def _noise(self) -> Noise:
        """Noise of the last fit, with the age scale of the windows of these recordings."""
        evidence = self._evidence
        point = self.last
        policy = self._policy
        noise = replace(point.noise, age_scale=1.0)
        timing = self._fit_timing(point, noise)
        r = evidence.residuals(point.vehicle, timing)
        sensitivity = age_sensitivity(evidence, point.vehicle, timing, r, policy.noise.age_s)
        here = estimate_noise(r, evidence.blocks(), evidence.overlap,
                              sensitivity, policy.noise,
                              PWM_WAIT_STD if evidence.commands_stamped else None)
        return replace(noise, age_scale=here.age_scale)

    def _fit_timing(self, point: FittedModel, noise: Noise) -> MessageTiming:
        """Fit the timing of these recordings, with the parameters fixed.

        The loss has several minima over the age of commands, so the best of START_AGES starts.
        """
        evidence = self._evidence
        p = point.vehicle
        space = Space(p, (), message_age=evidence.message_age, policy=self._policy.prior)
        starts = [space.start(p, t) for t in (point.timing, *(
            replace(point.timing, command_age=age, age_spread=spread)
            for age, spread in START_AGES))]
        x = min(starts, key=lambda z: loss_at(evidence, noise, space, z))
        n = len(space.names)
        space.low[:n] = x[:n]
        space.high[:n] = x[:n]
        space.low[n + 1] -= AGE_TOLERANCE_S / MESSAGE_AGE_REACH
        space.high[n + 1] += AGE_TOLERANCE_S / MESSAGE_AGE_REACH
        return refit(evidence, noise, space, x, max_iterations=MAX_REUSE_ITERATIONS).timing
