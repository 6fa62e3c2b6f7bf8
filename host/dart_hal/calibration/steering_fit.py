"""Samples -> steering map with standard errors, in the paper's form, and backlash.

Used for recordings, where levels are often reached from one side only and the
tyres slip: the five-parameter form carries the map, and what the form cannot
follow goes into the standard error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.calibration.samples import LEVEL, SETTLED, Samples
from dart_hal.calibration.steering_map import (
    MIN_LEVELS,
    MIN_SPAN,
    SteeringMap,
    coverage,
    fit_map,
)
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import Estimate, FloatArray

POINT_SPACING = 0.05
MIN_POINTS = 9
MIN_LEVEL_SAMPLES = 5


@dataclass(frozen=True, slots=True)
class SteeringFit:
    """command, angle, angle_std (k,); residual (n,) rad; misfit: what the form lacks [rad]."""

    command: FloatArray
    angle: FloatArray
    angle_std: FloatArray
    form: SteeringMap
    residual: FloatArray
    residual_rms: float
    misfit: float
    backlash: Estimate | None


def fit_steering(samples: Samples) -> SteeringFit:
    """The map over the range of commands in ``samples``.

    Errors: CalibrationFailed when the commands span too little or the fitted
    map does not increase.
    """
    levels, span, rising = coverage(samples)
    low, high = float(samples.command.min()), float(samples.command.max())
    if levels < MIN_LEVELS or span < MIN_SPAN:
        raise CalibrationFailed(
            "the commands cover too little for a steering map",
            found=f"{levels} level(s) from {low:+.2f} to {high:+.2f}",
            expected=f"at least {MIN_LEVELS} levels over a span of {MIN_SPAN}",
            remedy="add recordings with other steering commands")
    if not rising:
        raise _falling()
    form = fit_map(samples)
    residual = samples.angle - form.angle(samples.command)
    misfit = level_misfit(samples, residual)
    points = max(MIN_POINTS, round((high - low) / POINT_SPACING) + 1)
    command = np.round(np.linspace(low, high, points), 9)
    angle = form.angle(command)
    if np.any(np.diff(angle) <= 0.0):
        raise _falling()
    std = np.sqrt(form.std(command) ** 2 + misfit**2)
    weight = samples.weight / samples.weight.sum()
    return SteeringFit(command, angle, std, form, residual,
                       float(np.sqrt(weight @ residual**2)), misfit,
                       backlash_of(samples, residual))


def _falling() -> CalibrationFailed:
    return CalibrationFailed("the steering map does not increase",
                             found="angle falls while the command rises",
                             expected="command +1 = full left, yaw rate positive to the left",
                             likely="yaw rate or steering with the wrong sign in the data",
                             remedy="check the sign of W and of steering in the files")


def level_misfit(samples: Samples, residual: FloatArray) -> float:
    """Rms [rad] by which level means leave the form, beyond the scatter of blocks.

    Neighbouring levels leave it together, so this is no noise that more samples
    would average out.
    """
    means, variances, counts = [], [], []
    key = np.round(samples.command / LEVEL)
    for level in np.unique(key):
        rows = key == level
        if rows.sum() < MIN_LEVEL_SAMPLES:
            continue
        means.append(float(np.average(residual[rows], weights=samples.weight[rows])))
        variances.append(_mean_variance(residual[rows]))
        counts.append(float(rows.sum()))
    if not means:
        return 0.0
    weight = np.array(counts) / sum(counts)
    return float(np.sqrt(max(0.0, weight @ (np.square(means) - np.array(variances)))))


def _mean_variance(values: FloatArray) -> float:
    """Variance of the mean of a series with short memory: batches of 10 samples."""
    batches = max(2, len(values) // 10)
    means = np.array([part.mean() for part in np.array_split(values, batches)])
    return float(means.var(ddof=1) / batches)


def backlash_of(samples: Samples, residual: FloatArray) -> Estimate | None:
    """Width of the loop [rad] from levels reached from both sides; None if there are none.

    Approached from below the wheels lag behind: falling minus rising = width.
    Only samples that have settled count.
    """
    key = np.round(samples.command / LEVEL)
    differences, variances = [], []
    settled = samples.age > SETTLED
    scatter = _block_scatter(samples, residual)
    for level in np.unique(key):
        rising = (key == level) & (samples.direction > 0) & settled
        falling = (key == level) & (samples.direction < 0) & settled
        if rising.sum() < MIN_LEVEL_SAMPLES or falling.sum() < MIN_LEVEL_SAMPLES:
            continue
        differences.append(float(residual[falling].mean() - residual[rising].mean()))
        variances.append(scatter**2 * (1.0 / len(np.unique(samples.block[falling]))
                                       + 1.0 / len(np.unique(samples.block[rising]))))
    if not differences:
        return None
    weight = 1.0 / np.array(variances)
    value = float(weight @ differences / weight.sum())
    spread = float(weight @ (np.array(differences) - value) ** 2) / max(len(differences) - 1, 1)
    return Estimate(max(value, 0.0), float(np.sqrt(max(spread, 1.0) / weight.sum())), "rad")


def _block_scatter(samples: Samples, residual: FloatArray) -> float:
    """Standard deviation [rad] of block means about the form."""
    groups = np.unique(samples.block)
    means = [residual[samples.block == g].mean() for g in groups
             if (samples.block == g).sum() >= MIN_LEVEL_SAMPLES]
    return float(max(np.std(means), 1e-4)) if len(means) > 1 else 0.01
