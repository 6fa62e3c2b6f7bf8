"""Alignment of an estimated path with the true one: the origin of a map is arbitrary."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """Rigid motion from the frame of a map to that of the truth.

    turn [rad], then shift (2,) [m]; size: of the true path over that of the other. It is reported,
    not corrected.
    """

    turn: float
    shift: FloatArray
    size: float = 1.0

    def transform(self, points: FloatArray) -> FloatArray:
        """Transform points (n, 2) [m] of the map to the frame of the truth."""
        c = np.cos(self.turn)
        s = np.sin(self.turn)
        moved: FloatArray = points @ np.array(((c, s), (-s, c))) + self.shift
        return moved


def align_points(points: FloatArray, true: FloatArray) -> Alignment:
    """Return the rigid motion of points (n, 2) [m] to the true ones by least squares."""
    a = points - points.mean(axis=0)
    b = true - true.mean(axis=0)
    turn = float(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
    centre = Alignment(turn, np.zeros(2)).transform(points).mean(axis=0)
    size = float(np.sqrt((b * b).sum() / (a * a).sum()))
    return Alignment(turn, true.mean(axis=0) - centre, size)
