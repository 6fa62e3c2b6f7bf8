"""A simulated camera at the ceiling: images of the room, of the car and of its path.

In a room of ``map`` the camera is fixed and shows the whole room. Without one it follows the car,
in steps of a metre. Images are stamped by the world's clock, so the same run gives the same images.
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
from dart_lab.sim.lidar.maps import RoomMap, box
from dart_lab.sim.lidar.unit import Others, Poses
from dart_lab.sim.light.world import CAR_OUTLINE

# Time between two images [s], 12.5 per second: whole ticks of the world and of its telemetry.
IMAGE_PERIOD = 0.08
# Time from an image to its arrival [s]: exposure, transfer and coding of a USB camera.
IMAGE_LATENCY = 0.05
# Width and height [px]: 6 kB per image, 75 kB per second.
IMAGE_SIZE = (320, 240)
# Width and height of the visible floor without a room [m].
FLOOR_SPAN = (6.0, 4.5)
# Visible margin around a room [m].
ROOM_MARGIN = 0.3
# Points of the path that is drawn: 8 s.
MAX_PATH_POINTS = 100
# Images are drawn this much larger and reduced, which smooths the edges.
OVERSAMPLING = 2
FLOOR_COLOUR = "#c9c6bf"
TILE_COLOUR = "#b9b6ae"
WALL_COLOUR = "#3b3f46"
PATH_COLOUR = "#0072b2"
OTHER_COLOUR = "#8a6d3b"
CAR_COLOUR = "#c8102e"
NOSE_COLOUR = "#f5f6f8"
_NO_LINES = np.empty((0, 4))


class TopView:
    """``ImageSource`` of a world.

    poses: of its car; room: where it drives, or None; start: pose x, y [m], yaw [rad] of the
    world's origin; others: lines of other cars. Raises UsageError if Pillow is not installed.
    """

    name = "the camera of sim://"
    trouble: DartHalError | None = None

    def __init__(self, poses: Poses, room: RoomMap | None, start: tuple[float, float, float],
                 others: Others | None = None) -> None:
        self._draw, self._image = _import_pillow()
        self._poses = poses
        self._start = start
        self._others = others
        self._walls = _NO_LINES if room is None else np.vstack((room.lines, room.glass))
        self._follows = room is None
        self._middle, self._scale = _fit_view(self._walls)
        self._path: deque[tuple[float, float]] = deque(maxlen=MAX_PATH_POINTS)
        self._count = 0
        self._ready: deque[Image] = deque()

    def poll(self, now: float) -> list[Image]:
        """Return the images that have arrived by ``now``, in the world's time [s]."""
        while self._count * IMAGE_PERIOD + IMAGE_LATENCY <= now:
            t = self._count * IMAGE_PERIOD
            self._count += 1
            self._ready.append(Image(t + IMAGE_LATENCY, t, self._render(t)))
        arrived = list(self._ready)
        self._ready.clear()
        return arrived

    def close(self) -> None:
        """Do nothing: there is nothing to release."""

    def _render(self, t: float) -> bytes:
        (x, y, yaw), = self._poses(np.array([t]))
        x0, y0, yaw0 = self._start
        c = cos(yaw0)
        s = sin(yaw0)
        # From the frame of the start to that of the room.
        x, y, yaw = x0 + c * x - s * y, y0 + s * x + c * y, yaw0 + yaw
        self._path.append((x, y))
        if self._follows:
            self._middle = (float(np.round(x)), float(np.round(y)))
        size = (IMAGE_SIZE[0] * OVERSAMPLING, IMAGE_SIZE[1] * OVERSAMPLING)
        image = self._image.new("RGB", size, FLOOR_COLOUR)
        pen = self._draw.Draw(image)
        self._draw_tiles(pen)
        for a, b, d, e in self._walls.tolist():
            pen.line([*self._pixel(a, b), *self._pixel(d, e)], WALL_COLOUR, 3 * OVERSAMPLING)
        if len(self._path) > 1:
            points = [v for point in self._path for v in self._pixel(*point)]
            pen.line(points, PATH_COLOUR, OVERSAMPLING)
        for a, b, d, e in () if self._others is None else self._others(t).tolist():
            pen.line([*self._pixel(a, b), *self._pixel(d, e)], OTHER_COLOUR, 2 * OVERSAMPLING)
        self._draw_car(pen, x, y, yaw)
        out = io.BytesIO()
        image.reduce(OVERSAMPLING).save(out, "JPEG", quality=80)
        return out.getvalue()

    def _pixel(self, x: float, y: float) -> tuple[float, float]:
        """Return the pixel of a point x, y [m]: x to the right, y up."""
        return (OVERSAMPLING * (0.5 * IMAGE_SIZE[0] + self._scale * (x - self._middle[0])),
                OVERSAMPLING * (0.5 * IMAGE_SIZE[1] - self._scale * (y - self._middle[1])))

    def _draw_tiles(self, pen: ModuleType) -> None:
        """Draw tiles of half a metre, so that motion is visible on an empty floor."""
        w, h = (0.5 * size / self._scale for size in IMAGE_SIZE)
        x, y = self._middle
        for v in np.arange(np.ceil(2.0 * (x - w)), 2.0 * (x + w)) / 2.0:
            pen.line([*self._pixel(v, y - h), *self._pixel(v, y + h)], TILE_COLOUR, OVERSAMPLING)
        for v in np.arange(np.ceil(2.0 * (y - h)), 2.0 * (y + h)) / 2.0:
            pen.line([*self._pixel(x - w, v), *self._pixel(x + w, v)], TILE_COLOUR, OVERSAMPLING)

    def _draw_car(self, pen: ModuleType, x: float, y: float, yaw: float) -> None:
        c = cos(yaw)
        s = sin(yaw)
        middle = x + CAR_OUTLINE.ahead * c, y + CAR_OUTLINE.ahead * s
        corners = box(*middle, yaw, CAR_OUTLINE.length, CAR_OUTLINE.width)[:, :2].tolist()
        pen.polygon([self._pixel(*corner) for corner in corners], fill=CAR_COLOUR)
        nose = middle[0] + 0.5 * CAR_OUTLINE.length * c, middle[1] + 0.5 * CAR_OUTLINE.length * s
        pen.line([*self._pixel(*middle), *self._pixel(*nose)], NOSE_COLOUR, 2 * OVERSAMPLING)


def _fit_view(walls: FloatArray) -> tuple[tuple[float, float], float]:
    """Return the centre [m] and the scale [px/m] of an image that shows all walls."""
    if not len(walls):
        return (0.0, 0.0), IMAGE_SIZE[0] / FLOOR_SPAN[0]
    ends = walls.reshape(-1, 2)
    low = ends.min(axis=0)
    high = ends.max(axis=0)
    middle = 0.5 * (low + high)
    size = high - low + 2.0 * ROOM_MARGIN
    return (float(middle[0]), float(middle[1])), float((np.array(IMAGE_SIZE) / size).min())


def _import_pillow() -> tuple[ModuleType, ModuleType]:
    try:
        from PIL import Image as PILImage
        from PIL import ImageDraw
    except ImportError as why:
        raise UsageError("the camera of sim:// needs Pillow", found="it is not installed",
                         remedy=install_command("camera")) from why
    return ImageDraw, PILImage
