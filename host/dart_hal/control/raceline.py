"""Racelines: the line around a closed path, within a lane, with the shortest lap time.

Points p_i = c_i + n_i N_i minimise the sum of (k_i^2 + w^2) ds_i under |n_i| <= half width, where
k_i is the curvature through three neighbours: a bounded least-squares problem with few neighbours
in each row. w [1/m] weighs the length against the curvature; the w with the shortest lap is taken,
as F. Braghin et al., "Race driver model", Computers and Structures 86 (2008).
"""

from __future__ import annotations

import numpy as np

from dart_hal.control.lap import is_drivable, speed_profile
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray

# Distance between the points [m]: a quarter turn of 0.75 m has eight.
POINT_SPACING = 0.15
# Weights of the length [1/m]: a metre costs as much as one of a bend of 3, 1.4, 1, 0.7 m.
LENGTH_WEIGHTS = (0.33, 0.7, 1.0, 1.4)
# Largest half width [m]: a wider lane around a turn of 0.5 m crosses itself.
MAX_HALF_WIDTH = 0.5


def raceline(path: Path, half_width: float, plant: Plant, cap: float) -> Path:
    """Return the line within ``half_width`` [m] with the shortest lap of a plant, up to ``cap``
    [m/s].

    Raises UsageError for an open path, an impossible width, and if even the line with the least
    curvature is too tight for the car.
    """
    if not path.closed:
        raise UsageError("a raceline needs a closed path", found="an open one",
                         remedy="repeat the first row of the file as its last")
    widest = min(MAX_HALF_WIDTH, 0.9 / float(np.abs(path.curvature).max()))
    if not 0.0 < half_width <= widest:
        raise UsageError("no raceline in a lane of this width", found=f"{half_width} m",
                         expected=f"above 0, at most {widest:.2f} m on this path")
    lines = [_optimise_line(path, half_width, length_weight) for length_weight in LENGTH_WEIGHTS]
    drivable = [line for line in lines if is_drivable(line, plant)] or lines[:1]
    return min(drivable, key=lambda line: speed_profile(line, plant, cap).time)


def _optimise_line(path: Path, half_width: float, length_weight: float) -> Path:
    """Solve the least-squares problem for one weight of the length."""
    from scipy.optimize import least_squares

    n = round(path.length / POINT_SPACING)
    points = np.array([path.interpolate(k * path.length / n) for k in range(n)])
    centre = points[:, :2]
    normal = np.column_stack([-np.sin(points[:, 2]), np.cos(points[:, 2])])

    def residuals(offsets: FloatArray) -> FloatArray:
        return _residuals(centre + offsets[:, None] * normal, length_weight)

    neighbours = sum(np.roll(np.eye(n), k, axis=1) for k in (-1, 0, 1))
    solution = least_squares(residuals, np.zeros(n), bounds=(-half_width, half_width),
                             jac_sparsity=np.vstack([neighbours, neighbours]), xtol=1e-6, ftol=1e-6)
    return Path.through(centre + solution.x[:, None] * normal, closed=True)


def _residuals(points: FloatArray, length_weight: float) -> FloatArray:
    """Return k sqrt(ds) of the circles through three neighbours, and w sqrt(ds), (2 n,)."""
    before = points - np.roll(points, 1, axis=0)
    after = np.roll(points, -1, axis=0) - points
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    a = np.hypot(*before.T)
    b = np.hypot(*after.T)
    c = np.hypot(*(before + after).T)
    root = np.sqrt(0.5 * (a + b))
    return np.concatenate([2.0 * cross / (a * b * c) * root, length_weight * root])
