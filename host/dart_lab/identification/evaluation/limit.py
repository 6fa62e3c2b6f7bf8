"""Up to which lateral acceleration and speed the kinematic model holds, with an interval."""

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
    Curve,
    crossing,
    curvature_loss,
    rear_slip,
)

DRAWS, LEAST_RECORDINGS = 1000, 3
"""Bootstrap samples; recordings that an interval needs."""


@dataclass(frozen=True, slots=True)
class Limit:
    """Where one kind of evidence passes its tolerance.

    by: "lateral_acceleration" [m/s2] or "speed" [m/s]; value in it, with the
    95 % interval low, high over recordings. NaN: not reached, or (interval) too
    few recordings, or no upper end. at, pooled, band (bins,), (bins,), (2,
    bins): the median of all curves.
    """

    name: str
    by: str
    tolerance: float
    value: float
    low: float
    high: float
    curves: tuple[Curve, ...]
    at: FloatArray
    pooled: FloatArray
    band: FloatArray

    @property
    def recordings(self) -> int:
        """How many recordings gave a curve."""
        return len({c.file for c in self.curves})

    @property
    def supported(self) -> bool:
        """Whether there is a limit with at least a lower end."""
        return bool(np.isfinite(self.value) and np.isfinite(self.low))

    def own(self, c: Curve) -> tuple[float, float]:
        """(lateral acceleration [m/s2], speed [m/s]) at which one curve passes the tolerance."""
        x = crossing(c.at, c.value, self.tolerance)
        if not np.isfinite(x):
            return np.nan, np.nan
        known = np.isfinite(c.value)
        accel, speed = (float(np.interp(x, c.at[known], v[known])) for v in (c.accel, c.speed))
        return accel, speed

    def spread(self) -> tuple[float, float]:
        """Standard deviation over curves of their own limits in (lateral acceleration, speed),
        each relative to its mean: the smaller one is the variable that matters."""
        own = np.array([self.own(c) for c in self.curves]).reshape(-1, 2)
        own = own[np.isfinite(own[:, 0])]
        if len(own) < LEAST_RECORDINGS:
            return np.nan, np.nan
        accel, speed = own.std(axis=0) / own.mean(axis=0)
        return float(accel), float(speed)

    def to_json(self) -> dict[str, Any]:
        """rad or shares, m/s2, m/s; null where the data do not tell."""
        accel, speed = self.spread()
        return {
            "tolerance": self.tolerance, "by": self.by, "value": self.value,
            "ci95": [self.low, self.high], "recordings": self.recordings,
            "spread": {"lateral_acceleration": accel, "speed": speed},
            "scatter": _median([c.scatter for c in self.curves]),
            "zero_std": float(np.std([c.zero for c in self.curves])) if self.curves else np.nan,
            "bins": [{self.by: a, "value": v, "ci95": [lo, hi]} for a, v, lo, hi in
                     zip(self.at, self.pooled, *self.band, strict=True) if np.isfinite(v)],
            "by_recording": [self._curve(c) for c in self.curves]}

    def _curve(self, c: Curve) -> dict[str, Any]:
        accel, speed = self.own(c)
        return {"file": c.file, "side": "left" if c.side > 0 else "right", "steering": c.level,
                "curvature": c.curvature, "lateral_acceleration": accel, "speed": speed}


def find_limits(cases: Sequence[Case], l_r: float, seed: int = 0) -> tuple[Limit, Limit]:
    """(rear slip by lateral acceleration, curvature loss by speed). l_r [m]: of the grids."""
    return (_limit("rear_slip", "lateral_acceleration", rear_slip(cases, l_r), SLIP_TOLERANCE,
                   seed),
            _limit("curvature_loss", "speed", curvature_loss(cases, l_r), CURVATURE_TOLERANCE,
                   seed))


def _limit(name: str, by: str, curves: Sequence[Curve], tolerance: float, seed: int) -> Limit:
    if not curves:
        none = np.empty(0)
        return Limit(name, by, tolerance, np.nan, np.nan, np.nan, (), none, none,
                     np.empty((2, 0)))
    at, value = np.stack([c.at for c in curves]), np.stack([c.value for c in curves])
    where, pooled = _nan(np.nanmean, at), _nan(np.nanmedian, value)
    low, high, band = _interval(curves, at, value, tolerance, seed)
    return Limit(name, by, tolerance, crossing(where, pooled, tolerance), low, high,
                 tuple(curves), where, pooled, band)


def _interval(curves: Sequence[Curve], at: FloatArray, value: FloatArray, tolerance: float,
              seed: int) -> tuple[float, float, FloatArray]:
    """(low, high, band of the pooled curve) by drawing whole recordings."""
    files = sorted({c.file for c in curves})
    band = np.full((2, at.shape[1]), np.nan)
    if len(files) < LEAST_RECORDINGS:
        return np.nan, np.nan, band
    rows = [np.array([i for i, c in enumerate(curves) if c.file == f]) for f in files]
    rng = np.random.default_rng(seed)
    found, lines = [], []
    for _ in range(DRAWS):
        pick = np.concatenate([rows[i] for i in rng.integers(0, len(files), len(files))])
        line = _nan(np.nanmedian, value[pick])
        lines.append(line)
        found.append(crossing(_nan(np.nanmean, at[pick]), line, tolerance))
    ends = np.nan_to_num(np.array(found), nan=np.inf)
    low, high = np.quantile(ends, (0.025, 0.975), method="nearest")
    band = _nan(partial(np.nanquantile, q=(0.025, 0.975)), np.stack(lines))
    return (float(low) if np.isfinite(low) else np.nan,
            float(high) if np.isfinite(high) else np.nan, band)


def _nan(of: Callable[..., Any], values: FloatArray) -> FloatArray:
    """A statistic over curves that leaves bins without data NaN, silently."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.asarray(of(values, axis=0))


def _median(values: Sequence[float]) -> float:
    known = [v for v in values if np.isfinite(v)]
    return float(np.median(known)) if known else np.nan
