"""What an open car sees beside the telemetry of its Nano: scans of a lidar, images of a camera."""

from __future__ import annotations

from dart_hal.car.engine import Engine
from dart_hal.core.errors import DartHalError
from dart_hal.core.types import Image, Scan
from dart_hal.devices.camera.health import CameraHealth
from dart_hal.devices.lidar.health import LidarHealth


class Sensed:
    """Part of ``Car``."""

    _engine: Engine

    def scans(self) -> tuple[Scan, ...]:
        """Revolutions of the lidar that are whole since the last call, at most the newest 64.

        ``State.scan`` is the newest alone. Empty without a lidar: ``lidar_trouble`` says why.
        """
        with self._engine.lock:
            return self._engine.scans.taken() if self._engine.scans else ()

    @property
    def has_lidar(self) -> bool:
        """Whether one was named, or comes with the URL."""
        return self._engine.scans is not None

    @property
    def lidar_trouble(self) -> DartHalError | None:
        """Why no scans come from a lidar that was named; None while they do, or none was."""
        return self._engine.scans.source.trouble if self._engine.scans else None

    @property
    def lidar_health(self) -> LidarHealth | None:
        """What the last 2 s of scans say about the lidar; None before the first."""
        with self._engine.lock:
            return self._engine.scans.watch.health() if self._engine.scans else None

    @property
    def lidar_silent(self) -> bool:
        """Whether the newest scan told where the car is: a pose that is missing since then is so
        because no scan came. Never without ``poses="lidar:map.yaml"``."""
        source = self._engine.localiser
        return source is not None and source.newest is not None and source.newest.pose is not None

    def images(self) -> tuple[Image, ...]:
        """Images of the camera that came since the last call, at most the newest 16.

        ``State.image`` is the newest alone. Empty without a camera: ``camera_trouble`` says why.
        """
        with self._engine.lock:
            return self._engine.images.taken() if self._engine.images else ()

    @property
    def has_camera(self) -> bool:
        """Whether one was named, or comes with the URL."""
        return self._engine.images is not None

    @property
    def camera_trouble(self) -> DartHalError | None:
        """Why no images come from a camera that was named; None while they do, or none was."""
        return self._engine.images.source.trouble if self._engine.images else None

    @property
    def camera_health(self) -> CameraHealth | None:
        """What the last 2 s of images say about the camera; None before the second."""
        with self._engine.lock:
            return self._engine.images.watch.health() if self._engine.images else None
