"""An emulated camera below the ceiling: what it sees of the room, of the car and of its way.

In a room of ``map`` it hangs still and sees all of it; without one it goes with the car, a metre
at a time. It tells by the world's clock, so the same run gives the same images.
"""

from __future__ import annotations

import io
from collections import deque
from math import cos, sin
from types import ModuleType

import numpy as np

from dart_hal.core.errors import DartHalError, UsageError
from dart_hal.core.process.extras import install_command
from dart_hal.core.types import FloatArray, Image
from dart_lab.sim.lidar.maps import Room, box
from dart_lab.sim.lidar.unit import Others, Poses
from dart_lab.sim.light.world import Outline

EVERY = 0.08
"""s between two images, 12.5 a second: whole ticks of the world and of its telemetry."""
LATENCY = 0.05
"""s from an image to its arrival: exposure, transfer and coding of a USB camera."""
SIZE = (320, 240)
"""px: 6 kB an image, 75 kB a second."""
SPAN = (6.0, 4.5)
"""m of floor that are seen without a room."""
AROUND = 0.3
"""m around a room."""
KEPT = 100
"""Places of the way that is drawn: 8 s."""
FINE = 2
"""Drawn so much larger and reduced: edges are smooth."""
FLOOR, TILE, WALL, WAY, OTHER = "#c9c6bf", "#b9b6ae", "#3b3f46", "#0072b2", "#8a6d3b"
CAR, NOSE = "#c8102e", "#f5f6f8"
BODY = Outline()
_NOWHERE = np.empty((0, 4))


class TopView:
    """``ImageSource`` of a world. poses: of its car; room: None, or in which it drives; start: x, y
    [m], yaw [rad] of where the world begins; others: what moves there beside it. Raises UsageError
    where Pillow is not installed."""

    name = "the camera of sim://"
    trouble: DartHalError | None = None

    def __init__(self, poses: Poses, room: Room | None, start: tuple[float, float, float],
                 others: Others | None = None) -> None:
        self._draw, self._image = _pillow()
        self._poses, self._start, self._others = poses, start, others
        self._walls = _NOWHERE if room is None else np.vstack((room.lines, room.glass))
        self._follows = room is None
        self._middle, self._scale = _fitted(self._walls)
        self._way: deque[tuple[float, float]] = deque(maxlen=KEPT)
        self._count = 0
        self._ready: deque[Image] = deque()

    def poll(self, now: float) -> list[Image]:
        """Images that have arrived at ``now``, the world's time [s]."""
        while self._count * EVERY + LATENCY <= now:
            t = self._count * EVERY
            self._count += 1
            self._ready.append(Image(t + LATENCY, t, self._taken(t)))
        came = list(self._ready)
        self._ready.clear()
        return came

    def close(self) -> None:
        """Nothing is held."""

    def _taken(self, t: float) -> bytes:
        (x, y, yaw), = self._poses(np.array([t]))
        x0, y0, yaw0 = self._start
        c, s = cos(yaw0), sin(yaw0)
        x, y, yaw = x0 + c * x - s * y, y0 + s * x + c * y, yaw0 + yaw
        self._way.append((x, y))
        if self._follows:
            self._middle = (float(np.round(x)), float(np.round(y)))
        image = self._image.new("RGB", (SIZE[0] * FINE, SIZE[1] * FINE), FLOOR)
        pen = self._draw.Draw(image)
        self._tiles(pen)
        for a, b, d, e in self._walls.tolist():
            pen.line([*self._px(a, b), *self._px(d, e)], WALL, 3 * FINE)
        if len(self._way) > 1:
            pen.line([v for place in self._way for v in self._px(*place)], WAY, FINE)
        for a, b, d, e in () if self._others is None else self._others(t).tolist():
            pen.line([*self._px(a, b), *self._px(d, e)], OTHER, 2 * FINE)
        self._car(pen, x, y, yaw)
        out = io.BytesIO()
        image.reduce(FINE).save(out, "JPEG", quality=80)
        return out.getvalue()

    def _px(self, x: float, y: float) -> tuple[float, float]:
        """Of a place [m]: x to the right, y up."""
        return (FINE * (0.5 * SIZE[0] + self._scale * (x - self._middle[0])),
                FINE * (0.5 * SIZE[1] - self._scale * (y - self._middle[1])))

    def _tiles(self, pen: ModuleType) -> None:
        """Half a metre wide, so that a floor without anything shows that the car moves."""
        half = [0.5 * size / self._scale for size in SIZE]
        (x, y), (w, h) = self._middle, half
        for at in np.arange(np.ceil(2.0 * (x - w)), 2.0 * (x + w)) / 2.0:
            pen.line([*self._px(at, y - h), *self._px(at, y + h)], TILE, FINE)
        for at in np.arange(np.ceil(2.0 * (y - h)), 2.0 * (y + h)) / 2.0:
            pen.line([*self._px(x - w, at), *self._px(x + w, at)], TILE, FINE)

    def _car(self, pen: ModuleType, x: float, y: float, yaw: float) -> None:
        c, s = cos(yaw), sin(yaw)
        middle = x + BODY.ahead * c, y + BODY.ahead * s
        corners = box(*middle, yaw, BODY.length, BODY.width)[:, :2].tolist()
        pen.polygon([self._px(*corner) for corner in corners], fill=CAR)
        nose = middle[0] + 0.5 * BODY.length * c, middle[1] + 0.5 * BODY.length * s
        pen.line([*self._px(*middle), *self._px(*nose)], NOSE, 2 * FINE)


def _fitted(walls: FloatArray) -> tuple[tuple[float, float], float]:
    """Middle [m] and scale [px/m] with which all walls are in the image."""
    if not len(walls):
        return (0.0, 0.0), SIZE[0] / SPAN[0]
    ends = walls.reshape(-1, 2)
    low, high = ends.min(axis=0), ends.max(axis=0)
    middle = 0.5 * (low + high)
    size = high - low + 2.0 * AROUND
    return (float(middle[0]), float(middle[1])), float((np.array(SIZE) / size).min())


def _pillow() -> tuple[ModuleType, ModuleType]:
    try:
        from PIL import Image as PILImage
        from PIL import ImageDraw
    except ImportError as why:
        raise UsageError("the camera of sim:// needs Pillow", found="it is not installed",
                         remedy=install_command("camera")) from why
    return ImageDraw, PILImage
