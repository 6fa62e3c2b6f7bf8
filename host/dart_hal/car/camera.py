"""``car.camera``: images polled at each chunk, recorded, told in States."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any

from dart_hal.core.errors import DartHalError, UsageError
from dart_hal.core.ports import ImageSource
from dart_hal.core.types import Image, State
from dart_hal.devices.camera import open_camera
from dart_hal.devices.camera.health import CameraHealth, Watch
from dart_hal.devices.links.base import Backend

KEPT = 16
"""Images that wait for ``images``: 1 s; of a program that never asks the oldest are dropped."""


class CarCamera:
    """The camera of an open car. lock(): held while what came is read.

    ``record`` is called with each image.
    """

    def __init__(self, source: ImageSource,
                 lock: Callable[[], AbstractContextManager[Any]]) -> None:
        self.record: Callable[[Image], None] = lambda image: None
        self._source, self._lock = source, lock
        self._newest: Image | None = None
        self._waiting: deque[Image] = deque(maxlen=KEPT)
        self._watch = Watch()
        self._early: deque[Image] = deque(maxlen=KEPT)

    def images(self) -> tuple[Image, ...]:
        """Return the images that came since the last call, at most the newest 16.

        ``State.image`` is the newest alone. Empty while none come: ``trouble`` says why.
        """
        with self._lock():
            came = tuple(self._waiting)
            self._waiting.clear()
            return came

    @property
    def trouble(self) -> DartHalError | None:
        """Why no images come; None while they do."""
        return self._source.trouble

    @property
    def health(self) -> CameraHealth | None:
        """What the last 2 s of images say about the camera; None before the second."""
        with self._lock():
            return self._watch.health()

    def take(self, states: list[State], t: float, now: float) -> list[State]:
        """States of a chunk that arrived at ``t``, with the newest image that was there by then.

        What arrived later waits, so that a replay sees the same. now [s]: the car's clock.
        """
        self._early.extend(self._source.poll(now))
        while self._early and self._early[0].arrival <= t:
            self._newest = image = self._early.popleft()
            self.record(image)
            self._waiting.append(image)
            self._watch.add(image)
        return [replace(state, image=self._newest) for state in states]


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
