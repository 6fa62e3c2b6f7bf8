"""Lanes between two boards in a hall: ``lane``, ``lane-curve`` and ``lane-s``."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, pi, sin

import numpy as np

from dart_hal.control.paths import Path
from dart_hal.core.types import FloatArray

HALF = 0.4
"""m from the middle of a lane to its boards."""
AROUND = 2.0
"""m from the boards to the walls of the hall."""
BEHIND = 0.5
"""m of the lane behind the start."""
ASIDE, TURNED = 0.05, 0.1
"""m and rad by which a seed's car stands beside the middle at most."""

LANES: dict[str, Callable[[], Path]] = {
    "lane": lambda: Path([(12.0, 0.0)], closed=False),
    "lane-curve": lambda: Path([(2.0, 0.0), (3.0 * pi, 0.5), (1.0, 0.0)], closed=False),
    "lane-s": lambda: Path([(2.0, 0.0), (0.75 * pi, 1 / 1.5), (1.5 * pi, -1 / 1.5),
                            (0.75 * pi, 1 / 1.5), (1.5, 0.0)], closed=False)}
"""Middle lines: straight; three quarters of a circle of 2 m; an S of bends of 1.5 m."""


def boards(path: Path) -> tuple[FloatArray, FloatArray]:
    """Points (n, 2) [m] of the left and the right board, 0.1 m apart."""
    at = path.at(path.length)
    middle = np.vstack((np.column_stack((path.x, path.y))[::5], at[:2]))
    heading = np.append(path.heading[::5], at.heading)
    normal = np.column_stack((-np.sin(heading), np.cos(heading)))
    return middle + HALF * normal, middle - HALF * normal


def begins(path: Path, rng: np.random.Generator) -> tuple[float, float, float]:
    """x, y [m], yaw [rad] of the rear axle, somewhat beside the middle."""
    spot, side = path.at(BEHIND), float(rng.uniform(-ASIDE, ASIDE))
    return (spot.x - side * sin(spot.heading), spot.y + side * cos(spot.heading),
            spot.heading + float(rng.uniform(-TURNED, TURNED)))
