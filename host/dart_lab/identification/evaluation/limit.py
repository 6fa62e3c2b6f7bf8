"""Lateral acceleration and speed up to which the kinematic model holds, with an interval.

1. The curves of all recordings are averaged bin by bin (median).
2. The limit is where this median exceeds the tolerance.
3. Its 95 % interval is a bootstrap over whole recordings.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from dart_hal.core.types import FloatArray

from .cases import Case
from .noslip import (
    CURVATURE_TOLERANCE,
    SLIP_TOLERANCE,
    EvidenceCurve,
    crossing,
    curvature_loss,
    rear_slip,
)

# Samples of the bootstrap.
LIMIT_DRAWS = 1000
# Recordings that an interval needs.
MIN_RECORDINGS = 3


@dataclass(frozen=True, slots=True)
class ToleranceLimit:
    """Where one kind of evidence exceeds its tolerance.

    by: "lateral_acceleration" [m/s2] or "speed" [m/s]; value: the limit in it; low, high: its
    95 % interval over recordings. NaN: not reached, or (interval) too few recordings, or no upper
    end. bin_means, pooled (bins,): median of all curves over the means of the bins; band (2,
    bins): its 95 % interval.
    """

    name: str
    by: str
    tolerance: float
    value: float
    low: float
    high: float
    curves: tuple[EvidenceCurve, ...]
    bin_means: FloatArray
    pooled: FloatArray
    band: FloatArray

    @property
    def recordings(self) -> int:
        """Number of recordings with a curve."""
        return len({c.file for c in self.curves})

    @property
    def is_supported(self) -> bool:
        """Whether there is a limit with at least a lower end."""
        return bool(np.isfinite(self.value) and np.isfinite(self.low))

    def find_curve_limit(self, c: EvidenceCurve) -> tuple[float, float]:
        """Find (lateral acceleration [m/s2], speed [m/s]) where a curve exceeds the tolerance."""
        x = crossing(c.bin_values, c.value, self.tolerance)
        if not np.isfinite(x):
            return np.nan, np.nan
        known = np.isfinite(c.value)
        accel, speed = (float(np.interp(x, c.bin_values[known], v[known])) for v
                        in (c.accel, c.speed))
        return accel, speed

    def spread(self) -> tuple[float, float]:
        """Return the relative standard deviation of the limits of the curves.

        In (lateral acceleration, speed): the smaller one is the variable that the limit depends on.
        """
        own = np.array([self.find_curve_limit(c) for c in self.curves]).reshape(-1, 2)
        own = own[np.isfinite(own[:, 0])]
        if len(own) < MIN_RECORDINGS:
            return np.nan, np.nan
        accel, speed = own.std(axis=0) / own.mean(axis=0)
        return float(accel), float(speed)

    def to_json(self) -> dict[str, Any]:
        """Return the limit and its curves in rad or shares, m/s2, m/s; null if unknown."""
        accel, speed = self.spread()
        return {
            "tolerance": self.tolerance, "by": self.by, "value": self.value,
            "ci95": [self.low, self.high], "recordings": self.recordings,
            "spread": {"lateral_acceleration": accel, "speed": speed},
            "scatter": _median([c.scatter for c in self.curves]),
            "zero_std": float(np.std([c.zero for c in self.curves])) if self.curves else np.nan,
            "bins": [{self.by: a, "value": v, "ci95": [lo, hi]} for a, v, lo, hi in
                     zip(self.bin_means, self.pooled, *self.band, strict=True) if np.isfinite(v)],
            "by_recording": [self._curve(c) for c in self.curves]}

    def _curve(self, c: EvidenceCurve) -> dict[str, Any]:
        accel, speed = self.find_curve_limit(c)
        return {"file": c.file, "side": "left" if c.side > 0 else "right", "steering": c.level,
                "curvature": c.curvature, "lateral_acceleration": accel, "speed": speed}


def find_limits(cases: Sequence[Case], l_r: float, seed: int = 0
                ) -> tuple[ToleranceLimit, ToleranceLimit]:
    """Find the limits of (rear slip, curvature loss). l_r [m]: of the grids."""
    return (_find_limit("rear_slip", "lateral_acceleration", rear_slip(cases, l_r), SLIP_TOLERANCE,
                        seed),
            _find_limit("curvature_loss", "speed", curvature_loss(cases, l_r), CURVATURE_TOLERANCE,
                        seed))


def _find_limit(name: str, variable: str, curves: Sequence[EvidenceCurve], tolerance: float,
                seed: int) -> ToleranceLimit:
    if not curves:
        none = np.empty(0)
        return ToleranceLimit(name, variable, tolerance, np.nan, np.nan, np.nan, (), none, none,
                              np.empty((2, 0)))
    at = np.stack([c.bin_values for c in curves])
    value = np.stack([c.value for c in curves])
    where = _ignore_empty_bins(np.nanmean, at)
    pooled = _ignore_empty_bins(np.nanmedian, value)
    low, high, band = _bootstrap_interval(curves, at, value, tolerance, seed)
    return ToleranceLimit(name, variable, tolerance, crossing(where, pooled, tolerance), low, high,
                          tuple(curves), where, pooled, band)


def _bootstrap_interval(curves: Sequence[EvidenceCurve], bin_values: FloatArray, value: FloatArray,
                        tolerance: float, seed: int) -> tuple[float, float, FloatArray]:
    """Return (low, high, band of the pooled curve) by a bootstrap over recordings."""
    files = sorted({c.file for c in curves})
    band = np.full((2, bin_values.shape[1]), np.nan)
    if len(files) < MIN_RECORDINGS:
        return np.nan, np.nan, band
    rows = [np.array([i for i, c in enumerate(curves) if c.file == f]) for f in files]
    rng = np.random.default_rng(seed)
    crossings = []
    lines = []
    for _ in range(LIMIT_DRAWS):
        pick = np.concatenate([rows[i] for i in rng.integers(0, len(files), len(files))])
        line = _ignore_empty_bins(np.nanmedian, value[pick])
        lines.append(line)
        crossings.append(crossing(_ignore_empty_bins(np.nanmean, bin_values[pick]), line,
                                  tolerance))
    ends = np.nan_to_num(np.array(crossings), nan=np.inf)
    low, high = np.quantile(ends, (0.025, 0.975), method="nearest")
    band = _ignore_empty_bins(partial(np.nanquantile, q=(0.025, 0.975)), np.stack(lines))
    return (float(low) if np.isfinite(low) else np.nan,
            float(high) if np.isfinite(high) else np.nan, band)


def _ignore_empty_bins(statistic: Callable[..., Any], values: FloatArray) -> FloatArray:
    """Compute a statistic over curves; bins without data are NaN, without a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.asarray(statistic(values, axis=0))


def _median(values: Sequence[float]) -> float:
    known = [v for v in values if np.isfinite(v)]
    return float(np.median(known)) if known else np.nan
