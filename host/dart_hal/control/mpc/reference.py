"""Pose of a path at a progress s, and the errors of a position relative to it.

    e_c = cos(phi) (y - y_r) - sin(phi) (x - x_r)     lateral, left positive
    e_l = cos(phi) (x - x_r) + sin(phi) (y - y_r)     longitudinal

x_r, y_r, phi: pose of the path at s. The slopes to s are -k e_l and k e_c - 1. Their curvature k is
a moving average over ``CURVATURE_WINDOW``, as no wheel can follow a step of it; between its points
the pose is interpolated by the curvature of the path itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dart_hal.control.paths import Path
from dart_hal.core.types import FloatArray

# Length over which the curvature is averaged [m].
CURVATURE_WINDOW = 0.2


class PathErrors(NamedTuple):
    """Errors across and along the path [m] (n,); slopes of each to (x, y, s) (n, 3)."""

    across: FloatArray
    along: FloatArray
    across_slopes: FloatArray
    along_slopes: FloatArray


class PathReference:
    """A path evaluated at many stages at once."""

    def __init__(self, path: Path) -> None:
        self.path = path
        width = max(1, round(0.5 * CURVATURE_WINDOW / path.spacing))
        n = len(path.x)
        mode = "wrap" if path.closed else "edge"
        padded = np.pad(path.curvature, width, mode=mode)  # type: ignore[call-overload]
        self._curvature = np.convolve(
            padded, np.full(2 * width + 1, 1.0 / (2 * width + 1)), "valid"
        )[:n]

    def poses(self, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return x, y [m] and heading [rad] at progresses [m] of any lap.

        Beyond an end of an open path it continues as a straight line.
        """
        path = self.path
        s_on_path = s if path.closed else np.clip(s, 0.0, path.length)
        k = np.rint(s_on_path / path.spacing).astype(int)
        k = k if path.closed else np.minimum(k, len(path.x) - 1)
        d = s_on_path - k * path.spacing
        i = k % len(path.x)
        yaw = path.heading[i]
        bend = path.curvature[i]
        mean_heading = yaw + 0.5 * bend * d
        heading = yaw + bend * d
        overshoot = s - s_on_path
        return (
            path.x[i] + d * np.cos(mean_heading) + overshoot * np.cos(heading),
            path.y[i] + d * np.sin(mean_heading) + overshoot * np.sin(heading),
            heading,
        )

    def curvatures(self, s: FloatArray) -> FloatArray:
        """Return the averaged curvature [1/m] at progresses [m]."""
        k = np.rint(s / self.path.spacing).astype(int)
        n = len(self._curvature)
        bends: FloatArray = self._curvature[k % n if self.path.closed else np.clip(k, 0, n - 1)]
        return bends

    def errors(self, x: FloatArray, y: FloatArray, s: FloatArray) -> PathErrors:
        """Return the errors of positions x, y [m] relative to progresses s [m]."""
        x_r, y_r, phi = self.poses(s)
        c = np.cos(phi)
        d = np.sin(phi)
        bend = self.curvatures(s)
        across = c * (y - y_r) - d * (x - x_r)
        along = c * (x - x_r) + d * (y - y_r)
        # d e_c / d(x, y, s) = (-sin, cos, -k e_l),  d e_l / d(x, y, s) = (cos, sin, k e_c - 1).
        return PathErrors(
            across,
            along,
            np.stack([-d, c, -bend * along], axis=1),
            np.stack([c, d, bend * across - 1.0], axis=1),
        )
