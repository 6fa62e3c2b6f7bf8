"""Racelines: the line around a closed path, within a lane, that takes a car the least time.

Points p_i = c_i + n_i N_i beside the path's minimise the sum of (k_i^2 + short^2) ds_i under
|n_i| <= w, where k_i is the curvature through three neighbours: a bounded least-squares problem
with few neighbours in each row. short [1/m] weighs a short way against a round one; the one that
gives the shortest lap is taken, as F. Braghin et al., "Race driver model", Computers and
Structures 86 (2008).
"""

from __future__ import annotations

import numpy as np

from dart_hal.control.lap import speed_profile, turns
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray

# m between the points: a quarter turn of 0.75 m has eight.
APART = 0.15
# 1/m: a metre costs as much as one of a bend of 3, 1.4, 1, 0.7 m; beyond, of a bend that no car
# of this class takes at speed.
SHORT = (0.33, 0.7, 1.0, 1.4)
# m to either side: a wider lane around a turn of 0.5 m crosses itself.
WIDEST = 0.5


def raceline(path: Path, half_width: float, plant: Plant, cap: float) -> Path:
    """The line within ``half_width`` [m] with the shortest lap of a plant, up to ``cap`` [m/s].

    Raises UsageError for an open path, a width that makes no sense, and where
    even the lane's roundest line is too tight for the car.
    """
    if not path.closed:
        raise UsageError("a raceline needs a closed path", found="an open one",
                         remedy="repeat the first row of the file as its last")
    widest = min(WIDEST, 0.9 / float(np.abs(path.curvature).max()))
    if not 0.0 < half_width <= widest:
        raise UsageError("no raceline in a lane of this width", found=f"{half_width} m",
                         expected=f"above 0, at most {widest:.2f} m on this path")
    lines = [_line(path, half_width, short) for short in SHORT]
    fit = [line for line in lines if turns(line, plant)] or lines[:1]
    return min(fit, key=lambda line: speed_profile(line, plant, cap).time)


def _line(path: Path, half_width: float, short: float) -> Path:
    from scipy.optimize import least_squares

    n = round(path.length / APART)
    spots = np.array([path.at(k * path.length / n) for k in range(n)])
    centre = spots[:, :2]
    normal = np.column_stack([-np.sin(spots[:, 2]), np.cos(spots[:, 2])])

    def cost(left: FloatArray) -> FloatArray:
        return _cost(centre + left[:, None] * normal, short)

    near = sum(np.roll(np.eye(n), k, axis=1) for k in (-1, 0, 1))
    found = least_squares(cost, np.zeros(n), bounds=(-half_width, half_width),
                          jac_sparsity=np.vstack([near, near]), xtol=1e-6, ftol=1e-6)
    return Path.through(centre + found.x[:, None] * normal, closed=True)


def _cost(points: FloatArray, short: float) -> FloatArray:
    """k sqrt(ds) of the circles through three neighbours, and short sqrt(ds), (2 n,)."""
    before = points - np.roll(points, 1, axis=0)
    after = np.roll(points, -1, axis=0) - points
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    a = np.hypot(*before.T)
    b = np.hypot(*after.T)
    c = np.hypot(*(before + after).T)
    root = np.sqrt(0.5 * (a + b))
    return np.concatenate([2.0 * cross / (a * b * c) * root, short * root])
