"""Estimate the age of logged commands from the prediction errors of many windows.

With u_ic(a) the error of window i in channel c if its commands are older by a, expectation
maximisation finds the probabilities p of the ages and the standard deviations s that maximise

    L = prod_i sum_a p_a prod_c [(1 - E) n(u_ic(a) / s_c) + E / W n(u_ic(a) / (W s_c))] / s_c

n is the normal density. A share E of the windows may contain an event, for example a gust, that is
unrelated to commands and has W times the standard deviation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.fitting.robust import scatter

# E: share of windows with an event.
EVENT_SHARE = 0.1
# W: standard deviation of errors with an event over that without. An error beyond 3.0 standard
# deviations is then more likely to be an event: (1 - E) n(z) = E / W n(z / W).
EVENT_WIDTH = 10.0
# s between ages at which windows are predicted. Velocities of the poses are means over 0.06 s, so
# errors are nearly linear from one age to the next.
AGE_STEP = 0.005
# The errors are interpolated at this number of parts of the step.
AGE_PARTS = 2
# Log likelihood ratio of the best and the worst age above which a window is informative. A window
# in which no command changes is not.
MIN_LOG_RATIO = 2.0
# With fewer informative windows all ages are equally probable.
MIN_INFORMATIVE_WINDOWS = 3
# Iterations of expectation maximisation.
EM_ITERATIONS = 50


@dataclass(frozen=True, slots=True)
class AgeFit:
    """Result of ``fit_ages``.

    std (c,): standard deviation of errors at the right age. probability (k,): of each age.
    posterior (k, n): probability of each age by window. log_likelihood: of all windows.
    """

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
    for _ in range(EM_ITERATIONS):
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
        informative = largest - density.min(axis=0) > MIN_LOG_RATIO
        p = (posterior[:, informative].mean(axis=1) if informative.sum() >= MIN_INFORMATIVE_WINDOWS
             else np.full(k, 1.0 / k))
        # 3. standard deviations, by errors that are no event
        weight = posterior[:, :, None] * usual / (usual + event + 1e-300)
        s = np.sqrt(np.sum(weight * by_age**2, axis=(0, 1)) / np.sum(weight, axis=(0, 1))) + 1e-9
    return AgeFit(s, p, posterior, log_likelihood)


def interpolate_ages(by_age: FloatArray) -> FloatArray:
    """Interpolate errors (k, ...) to AGE_PARTS times as many ages, or the ages (k,) themselves."""
    k = len(by_age)
    if k == 1:
        return by_age
    positions = np.linspace(0.0, k - 1.0, AGE_PARTS * (k - 1) + 1)
    lower = np.minimum(positions.astype(np.int64), k - 2)
    share = (positions - lower).reshape(-1, *[1] * (by_age.ndim - 1))
    return np.asarray((1.0 - share) * by_age[lower] + share * by_age[lower + 1])
