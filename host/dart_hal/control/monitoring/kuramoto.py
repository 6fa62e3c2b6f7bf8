"""The time-inverted Kuramoto law on a ring: each robot is repelled by its two neighbours.

    theta_i' = Omega + k sum_j sin(theta_i - theta_j),   j = i - 1, i + 1,   k = K / N

It is the descent of V = k sum_i cos(theta_i - theta_i+1). In the p-winding state all differences
are 2 pi p / N. Its linearisation there is k cos(2 pi p / N) times the Laplacian of the ring, so it
is stable iff cos(2 pi p / N) < 0, and a mode m decays at k |cos| (2 - 2 cos(2 pi m / N)).

Boldrer et al. (see the package), section III.
"""

from __future__ import annotations

from math import cos, pi

import numpy as np

from dart_hal.core.types import FloatArray

# Margin of cos(2 pi p / N): a quarter turn between neighbours is marginally stable, rounding or
# not.
STABILITY_MARGIN = 1e-9


def repulsion(own: float, previous: float, following: float, k: float) -> float:
    """Return the effect of the two neighbours' phases [rad] on one robot's rate [rad/s]; k [rad/s].
    """
    return float(k * (np.sin(own - previous) + np.sin(own - following)))


def rates(theta: FloatArray, omega: float, k: float) -> FloatArray:
    """Return the rates [rad/s] of all phases (n,) [rad]; omega, k [rad/s]."""
    return np.asarray(omega + k * (np.sin(theta - np.roll(theta, 1))
                                   + np.sin(theta - np.roll(theta, -1))), dtype=np.float64)


def evenly_spread(n: int, p: int) -> FloatArray:
    """Return the phases (n,) [rad] of the p-winding state, the first at 0."""
    return 2.0 * pi * p / n * np.arange(n, dtype=np.float64)


def is_stable(n: int, p: int) -> bool:
    """Return whether n robots return to the p-winding state from near it."""
    return cos(2.0 * pi * p / n) < -STABILITY_MARGIN


def disagreement(theta: FloatArray, p: int) -> float:
    """Return the largest error [rad] of a difference between neighbours, of the p-winding state."""
    n = len(theta)
    error = np.roll(theta, -1) - theta - 2.0 * pi * p / n
    return float(np.abs(np.remainder(error + pi, 2.0 * pi) - pi).max())
