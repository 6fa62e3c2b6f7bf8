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

# Of cos(2 pi p / N): a quarter turn between neighbours is on the edge, rounding or not.
FLAT = 1e-9


def repulsion(own: float, before: float, after: float, k: float) -> float:
    """What the two neighbours' phases [rad] add to one robot's rate [rad/s]; k [rad/s]."""
    return float(k * (np.sin(own - before) + np.sin(own - after)))


def rates(theta: FloatArray, omega: float, k: float) -> FloatArray:
    """Rates [rad/s] of all phases (n,) [rad]; omega, k [rad/s]."""
    return np.asarray(omega + k * (np.sin(theta - np.roll(theta, 1))
                                   + np.sin(theta - np.roll(theta, -1))), dtype=np.float64)


def stepped(theta: FloatArray, omega: float, k: float, dt: float) -> FloatArray:
    """Phases dt [s] later, by the classical Runge-Kutta step of fourth order."""
    k1 = rates(theta, omega, k)
    k2 = rates(theta + 0.5 * dt * k1, omega, k)
    k3 = rates(theta + 0.5 * dt * k2, omega, k)
    k4 = rates(theta + dt * k3, omega, k)
    return theta + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def spread(n: int, p: int) -> FloatArray:
    """Phases (n,) [rad] of the p-winding state, the first at 0."""
    return 2.0 * pi * p / n * np.arange(n, dtype=np.float64)


def stable(n: int, p: int) -> bool:
    """Whether n robots come back to the p-winding state from near it."""
    return cos(2.0 * pi * p / n) < -FLAT


def disagreement(theta: FloatArray, p: int) -> float:
    """Largest error [rad] of a difference between neighbours, of the p-winding state."""
    n = len(theta)
    error = np.roll(theta, -1) - theta - 2.0 * pi * p / n
    return float(np.abs(np.remainder(error + pi, 2.0 * pi) - pi).max())


def winding(theta: FloatArray) -> int:
    """How often the phases go round along the ring, 0 <= winding < n."""
    steps = np.remainder(np.roll(theta, -1) - theta, 2.0 * pi)
    return round(float(steps.sum()) / (2.0 * pi)) % len(theta)


def slowest(n: int, p: int, k: float) -> float:
    """Decay [1/s] of the slowest mode about a stable p-winding state; k [rad/s]."""
    return -k * cos(2.0 * pi * p / n) * (2.0 - 2.0 * cos(2.0 * pi / n))
