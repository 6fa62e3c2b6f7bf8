"""One recording as two hypotheses see it, and what is free to follow the wrong one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle

from ..evidence.noise import Noise
from ..evidence.residuals import Residuals
from ..evidence.space import MessageTiming, Space
from ..policy import USUAL, PriorPolicy
from ..search.fit import Point, evaluate_point


class Side:
    """The evidence of one recording, the truth about it, and the base that follows a confounder.

    free, known: names of base parameters and their standard errors, as for ``Space``.
    """

    def __init__(self, evidence: Any, noise: Noise, base: Vehicle, truth: Vehicle,
                 free: Sequence[str], known: Mapping[str, float], timing: MessageTiming,
                 policy: PriorPolicy = USUAL.prior) -> None:
        self.evidence, self.noise, self._timing = evidence, noise, timing
        space = Space(base, free, known, policy=policy)
        self.point: Point = evaluate_point(evidence, noise, space, space.point(timing))
        self._true = self._residual(truth)

    def difference(self, p: Vehicle) -> FloatArray:
        """What p says minus what the truth says (N,), whitened."""
        return self._residual(p) - self._true

    def loss(self, p: Vehicle) -> float:
        """Robust loss by which p is worse, once all that is free has followed."""
        r, point = self.difference(p), self.point
        move = point.best_step(r)
        moved = point.prior_loss(move) - point.prior_loss(np.zeros_like(move))
        return float(point.weight @ self.noise.loss(r + point.jacobian @ move)) + moved

    def followed(self, p: Vehicle) -> Vehicle:
        """The base as it follows p."""
        space = self.point.space
        x = self.point.x + self.point.best_step(self.difference(p))
        return space.split(np.clip(x, space.low, space.high))[0]

    def worse(self, noise: Residuals, more: FloatArray) -> float:
        """Robust loss of noise [SI units] with ``more`` on it (N,), less that of the noise."""
        x = self.noise.stack(noise)[0]
        return self._left(x + more) - self._left(x)

    def _left(self, x: FloatArray) -> float:
        return float(self.point.weight @ self.noise.loss(self.point.residual_after_step(x)))

    def _residual(self, p: Vehicle) -> FloatArray:
        return self.noise.stack(self.evidence.residuals(p, self._timing))[0]
