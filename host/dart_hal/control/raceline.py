"""Racelines: the line around a closed path, within a lane, with the shortest lap time.

``raceline`` chooses among lines of little curvature. ``minimum_time_line`` improves that line by
the lap time itself, as tyres, motor and brake of the car allow it.

Points p_i = c_i + n_i N_i minimise the sum of (k_i^2 + w^2) ds_i under |n_i| <= half width, where
k_i is the curvature through three neighbours: a bounded least-squares problem with few neighbours
in each row. w [1/m] weighs the length against the curvature; the w with the shortest lap is taken,
as F. Braghin et al., "Race driver model", Computers and Structures 86 (2008).
"""

from __future__ import annotations

from math import inf

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
# Additional weights with which a minimum-time line may begin.
START_WEIGHTS = (0.2, 0.5, 0.85)
# Tries of the search for it, half widths [m] of its bumps, and the standard deviation of their
# heights [m]: first, least, most; factors after a success and a failure.
TRIES = 1000
BUMP_WIDTHS = (0.5, 3.0)
BUMP_HEIGHTS = (0.03, 0.003, 0.1)
HEIGHT_FACTORS = (1.4, 0.97)
# Largest half width [m]: a wider lane around a turn of 0.5 m crosses itself.
MAX_HALF_WIDTH = 0.5


def raceline(path: Path, half_width: float, plant: Plant, cap: float) -> Path:
    """Return the line within ``half_width`` [m] with the shortest lap of a plant, up to ``cap``
    [m/s].

    Raises UsageError for an open path, an impossible width, and if even the line with the least
    curvature is too tight for the car.
    """
    lines = [_make_line(path, offsets) for offsets in _drivable_offsets(path, half_width, plant)]
    return min(lines, key=lambda line: speed_profile(line, plant, cap).time)


def minimum_time_line(path: Path, half_width: float, plant: Plant, cap: float) -> Path:
    """Return the line within ``half_width`` [m] with the shortest lap found, up to ``cap`` [m/s].

    1. Begin with the fastest of the least-squares lines.
    2. Add a random smooth bump, or one to both sides, and keep it if the lap time of the speed
       profile decreases. Heights grow after a success and shrink after a failure: the (1+1)
       evolution strategy of I. Rechenberg, "Evolutionsstrategie" (1973).

    The lap time is no smooth function of the line, so gradients do not help. The line is never
    slower than ``raceline``, and the same for the same input. Raises UsageError as that. Takes some
    20 s for a path of 20 m. Example::

        minimum_time_line(track_named("savoiardo"), 0.3, plant, 3.0).length
    """
    def lap_time(offsets: FloatArray) -> float:
        line = _make_line(path, offsets)
        return speed_profile(line, plant, cap).time if is_drivable(line, plant) else inf

    best = min(_drivable_offsets(path, half_width, plant, START_WEIGHTS), key=lap_time)
    shortest = lap_time(best)
    s = np.arange(len(best)) * path.length / len(best)
    rng = np.random.default_rng(0)
    height, least, most = BUMP_HEIGHTS
    for k in range(TRIES):
        width = float(np.exp(rng.uniform(*np.log(BUMP_WIDTHS))))
        distance = np.remainder(s - rng.uniform(0.0, path.length) + 0.5 * path.length, path.length)
        phase = np.pi * np.clip((distance - 0.5 * path.length) / width, -1.0, 1.0)
        bump = 0.5 * (1.0 + np.cos(phase)) * (np.sin(phase) if k % 2 else 1.0)
        # A narrow bump of the same curvature is lower.
        size = height * rng.normal() * min(width, 1.5)**2
        offsets = np.clip(best + size * bump, -half_width, half_width)
        time = lap_time(offsets)
        if time < shortest:
            best = offsets
            shortest = time
            height = min(height * HEIGHT_FACTORS[0], most)
        else:
            height = max(height * HEIGHT_FACTORS[1], least)
    return _make_line(path, best)


def _drivable_offsets(path: Path, half_width: float, plant: Plant,
                      more_weights: tuple[float, ...] = ()) -> list[FloatArray]:
    """Return the offsets (n,) [m] of the lines for each weight that the car can drive.

    If it can drive none, that of the least curvature. Raises UsageError for an open path and an
    impossible width.
    """
    if not path.closed:
        raise UsageError("a raceline needs a closed path", found="an open one",
                         remedy="repeat the first row of the file as its last")
    widest = min(MAX_HALF_WIDTH, 0.9 / float(np.abs(path.curvature).max()))
    if not 0.0 < half_width <= widest:
        raise UsageError("no raceline in a lane of this width", found=f"{half_width} m",
                         expected=f"above 0, at most {widest:.2f} m on this path")
    lines = [_optimise_offsets(path, half_width, length_weight)
             for length_weight in (*LENGTH_WEIGHTS, *more_weights)]
    return [line for line in lines if is_drivable(_make_line(path, line), plant)] or lines[:1]


def _sample(path: Path) -> tuple[FloatArray, FloatArray]:
    """Return points (n, 2) [m] of the path and its normals (n, 2), to the left."""
    n = round(path.length / POINT_SPACING)
    points = np.array([path.interpolate(k * path.length / n) for k in range(n)])
    return points[:, :2], np.column_stack([-np.sin(points[:, 2]), np.cos(points[:, 2])])


def _make_line(path: Path, offsets: FloatArray) -> Path:
    """Return the line at offsets (n,) [m] from the path."""
    centre, normal = _sample(path)
    return Path.through(centre + offsets[:, None] * normal, closed=True)


def _optimise_offsets(path: Path, half_width: float, length_weight: float) -> FloatArray:
    """Solve the least-squares problem for one weight of the length."""
    from scipy.optimize import least_squares

    centre, normal = _sample(path)
    n = len(centre)

    def residuals(offsets: FloatArray) -> FloatArray:
        return _residuals(centre + offsets[:, None] * normal, length_weight)

    neighbours = sum(np.roll(np.eye(n), k, axis=1) for k in (-1, 0, 1))
    solution = least_squares(residuals, np.zeros(n), bounds=(-half_width, half_width),
                             jac_sparsity=np.vstack([neighbours, neighbours]), xtol=1e-6, ftol=1e-6)
    offsets: FloatArray = solution.x
    return offsets


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
