"""A top view of track and cars, drawn without a plotting library."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dart_hal.control.tracks import track_named
from dart_hal.core.types import FloatArray
from dart_hal.vehicle import Body
from dart_lab.sim.gym.config import GymConfig

SIZE, MARGIN = 480, 0.4
"""Pixels of the longer side; m around the track."""
OTHER = (0, 114, 178)
GRASS, ROAD, LINE, CAR, NOSE = ((236, 240, 232), (208, 208, 208), (150, 150, 150),
                                (213, 94, 0), (40, 40, 40))
OVERHANG, WIDTH = 0.06, 0.19
"""m of body before and behind the axles, and across."""


class Picture:
    """The track as a background, on which cars are drawn."""

    def __init__(self, c: GymConfig) -> None:
        if c.task == "path":
            track = track_named(c.track)
            x, y, half = track.x, track.y, c.half_width
        else:
            x, y = np.arange(0.0, c.speed * c.episode, 0.05), np.zeros(1)
            x, y, half = x, np.zeros_like(x), 0.3
        low = np.array([x.min(), y.min()]) - half - MARGIN
        high = np.array([x.max(), y.max()]) + half + MARGIN
        self._per_pixel = float((high - low).max()) / SIZE
        self._low, self._top = low, high[1]
        columns, rows = (max(32, math.ceil(v / self._per_pixel)) for v in high - low)
        self.background: NDArray[np.uint8] = np.full((rows, columns, 3), GRASS, dtype=np.uint8)
        self._spot(x, y, half, ROAD)
        self._spot(x, y, 0.0, LINE)

    def draw(self, poses: Sequence[Sequence[float]], body: Body,
             others: Sequence[Sequence[float]] = ()) -> NDArray[np.uint8]:
        """The picture with cars at (x, y, yaw) of their centres of mass; others: of their rear
        axles."""
        image: NDArray[np.uint8] = self.background.copy()
        for x, y, yaw in others:
            self._box(image, x, y, yaw, (-OVERHANG, body.wheelbase + OVERHANG), OTHER)
        for x, y, yaw in poses:
            front, rear = body.l_f + OVERHANG, body.l_r + OVERHANG
            self._box(image, x, y, yaw, (-rear, front), CAR)
            self._box(image, x, y, yaw, (front - 0.05, front), NOSE)
        return image

    def _pixels(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        return (self._top - y) / self._per_pixel, (x - self._low[0]) / self._per_pixel

    def _spot(self, x: FloatArray, y: FloatArray, radius: float, colour: Sequence[int]) -> None:
        """Discs (or points) at all places."""
        row, column = (np.floor(v).astype(int) for v in self._pixels(x, y))
        reach = math.ceil(radius / self._per_pixel)
        span = np.arange(-reach, reach + 1)
        inside = np.hypot(*np.meshgrid(span, span)) * self._per_pixel <= radius
        height, width = self.background.shape[:2]
        for dr, dc in zip(*(span[k] for k in np.nonzero(inside)), strict=True):
            r, c = row + dr, column + dc
            good = (r >= 0) & (r < height) & (c >= 0) & (c < width)
            self.background[r[good], c[good]] = colour

    def _box(self, image: NDArray[np.uint8], x: float, y: float, yaw: float,
             along: tuple[float, float], colour: Sequence[int]) -> None:
        reach = math.ceil((max(map(abs, along)) + WIDTH) / self._per_pixel)
        r0, c0 = (int(v) for v in self._pixels(np.float64(x), np.float64(y)))
        height, width = image.shape[:2]
        rows = np.arange(max(0, r0 - reach), min(height, r0 + reach + 1))
        columns = np.arange(max(0, c0 - reach), min(width, c0 + reach + 1))
        if not len(rows) or not len(columns):
            return
        dx = self._low[0] + (columns[None, :] + 0.5) * self._per_pixel - x
        dy = self._top - (rows[:, None] + 0.5) * self._per_pixel - y
        u = dx * math.cos(yaw) + dy * math.sin(yaw)
        v = dy * math.cos(yaw) - dx * math.sin(yaw)
        inside = (u >= along[0]) & (u <= along[1]) & (np.abs(v) <= 0.5 * WIDTH)
        image[rows[0]:rows[-1] + 1, columns[0]:columns[-1] + 1][inside] = colour
