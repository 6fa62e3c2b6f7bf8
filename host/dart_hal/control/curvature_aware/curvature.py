"""The curvature of the path ahead as one smooth function of the progress.

    k(s) = K(s / L, grid) (K(grid, grid) + 1e-8 I)^-1 labels
    K(a, b) = (1 + sqrt(5) r + 5/3 r^2) exp(-sqrt(5) r),    r = |a - b| / l,    l = 1.3 / 41

a Matern kernel over 41 points of [0, 1]: an optimiser can differentiate it twice. Beyond the grid
it decays to zero within 2 l.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import Any

import numpy as np

from dart_hal.core.types import FloatArray

# Number of grid points.
GRID_POINTS = 41
# Length scale l of the kernel, relative to the length of the path ahead.
KERNEL_WIDTH = 1.3 / GRID_POINTS
# Added to the diagonal, so that the kernel matrix can be inverted.
KERNEL_JITTER = 1e-8
GRID: FloatArray = np.linspace(0.0, 1.0, GRID_POINTS)


def matern(r: Any, exp: Callable[[Any], Any] = np.exp) -> Any:
    """Return the kernel of a distance r >= 0 in widths; of arrays, or of symbols with their
    ``exp``.
    """
    a = sqrt(5.0) * r
    return (1.0 + a + a * a / 3.0) * exp(-a)


_INVERSE: FloatArray = np.linalg.inv(
    matern(np.abs(GRID[:, None] - GRID) / KERNEL_WIDTH) + KERNEL_JITTER * np.eye(GRID_POINTS))


def fit_weights(labels: FloatArray) -> FloatArray:
    """Return the weights (41,) [1/m] of curvatures (41,) [1/m] at ``GRID``."""
    return _INVERSE @ labels


def curvature(s: FloatArray, weights: FloatArray, length: float) -> FloatArray:
    """Return k [1/m] at progresses s [m] of any shape, on a grid over ``length`` [m]."""
    k: FloatArray = matern(np.abs(s[..., None] / length - GRID) / KERNEL_WIDTH) @ weights
    return k
