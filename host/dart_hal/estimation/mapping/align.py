"""Laying a path onto a true one: where the origin of a map lies is nobody's error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Laid:
    """turn [rad], then shift (2,) [m]: from the frame of a map into that of the truth; size: of the
    true path over that of the other, which is told and not made good."""

    turn: float
    shift: FloatArray
    size: float = 1.0

    def room(self, points: FloatArray) -> FloatArray:
        """Points (n, 2) [m] of the map in the room."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        there: FloatArray = points @ np.array(((c, s), (-s, c))) + self.shift
        return there


def laid(points: FloatArray, true: FloatArray) -> Laid:
    """The motion that brings points (n, 2) [m] next to the true ones, by least squares."""
    a, b = points - points.mean(axis=0), true - true.mean(axis=0)
    turn = float(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
    there = Laid(turn, np.zeros(2)).room(points).mean(axis=0)
    return Laid(turn, true.mean(axis=0) - there, float(np.sqrt((b * b).sum() / (a * a).sum())))
