"""``car.camera``: images that are polled at each chunk, recorded, and put into States."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from dart_hal.core.errors import DartHalError, UsageError
from dart_hal.core.ports import ImageSource
from dart_hal.core.types import Image, State
from dart_hal.devices.links.base import Backend

if TYPE_CHECKING:
    from dart_hal.devices.camera.health import CameraHealth

# Images that wait for ``images``, about 1 s; beyond, the oldest are dropped.
MAX_QUEUED_IMAGES = 16


class CarCamera:
    """Camera of an open car, reached by ``car.camera``.

    source: where the images come from. lock(): lock of the thread that receives them.
    ``record`` is called with each image.
    """

    def __init__(self, source: ImageSource,
                 lock: Callable[[], AbstractContextManager[Any]]) -> None:
        # Imported here: a car without a camera needs no camera code.
        from dart_hal.devices.camera.health import CameraHealthMonitor

        self.record: Callable[[Image], None] = lambda image: None
        self._source = source
        self._lock = lock
        self._newest: Image | None = None
        self._waiting: deque[Image] = deque(maxlen=MAX_QUEUED_IMAGES)
        self._watch = CameraHealthMonitor()
        self._early: deque[Image] = deque(maxlen=MAX_QUEUED_IMAGES)

    def images(self) -> tuple[Image, ...]:
        """Return the images since the last call, oldest first, at most the newest 16.

        ``State.image`` is the newest alone. Empty while none arrive: ``trouble`` is the reason.
        """
        with self._lock():
            came = tuple(self._waiting)
            self._waiting.clear()
            return came

    @property
    def trouble(self) -> DartHalError | None:
        """Return why no images arrive; None while they do."""
        return self._source.trouble

    @property
    def health(self) -> CameraHealth | None:
        """Return the condition of the camera over the last 2 s; None before the second image."""
        with self._lock():
            return self._watch.health()

    def take(self, states: list[State], t: float, now: float) -> list[State]:
        """Return the States of a chunk with the newest image that had arrived by then.

        Later images wait for the next chunk, so that a replay, which has only the arrival times,
        gives the same States. t: arrival of the chunk [s]; now: time [s] of the car's clock.
        """
        self._early.extend(self._source.poll(now))
        while self._early and self._early[0].arrival <= t:
            self._newest = image = self._early.popleft()
            self.record(image)
            self._waiting.append(image)
            self._watch.add(image)
        return [replace(state, image=self._newest) for state in states]


def attach_camera(backend: Backend, camera: str | ImageSource | None) -> None:
    """Attach ``camera``, else $DART_HAL_CAMERA, to a backend that has no camera of its own.

    A recording keeps its own images. Raises what ``open_camera`` raises.
    """
    if camera is None and backend.camera is None and backend.bus is not None:
        camera = os.environ.get("DART_HAL_CAMERA") or None
    if camera is not None:
        backend.camera = open_named_camera(backend, camera) if isinstance(camera, str) else camera
    if backend.camera is not None:
        backend.closers += (backend.camera.close,)


def open_named_camera(backend: Backend, name: str) -> ImageSource:
    """Open a camera of the backend by its name, else one of this computer.

    Raises as ``attach_camera``.
    """
    if name in backend.cameras:
        return backend.cameras[name]()
    if backend.virtual:
        raise UsageError(f"camera={name}: {backend.url.text} waits while its program "
                         "computes, a camera does not", found=name,
                         expected=", ".join(backend.cameras) or "a car in real time",
                         remedy="sim://?pace=1 for a real camera with an emulated car")
    from dart_hal.devices.camera import open_camera

    return open_camera(name)
