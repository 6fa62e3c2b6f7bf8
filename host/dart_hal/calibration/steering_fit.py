"""Fit steering map with standard errors, in the paper's form, and backlash to samples.

For recordings, in which levels are often reached from one side only and the tyres slip. The map has
the five-parameter form, and the deviation from that form is part of the standard error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.calibration.samples import LEVEL_WIDTH, MIN_COMMAND_AGE, Samples
from dart_hal.calibration.steering_map import (
    MIN_LEVELS,
    MIN_SPAN,
    PaperMap,
    coverage,
    fit_map,
)
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import Estimate, FloatArray

# Commands between the points of a map; number of points, and samples of a level, at least.
COMMAND_SPACING = 0.05
MIN_POINTS = 9
MIN_LEVEL_SAMPLES = 5


@dataclass(frozen=True, slots=True)
class SteeringFit:
    """command, angle, angle_std (k,); residual (n,) rad; misfit: deviation of the form [rad]."""

    command: FloatArray
    angle: FloatArray
    angle_std: FloatArray
    form: PaperMap
    residual: FloatArray
    residual_rms: float
    misfit: float
    backlash: Estimate | None


def fit_steering(samples: Samples) -> SteeringFit:
    """Fit the map over the range of commands in ``samples``.

    Raises CalibrationFailed if the commands span too little or the map does not increase.
    """
    levels, span, rising = coverage(samples)
    low = float(samples.command.min())
    high = float(samples.command.max())
    if levels < MIN_LEVELS or span < MIN_SPAN:
        raise CalibrationFailed(
            "the commands cover too little for a steering map",
            found=f"{levels} level(s) from {low:+.2f} to {high:+.2f}",
            expected=f"at least {MIN_LEVELS} levels over a span of {MIN_SPAN}",
            remedy="add recordings with other steering commands")
    if not rising:
        raise _not_increasing()
    form = fit_map(samples)
    residual = samples.angle - form.angle(samples.command)
    misfit = level_misfit(samples, residual)
    points = max(MIN_POINTS, round((high - low) / COMMAND_SPACING) + 1)
    command = np.round(np.linspace(low, high, points), 9)
    angle = form.angle(command)
    if np.any(np.diff(angle) <= 0.0):
        raise _not_increasing()
    std = np.sqrt(form.std(command) ** 2 + misfit**2)
    weight = samples.weight / samples.weight.sum()
    return SteeringFit(command, angle, std, form, residual,
                       float(np.sqrt(weight @ residual**2)), misfit,
                       fit_backlash(samples, residual))


def _not_increasing() -> CalibrationFailed:
    return CalibrationFailed("the steering map does not increase",
                             found="angle falls while the command rises",
                             expected="command +1 = full left, yaw rate positive to the left",
                             likely="yaw rate or steering with the wrong sign in the data",
                             remedy="check the sign of W and of steering in the files")


def level_misfit(samples: Samples, residual: FloatArray) -> float:
    """Rms deviation [rad] of the level means from the form, beyond the scatter of blocks.

    Neighbouring levels deviate together, so more samples would not reduce it.
    """
    means = []
    variances = []
    counts = []
    key = np.round(samples.command / LEVEL_WIDTH)
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


def fit_backlash(samples: Samples, residual: FloatArray) -> Estimate | None:
    """Fit the width of the loop [rad] to levels reached from both sides; None without them.

    Approached from below the wheels lag behind: falling minus rising = width. Only samples
    long after a change of command are used.
    """
    key = np.round(samples.command / LEVEL_WIDTH)
    differences = []
    variances = []
    old = samples.age > MIN_COMMAND_AGE
    scatter = _block_scatter(samples, residual)
    for level in np.unique(key):
        rising = (key == level) & (samples.direction > 0) & old
        falling = (key == level) & (samples.direction < 0) & old
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
