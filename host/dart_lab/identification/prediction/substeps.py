"""Held commands between the samples of a grid: a step stays a step wherever it falls.

A step of the wheels saturates the tyre at once. Spread over a sample, it does
not, and a model would look early or late by as much as the grid is coarse.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.batch import rollout
from dart_hal.vehicle.parameters import Vehicle

FINE = 4  # steps per sample
METHOD = "midpoint"  # of their integration; at 2.5 ms what it is off is far below any residual
SAME = 1e-12


def fine(series: FloatArray, at: FloatArray) -> FloatArray:
    """Means of a series of sample means (n,) over quarters of samples, (FINE * k, lanes).

    at (k, lanes): samples at which consecutive stretches of one sample begin,
    anywhere between samples. A mean between those of its neighbours is read as a
    step from the one to the other within the sample. Beyond its ends the series is held.
    """
    at = np.clip(at + 1.0, 0.0, len(series))
    series = np.concatenate([series[:1], series, series[-1:]])
    share, first, then = _steps(series)
    total = np.concatenate([[0.0], np.cumsum(series)])

    low = np.floor(at).astype(np.int64)
    part = at - low

    def integral(shift: float) -> FloatArray:
        over = part + shift
        carry = (over >= 1.0).astype(np.int64)
        index = low + carry
        past = over - carry
        return np.asarray(total[index] + np.minimum(past, share[index]) * first[index]
                          + np.maximum(past - share[index], 0.0) * then[index])

    edges = [integral(i / FINE) for i in range(FINE + 1)]
    means = np.stack([b - a for a, b in pairwise(edges)], axis=1) * FINE
    return np.asarray(means.reshape(FINE * len(at), *at.shape[1:]))


def quarters(series: FloatArray) -> FloatArray:
    """The same where stretches begin with samples: of each sample (n,) its quarters (n, FINE)."""
    share, first, then = _steps(series)
    until = [np.minimum(i / FINE, share) * first + np.maximum(i / FINE - share, 0.0) * then
             for i in range(1, FINE + 1)]
    return np.stack([until[0], *(b - a for a, b in pairwise(until))], axis=1) * FINE


def _steps(series: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of each sample (n,): where in it a step is, 0 to 1, and the levels before and behind."""
    before = np.concatenate([series[:1], series[:-1]])
    after = np.concatenate([series[1:], series[-1:]])
    rise = after - before
    flat = np.abs(rise) < SAME
    share = np.where(flat, -1.0, (after - series) / np.where(flat, 1.0, rise))
    between = (share >= 0.0) & (share <= 1.0)
    return (np.where(between, share, 1.0), np.where(between, before, series),
            np.where(between, after, series))


def fine_rollout(p: Vehicle, start: FloatArray, throttle: FloatArray, angle: FloatArray,
                 at: Iterable[int]) -> FloatArray:
    """As ``rollout``: states (len(at), 6, n), at in samples, from inputs (FINE * samples, n)."""
    return np.asarray(rollout(p, start, throttle, angle, at=[FINE * k for k in at],
                              sample=SAMPLE / FINE, substeps=1, method=METHOD))
