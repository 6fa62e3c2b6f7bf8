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

# Pixels of the longer side of the image, and margin around the track [m].
IMAGE_SIDE = 480
TRACK_MARGIN = 0.4
OTHER_COLOUR = (0, 114, 178)
GRASS_COLOUR = (236, 240, 232)
ROAD_COLOUR = (208, 208, 208)
LINE_COLOUR = (150, 150, 150)
CAR_COLOUR = (213, 94, 0)
NOSE_COLOUR = (40, 40, 40)
# Length of the body beyond each axle, and its width [m].
OVERHANG = 0.06
BODY_WIDTH = 0.19


class TrackPicture:
    """The track as a background, on which cars are drawn."""

    def __init__(self, c: GymConfig) -> None:
        if c.task == "path":
            track = track_named(c.track)
            x = track.x
            y = track.y
            half = c.half_width
        else:
            x = np.arange(0.0, c.speed * c.episode, 0.05)
            y = np.zeros_like(x)
            half = 0.3
        low = np.array([x.min(), y.min()]) - half - TRACK_MARGIN
        high = np.array([x.max(), y.max()]) + half + TRACK_MARGIN
        self._per_pixel = float((high - low).max()) / IMAGE_SIDE
        self._low = low
        self._top = high[1]
        columns, rows = (max(32, math.ceil(v / self._per_pixel)) for v in high - low)
        self.background: NDArray[np.uint8] = np.full((rows, columns, 3), GRASS_COLOUR,
                                                     dtype=np.uint8)
        self._paint_discs(x, y, half, ROAD_COLOUR)
        self._paint_discs(x, y, 0.0, LINE_COLOUR)

    def draw(self, poses: Sequence[Sequence[float]], body: Body,
             others: Sequence[Sequence[float]] = ()) -> NDArray[np.uint8]:
        """Return the picture with cars; poses: of centres of mass, others: of rear axles."""
        image: NDArray[np.uint8] = self.background.copy()
        for x, y, yaw in others:
            self._paint_box(image, x, y, yaw, (-OVERHANG, body.wheelbase + OVERHANG), OTHER_COLOUR)
        for x, y, yaw in poses:
            front = body.l_f + OVERHANG
            rear = body.l_r + OVERHANG
            self._paint_box(image, x, y, yaw, (-rear, front), CAR_COLOUR)
            self._paint_box(image, x, y, yaw, (front - 0.05, front), NOSE_COLOUR)
        return image

    def _pixels(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        return (self._top - y) / self._per_pixel, (x - self._low[0]) / self._per_pixel

    def _paint_discs(self, x: FloatArray, y: FloatArray, radius: float,
                     colour: Sequence[int]) -> None:
        """Paint discs, or points with radius 0, at all positions."""
        row, column = (np.floor(v).astype(int) for v in self._pixels(x, y))
        reach = math.ceil(radius / self._per_pixel)
        span = np.arange(-reach, reach + 1)
        inside = np.hypot(*np.meshgrid(span, span)) * self._per_pixel <= radius
        height, width = self.background.shape[:2]
        for dr, dc in zip(*(span[k] for k in np.nonzero(inside)), strict=True):
            r = row + dr
            c = column + dc
            good = (r >= 0) & (r < height) & (c >= 0) & (c < width)
            self.background[r[good], c[good]] = colour

    def _paint_box(self, image: NDArray[np.uint8], x: float, y: float, yaw: float,
             extent: tuple[float, float], colour: Sequence[int]) -> None:
        reach = math.ceil((max(map(abs, extent)) + BODY_WIDTH) / self._per_pixel)
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
        inside = (u >= extent[0]) & (u <= extent[1]) & (np.abs(v) <= 0.5 * BODY_WIDTH)
        image[rows[0]:rows[-1] + 1, columns[0]:columns[-1] + 1][inside] = colour
