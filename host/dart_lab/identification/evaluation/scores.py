"""Figures of merit: RMSE and median per channel, per recording and pooled.

Each is computed over windows at the end of a horizon. The median of |e| is added because a few
windows with a spin dominate the RMSE.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dart_hal.core.types import FloatArray
from dart_lab.identification.prediction.windows import HORIZONS

from .cases import Case
from .prediction import CHANNELS

Numbers = dict[str, float]


@dataclass(frozen=True, slots=True)
class Score:
    """Errors (horizons, 5, windows) of one model, and the windows of each recording."""

    errors: FloatArray
    slices: dict[str, slice]

    def rmse(self, horizon: float = 1.0, file: str | None = None) -> Numbers:
        """Compute the RMSE by channel; ``file`` None = pooled over all windows."""
        return _by_channel(rms(self._select_errors(horizon, file)))

    def median(self, horizon: float = 1.0, file: str | None = None) -> Numbers:
        """Compute the median of the absolute error by channel."""
        return _by_channel(np.median(np.abs(self._select_errors(horizon, file)), axis=-1))

    def to_json(self) -> dict[str, Any]:
        """Return {"0.5": {"pooled", "median", "by_file"}, "1.0": .., "2.0": ..}; each with n."""
        return {f"{h:.1f}": self._horizon(h) for h in HORIZONS}

    def _horizon(self, h: float) -> dict[str, Any]:
        by_file = {file: {**self._part(h, file), "median": self.median(h, file)}
                   for file in self.slices}
        return {"pooled": self._part(h, None), "median": self.median(h), "by_file": by_file}

    def _part(self, h: float, file: str | None) -> dict[str, Any]:
        e = self._select_errors(h, file)
        part: dict[str, Any] = {**_by_channel(rms(e)), "n": e.shape[-1]}
        lost = int((~np.isfinite(e).all(axis=0)).sum())
        return {**part, "diverged": lost} if lost else part

    def _select_errors(self, horizon: float, file: str | None) -> FloatArray:
        e: FloatArray = self.errors[HORIZONS.index(horizon)]
        return e if file is None else e[:, self.slices[file]]


def score(errors: FloatArray, cases: Sequence[Case]) -> Score:
    """Make the score of ``prediction.errors`` (horizons, 5, windows) of these recordings."""
    slices = {}
    at = 0
    for case in cases:
        slices[case.file] = slice(at, at + len(case))
        at += len(case)
    return Score(errors, slices)


def rms(errors: FloatArray) -> FloatArray:
    """Compute the root mean square over the last axis; infinite if one error is."""
    return np.asarray(np.sqrt(np.mean(np.square(errors), axis=-1)))


def _by_channel(values: FloatArray) -> Numbers:
    return {name: float(v) for name, v in zip(CHANNELS, values, strict=True)}
