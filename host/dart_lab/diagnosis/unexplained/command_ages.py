"""Estimate how old commands were when they were logged, from errors in many windows.

With u_ic(a) the error of window i in channel c if its commands are older by a, the probabilities p
of ages and the standard deviations s maximise (expectation maximisation)

    L = prod_i sum_a p_a prod_c [(1 - E) n(u_ic(a) / s_c) + E / W n(u_ic(a) / (W s_c))] / s_c

n is the normal density. A share E of the windows may hold an event (a gust) that has nothing to do
with commands, with W times the standard deviation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.fitting.robust import scatter

EVENT_SHARE = 0.1
"""E: windows that an event may disturb ..."""
EVENT_WIDTH = 10.0
"""W: ... and the standard deviation of their errors over that of the others. An error beyond 3.0
standard deviations is then more likely that of an event, (1 - E) n(z) = E / W n(z / W)."""
AGE_STEP = 0.005
"""s between ages at which windows are predicted: velocities of the poses are means over 0.06 s, so
errors are nearly straight from one age to the next ..."""
AGE_PARTS = 2
"""... and are interpolated at so many parts of the step."""
INFORMATIVE = 2.0
"""Log likelihood between best and worst age, above which a window shows how old its command was. A
window in which no command changes does not."""
MIN_INFORMATIVE = 3
"""Such windows; with fewer all ages count alike."""
ROUNDS = 50
"""Of expectation maximisation."""


@dataclass(frozen=True, slots=True)
class AgeFit:
    """std (c,): of errors at the right age; probability (k,): of each age; posterior (k, n): the
    same by window; log_likelihood: of all windows."""

    std: FloatArray
    probability: FloatArray
    posterior: FloatArray
    log_likelihood: float


def fit_ages(by_age: FloatArray) -> AgeFit:
    """Fit standard deviations and probabilities of ages to errors (k, n, c) by age."""
    k, n, channels = by_age.shape
    s = np.array([min(scatter(errors[:, c] - np.median(errors[:, c])) for errors in by_age)
                  for c in range(channels)]) + 1e-9
    p = np.full(k, 1.0 / k)
    for _ in range(ROUNDS):
        # 1. probability of each age by window, all channels together
        z2 = (by_age / s)**2
        usual = (1.0 - EVENT_SHARE) * np.exp(-0.5 * z2)
        event = EVENT_SHARE / EVENT_WIDTH * np.exp(-0.5 * z2 / EVENT_WIDTH**2)
        density = np.log(usual + event + 1e-300).sum(axis=2)
        largest = density.max(axis=0)
        posterior = np.exp(density - largest) * p[:, None] + 1e-300
        total = posterior.sum(axis=0)
        posterior /= total
        log_likelihood = float(np.sum(largest + np.log(total))) - n * float(np.log(s).sum())
        # 2. probabilities of the ages, by windows that depend on them
        informative = largest - density.min(axis=0) > INFORMATIVE
        p = (posterior[:, informative].mean(axis=1) if informative.sum() >= MIN_INFORMATIVE
             else np.full(k, 1.0 / k))
        # 3. standard deviations, by errors that are no event
        weight = posterior[:, :, None] * usual / (usual + event + 1e-300)
        s = np.sqrt(np.sum(weight * by_age**2, axis=(0, 1)) / np.sum(weight, axis=(0, 1))) + 1e-9
    return AgeFit(s, p, posterior, log_likelihood)


def interpolate_ages(by_age: FloatArray) -> FloatArray:
    """Errors (k, ...) at AGE_PARTS times as many ages, or the ages (k,) themselves."""
    k = len(by_age)
    if k == 1:
        return by_age
    at = np.linspace(0.0, k - 1.0, AGE_PARTS * (k - 1) + 1)
    before = np.minimum(at.astype(np.int64), k - 2)
    share = (at - before).reshape(-1, *[1] * (by_age.ndim - 1))
    return np.asarray((1.0 - share) * by_age[before] + share * by_age[before + 1])
