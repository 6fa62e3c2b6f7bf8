"""Lanes between two boards in a hall: ``lane``, ``lane-curve`` and ``lane-s``."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, pi, sin

import numpy as np

from dart_hal.control.paths import Path
from dart_hal.core.types import FloatArray

# Distance from the middle of a lane to its boards [m].
LANE_HALF_WIDTH = 0.4
# Distance from the boards to the walls of the hall [m].
HALL_MARGIN = 2.0
# Length of the lane behind the start [m].
START_DISTANCE = 0.5
# Largest offset [m] and angle [rad] of the start from the middle line.
MAX_START_OFFSET = 0.05
MAX_START_ANGLE = 0.1

# Middle lines: straight; three quarters of a circle of 2 m; an S of bends of 1.5 m.
LANE_PATHS: dict[str, Callable[[], Path]] = {
    "lane": lambda: Path([(12.0, 0.0)], closed=False),
    "lane-curve": lambda: Path([(2.0, 0.0), (3.0 * pi, 0.5), (1.0, 0.0)], closed=False),
    "lane-s": lambda: Path([(2.0, 0.0), (0.75 * pi, 1 / 1.5), (1.5 * pi, -1 / 1.5),
                            (0.75 * pi, 1 / 1.5), (1.5, 0.0)], closed=False)}


def lane_boards(path: Path) -> tuple[FloatArray, FloatArray]:
    """Return points (n, 2) [m] of the left and the right board, at a distance of 0.1 m."""
    end = path.interpolate(path.length)
    middle = np.vstack((np.column_stack((path.x, path.y))[::5], end[:2]))
    heading = np.append(path.heading[::5], end.heading)
    # Unit vector to the left of the path; both boards are parallel curves of its middle.
    normal = np.column_stack((-np.sin(heading), np.cos(heading)))
    return middle + LANE_HALF_WIDTH * normal, middle - LANE_HALF_WIDTH * normal


def draw_start(path: Path, rng: np.random.Generator) -> tuple[float, float, float]:
    """Draw x, y [m], yaw [rad] of the rear axle near the middle line."""
    start = path.interpolate(START_DISTANCE)
    # Offset along the normal of the path, positive to the left, and a heading error.
    side = float(rng.uniform(-MAX_START_OFFSET, MAX_START_OFFSET))
    return (start.x - side * sin(start.heading), start.y + side * cos(start.heading),
            start.heading + float(rng.uniform(-MAX_START_ANGLE, MAX_START_ANGLE)))
