"""The curvature of the way ahead as one smooth function of the progress.

    k(s) = K(s / L, grid) (K(grid, grid) + 1e-8 I)^-1 labels
    K(a, b) = (1 + sqrt(5) r + 5/3 r^2) exp(-sqrt(5) r),    r = |a - b| / l,    l = 1.3 / 41

a Matern kernel over 41 points of [0, 1]: an optimiser can differentiate it twice. Beyond the grid
it fades to a straight within 2 l.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import Any

import numpy as np

from dart_hal.core.types import FloatArray

POINTS = 41
# l of the kernel, in parts of the way.
WIDTH = 1.3 / POINTS
JITTER = 1e-8
GRID: FloatArray = np.linspace(0.0, 1.0, POINTS)


def matern(r: Any, exp: Callable[[Any], Any] = np.exp) -> Any:
    """Kernel of a distance r >= 0 in widths; of arrays, or of symbols with their own ``exp``."""
    a = sqrt(5.0) * r
    return (1.0 + a + a * a / 3.0) * exp(-a)


_INVERSE: FloatArray = np.linalg.inv(
    matern(np.abs(GRID[:, None] - GRID) / WIDTH) + JITTER * np.eye(POINTS))


def weights_of(labels: FloatArray) -> FloatArray:
    """Weights (41,) [1/m] of curvatures (41,) [1/m] at ``GRID``."""
    return _INVERSE @ labels


def curvature(s: FloatArray, weights: FloatArray, length: float) -> FloatArray:
    """k [1/m] at progresses s [m] of any shape, on a grid over ``length`` [m]."""
    k: FloatArray = matern(np.abs(s[..., None] / length - GRID) / WIDTH) @ weights
    return k
