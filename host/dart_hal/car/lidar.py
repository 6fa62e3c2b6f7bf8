"""``car.lidar``: scans polled at each chunk, mounted by the files, recorded, told in States."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from dart_hal.core.config import CarFiles
from dart_hal.core.config.calibration import LidarCalibration
from dart_hal.core.errors import DartHalError
from dart_hal.core.ports import ScanSource
from dart_hal.core.types import Mount, Scan, State
from dart_hal.devices.lidar import open_lidar
from dart_hal.devices.lidar.health import LidarHealth, Watch
from dart_hal.devices.links.base import Backend

if TYPE_CHECKING:
    from dart_hal.estimation.localisation.source import LidarPoses

KEPT = 64
"""Scans that wait for ``scans``: 8 s; of a program that never asks the oldest are dropped."""
AXIS_X = 0.13
"""m of the axis before the rear axle where no file says it: the drawing of the base plate."""


class CarLidar:
    """The lidar of an open car. lock(): held while what came is read.

    ``record`` is called with each scan as the unit told it; ``localiser`` gets each as it is
    mounted.
    """

    def __init__(self, source: ScanSource, mount: Mount,
                 lock: Callable[[], AbstractContextManager[Any]]) -> None:
        self.record: Callable[[Scan], None] = lambda scan: None
        self.localiser: LidarPoses | None = None
        self._source, self._mount, self._lock = source, mount, lock
        self._newest: Scan | None = None
        self._waiting: deque[Scan] = deque(maxlen=KEPT)
        self._watch = Watch()
        self._yaw = 0.0
        self._early: deque[Scan] = deque()

    def scans(self) -> tuple[Scan, ...]:
        """Return the revolutions that are whole since the last call, at most the newest 64.

        ``State.scan`` is the newest alone. Empty while none come: ``trouble`` says why.
        """
        with self._lock():
            came = tuple(self._waiting)
            self._waiting.clear()
            return came

    @property
    def trouble(self) -> DartHalError | None:
        """Why no scans come; None while they do."""
        return self._source.trouble

    @property
    def health(self) -> LidarHealth | None:
        """What the last 2 s of scans say about the lidar; None before the first."""
        with self._lock():
            return self._watch.health()

    @property
    def located(self) -> bool:
        """Whether the newest scan told where the car is, on ``poses="lidar:map.yaml"``.

        A pose that is missing since then is missing because no scan came.
        """
        newest = self.localiser.newest if self.localiser is not None else None
        return newest is not None and newest.pose is not None

    def take(self, states: list[State], t: float, now: float) -> list[State]:
        """States of a chunk that arrived at ``t``, with the newest scan that was there by then.

        What arrived later waits, so that a replay sees the same. now [s]: the car's clock.
        """
        self._early.extend(self._source.poll(now))
        self._yaw = states[-1].pose.yaw if states else self._yaw
        while self._early and self._early[0].arrival <= t:
            scan = self._early.popleft()
            self.record(scan)
            self._newest = scan.mounted(self._mount)
            self._waiting.append(self._newest)
            if self.localiser is not None:
                self.localiser.add(self._newest)
            self._watch.add(self._newest, self._yaw)
        return [replace(state, scan=self._newest) for state in states]


def mount_of(files: CarFiles) -> Mount:
    """How the lidar of a car sits, by ``calibrate lidar``, else by its car.toml."""
    told, x = files.config.lidar, files.config.geometry.lidar_x
    given = (AXIS_X if x is None else x, told.y, told.mount_yaw, told.scale)
    table = files.calibration.lidar if files.calibration else LidarCalibration()
    measured = (table.mount_x, table.mount_y, table.mount_yaw, table.scale)
    x, y, yaw, scale = (m.value if m else g for m, g in zip(measured, given, strict=True))
    return Mount(x, y, yaw, told.inverted, scale)


def give_lidar(backend: Backend, lidar: str | ScanSource | None) -> None:
    """Let ``lidar``, else $DART_HAL_LIDAR, be the lidar of a backend that has none of its own.

    A recording keeps the scans that it holds. Raises what ``open_lidar`` raises.
    """
    if lidar is None and backend.lidar is None and backend.bus is not None:
        lidar = os.environ.get("DART_HAL_LIDAR") or None
    if lidar is not None:
        backend.lidar = open_lidar(lidar) if isinstance(lidar, str) else lidar
    if backend.lidar is not None:
        backend.closers += (backend.lidar.close,)
