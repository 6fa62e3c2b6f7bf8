"""Images of an open car: polled at each chunk, recorded, told in States."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from dataclasses import replace

from dart_hal.core.errors import UsageError
from dart_hal.core.ports import ImageSource
from dart_hal.core.types import Image, State
from dart_hal.devices.camera import open_camera
from dart_hal.devices.camera.health import Watch
from dart_hal.devices.links.base import Backend

KEPT = 16
"""Images that wait for ``Car.images``: 1 s; of a program that never asks the oldest are dropped."""


class ImageFeed:
    """One per open car with a camera. ``record`` is called with each image."""

    def __init__(self, source: ImageSource) -> None:
        self.source = source
        self.record: Callable[[Image], None] = lambda image: None
        self.newest: Image | None = None
        self.waiting: deque[Image] = deque(maxlen=KEPT)
        self.watch = Watch()
        self._early: deque[Image] = deque(maxlen=KEPT)

    def take(self, states: list[State], t: float, now: float) -> list[State]:
        """States of a chunk that arrived at ``t``, with the newest image that was there by then.

        What arrived later waits, so that a replay sees the same. now [s]: the car's clock.
        """
        self._early.extend(self.source.poll(now))
        while self._early and self._early[0].arrival <= t:
            self.newest = image = self._early.popleft()
            self.record(image)
            self.waiting.append(image)
            self.watch.add(image)
        return [replace(state, image=self.newest) for state in states]

    def taken(self) -> tuple[Image, ...]:
        """Those that came since the last call."""
        came = tuple(self.waiting)
        self.waiting.clear()
        return came


def give_camera(backend: Backend, camera: str | ImageSource | None) -> None:
    """Let ``camera``, else $DART_HAL_CAMERA, be the camera of a backend that has none of its own.

    A recording keeps the images that it holds. Raises what ``open_camera`` raises.
    """
    if camera is None and backend.camera is None and backend.bus is not None:
        camera = os.environ.get("DART_HAL_CAMERA") or None
    if camera is not None:
        backend.camera = camera_of(backend, camera) if isinstance(camera, str) else camera
    if backend.camera is not None:
        backend.closers += (backend.camera.close,)


def camera_of(backend: Backend, name: str) -> ImageSource:
    """One that a backend has by this name, else one of this computer. Raises as ``give_camera``."""
    if name in backend.cameras:
        return backend.cameras[name]()
    if backend.virtual:
        raise UsageError(f"camera={name}: {backend.url.text} stands still while its program "
                         "computes, a camera does not", found=name,
                         expected=", ".join(backend.cameras) or "a car in real time",
                         remedy="sim://?pace=1 for a real camera beside an emulated car")
    return open_camera(name)
