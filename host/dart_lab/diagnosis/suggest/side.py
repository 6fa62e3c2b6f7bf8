"""Comparison of hypotheses on one recording, with parameters that are fitted to the wrong one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evidence.noise import Noise
from dart_lab.identification.evidence.policy import PriorPolicy
from dart_lab.identification.evidence.residuals import Residuals
from dart_lab.identification.evidence.space import MessageTiming, Space
from dart_lab.identification.objective import Point, evaluate_point

from ..policy import USUAL


class RecordingComparison:
    """The evidence of one recording, the true car, and the base that is fitted to a confounder.

    free, known: names of base parameters and their standard errors, as for ``Space``.
    """

    def __init__(self, evidence: Any, noise: Noise, base: Vehicle, truth: Vehicle,
                 free: Sequence[str], known: Mapping[str, float], timing: MessageTiming,
                 policy: PriorPolicy = USUAL.prior) -> None:
        self.evidence = evidence
        self.noise = noise
        self._timing = timing
        space = Space(base, free, known, policy=policy)
        self.point: Point = evaluate_point(evidence, noise, space, space.point(timing))
        self._true = self._residual(truth)

    def difference(self, p: Vehicle) -> FloatArray:
        """Prediction of p minus that of the true car, whitened, (N,)."""
        return self._residual(p) - self._true

    def loss(self, p: Vehicle) -> float:
        """Robust loss of p relative to the true car, after a step of the free coordinates."""
        r = self.difference(p)
        point = self.point
        move = point.best_step(r)
        prior_change = point.prior_loss(move) - point.prior_loss(np.zeros_like(move))
        return float(point.weight @ self.noise.loss(r + point.jacobian @ move)) + prior_change

    def fit_base(self, p: Vehicle) -> Vehicle:
        """Fit the base to p by one linear step."""
        space = self.point.space
        x = self.point.x + self.point.best_step(self.difference(p))
        return space.split(np.clip(x, space.low, space.high))[0]

    def loss_increase(self, noise: Residuals, difference: FloatArray) -> float:
        """Change of the robust loss of noise [SI units] by adding ``difference`` (N,)."""
        x = self.noise.stack(noise)[0]
        return self._fitted_loss(x + difference) - self._fitted_loss(x)

    def _fitted_loss(self, x: FloatArray) -> float:
        """Robust loss of residuals after the linear step."""
        return float(self.point.weight @ self.noise.loss(self.point.residual_after_step(x)))

    def _residual(self, p: Vehicle) -> FloatArray:
        """Whitened residuals (N,) of a vehicle."""
        return self.noise.stack(self.evidence.residuals(p, self._timing))[0]
