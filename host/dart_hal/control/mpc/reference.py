"""Where a path is at a progress s, and how a pose lies beside it.

    e_c = cos(phi) (y - y_r) - sin(phi) (x - x_r)     across, left positive
    e_l = cos(phi) (x - x_r) + sin(phi) (y - y_r)     along

with slopes to the progress of -k e_l and k e_c - 1. The curvature is a mean over ``SMOOTH``, as
a step of it is more than any wheel can follow.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dart_hal.control.paths import Path
from dart_hal.core.types import FloatArray

# m.
SMOOTH = 0.2


class Errors(NamedTuple):
    """across, along [m] (n,); slopes of each to (x, y, s) (n, 3)."""

    across: FloatArray
    along: FloatArray
    across_slopes: FloatArray
    along_slopes: FloatArray


class Reference:
    """A path for many stages at once."""

    def __init__(self, path: Path) -> None:
        self.path = path
        width = max(1, round(0.5 * SMOOTH / path.spacing))
        n = len(path.x)
        mode = "wrap" if path.closed else "edge"
        padded = np.pad(path.curvature, width, mode=mode)  # type: ignore[call-overload]
        self._curvature = np.convolve(
            padded, np.full(2 * width + 1, 1.0 / (2 * width + 1)), "valid"
        )[:n]

    def spots(self, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """x, y [m], heading [rad] at progresses [m] of any lap; beyond an end straight on."""
        path = self.path
        inside = s if path.closed else np.clip(s, 0.0, path.length)
        k = np.rint(inside / path.spacing).astype(int)
        k = k if path.closed else np.minimum(k, len(path.x) - 1)
        d = inside - k * path.spacing
        i = k % len(path.x)
        yaw = path.heading[i]
        bend = path.curvature[i]
        middle = yaw + 0.5 * bend * d
        end = yaw + bend * d
        beyond = s - inside
        return (
            path.x[i] + d * np.cos(middle) + beyond * np.cos(end),
            path.y[i] + d * np.sin(middle) + beyond * np.sin(end),
            end,
        )

    def curvatures(self, s: FloatArray) -> FloatArray:
        """Curvature [1/m] there."""
        k = np.rint(s / self.path.spacing).astype(int)
        n = len(self._curvature)
        bends: FloatArray = self._curvature[k % n if self.path.closed else np.clip(k, 0, n - 1)]
        return bends

    def errors(self, x: FloatArray, y: FloatArray, s: FloatArray) -> Errors:
        """Of positions [m] at progresses [m]."""
        x_r, y_r, phi = self.spots(s)
        c = np.cos(phi)
        d = np.sin(phi)
        bend = self.curvatures(s)
        across = c * (y - y_r) - d * (x - x_r)
        along = c * (x - x_r) + d * (y - y_r)
        return Errors(
            across,
            along,
            np.stack([-d, c, -bend * along], axis=1),
            np.stack([c, d, bend * across - 1.0], axis=1),
        )
