"""Held commands between the samples of a grid: the time of a step within a sample is kept.

A step of the wheels saturates the tyre at once; the mean over its sample does not, and the timing
of a model would be wrong by up to one sample.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.batch import rollout
from dart_hal.vehicle.parameters import Vehicle

# Substeps of a sample.
SUBSTEPS = 4
# Integration of the substeps: its error at 2.5 ms is far below any residual.
SUBSTEP_METHOD = "midpoint"
# Smaller changes of a command are rounding errors.
MIN_CHANGE = 1e-12


def average_substeps(series: FloatArray, starts: FloatArray) -> FloatArray:
    """Average a series of sample means (n,) over quarters of samples, (SUBSTEPS * k, batch).

    starts (k, batch): positions [samples], in general between two samples, at which stretches of
    one sample begin. A mean between those of its neighbours is read as a step from the one to the
    other within the sample. The series is held beyond its ends.
    """
    # 1. Decompose each sample into (share before the step, level before, level after).
    # 2. The integral from the start of the series is then piecewise linear.
    # 3. The means are the differences of that integral at the edges of the quarters.
    starts = np.clip(starts + 1.0, 0.0, len(series))
    series = np.concatenate([series[:1], series, series[-1:]])
    share, first, then = _steps(series)
    total = np.concatenate([[0.0], np.cumsum(series)])

    low = np.floor(starts).astype(np.int64)
    part = starts - low

    def integral(shift: float) -> FloatArray:
        over = part + shift
        carry = (over >= 1.0).astype(np.int64)
        index = low + carry
        past = over - carry
        return np.asarray(total[index] + np.minimum(past, share[index]) * first[index]
                          + np.maximum(past - share[index], 0.0) * then[index])

    edges = [integral(i / SUBSTEPS) for i in range(SUBSTEPS + 1)]
    means = np.stack([b - a for a, b in pairwise(edges)], axis=1) * SUBSTEPS
    return np.asarray(means.reshape(SUBSTEPS * len(starts), *starts.shape[1:]))


def quarters(series: FloatArray) -> FloatArray:
    """Average each sample (n,) over its quarters (n, SUBSTEPS): ``average_substeps`` at samples."""
    share, first, then = _steps(series)
    until = [np.minimum(i / SUBSTEPS, share) * first + np.maximum(i / SUBSTEPS - share, 0.0) * then
             for i in range(1, SUBSTEPS + 1)]
    return np.stack([until[0], *(b - a for a, b in pairwise(until))], axis=1) * SUBSTEPS


def _steps(series: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return for each sample (n,) the place of its step, 0 to 1, and the levels around it."""
    before = np.concatenate([series[:1], series[:-1]])
    after = np.concatenate([series[1:], series[-1:]])
    rise = after - before
    flat = np.abs(rise) < MIN_CHANGE
    share = np.where(flat, -1.0, (after - series) / np.where(flat, 1.0, rise))
    between = (share >= 0.0) & (share <= 1.0)
    return (np.where(between, share, 1.0), np.where(between, before, series),
            np.where(between, after, series))


def rollout_substeps(p: Vehicle, start: FloatArray, throttle: FloatArray, angle: FloatArray,
                     offsets: Iterable[int]) -> FloatArray:
    """Roll out inputs (SUBSTEPS * samples, n) to states (len(offsets), 6, n)."""
    samples = [SUBSTEPS * k for k in offsets]
    return np.asarray(rollout(p, start, throttle, angle, output_samples=samples,
                              sample=SAMPLE / SUBSTEPS, substeps=1, method=SUBSTEP_METHOD))
