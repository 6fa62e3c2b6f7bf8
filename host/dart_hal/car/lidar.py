"""``car.lidar``: scans that are polled at each chunk, recorded, and put into States."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from math import cos, sin
from typing import TYPE_CHECKING, Any

import numpy as np

from dart_hal.core.config import CarFiles
from dart_hal.core.config.calibration import LidarCalibration
from dart_hal.core.errors import DartHalError
from dart_hal.core.ports import ScanSource
from dart_hal.core.types import FloatArray, Mount, Scan, State
from dart_hal.devices.links.base import Backend

if TYPE_CHECKING:
    from dart_hal.devices.lidar.health import LidarHealth
    from dart_hal.estimation.localisation.source import LidarPoses

# Scans that wait for ``scans``, 8 s; beyond, the oldest are dropped.
MAX_QUEUED_SCANS = 64
# m from the rear axle forward to the axis, where no file states it: drawing of the base plate.
DEFAULT_MOUNT_X = 0.13
# m, m, rad: standard error of a mounting that was not measured: play of the screws in their holes,
# and of the housing on its plate.
UNMEASURED_MOUNT_STD = (0.003, 0.003, 0.03)
# m: half of a small room. Errors of walls this far on both sides turn the car.
WALL_DISTANCE = 2.0


class CarLidar:
    """Lidar of an open car, reached by ``car.lidar``.

    source: where the scans come from. mount: pose of the lidar on the car. lock(): lock of the
    thread that receives them. ``record`` is called with each scan in the frame of the lidar;
    ``localiser`` gets each in the frame of the car.
    """

    def __init__(self, source: ScanSource, mount: Mount,
                 lock: Callable[[], AbstractContextManager[Any]]) -> None:
        # Imported here: a car without a lidar needs no lidar code.
        from dart_hal.devices.lidar.health import LidarHealthMonitor

        self.record: Callable[[Scan], None] = lambda scan: None
        self.localiser: LidarPoses | None = None
        self._source = source
        self._mount = mount
        self._lock = lock
        self._newest: Scan | None = None
        self._waiting: deque[Scan] = deque(maxlen=MAX_QUEUED_SCANS)
        self._watch = LidarHealthMonitor()
        self._yaw = 0.0
        self._early: deque[Scan] = deque()

    def scans(self) -> tuple[Scan, ...]:
        """Return the complete revolutions since the last call, oldest first, at most the newest 64.

        ``State.scan`` is the newest alone. Empty while none arrive: ``trouble`` is the reason.
        """
        with self._lock():
            came = tuple(self._waiting)
            self._waiting.clear()
            return came

    @property
    def trouble(self) -> DartHalError | None:
        """Return why no scans arrive; None while they do."""
        return self._source.trouble

    @property
    def health(self) -> LidarHealth | None:
        """Return the condition of the lidar over the last 2 s; None before the first scan."""
        with self._lock():
            return self._watch.health()

    @property
    def located(self) -> bool:
        """Return whether the newest scan gave a pose, with ``poses="lidar:map.yaml"``.

        If it did and no pose has come since, then no scan has come either.
        """
        newest = self.localiser.newest if self.localiser is not None else None
        return newest is not None and newest.pose is not None

    def take(self, states: list[State], t: float, now: float) -> list[State]:
        """Return the States of a chunk with the newest scan that had arrived by then.

        Later scans wait for the next chunk, so that a replay, which has only the arrival times,
        gives the same States. t: arrival of the chunk [s]; now: time [s] of the car's clock.
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
    """Return the mounting of a car's lidar by ``calibrate lidar``, else by its car.toml."""
    configured = files.config.lidar
    x = files.config.geometry.lidar_x
    given = (DEFAULT_MOUNT_X if x is None else x, configured.y, configured.mount_yaw,
             configured.scale)
    table = files.calibration.lidar if files.calibration else LidarCalibration()
    measured = (table.mount_x, table.mount_y, table.mount_yaw, table.scale)
    x, y, yaw, scale = (m.value if m else g for m, g in zip(measured, given, strict=True))
    return Mount(x, y, yaw, configured.inverted, scale)


def mount_std(files: CarFiles) -> tuple[float, float, float]:
    """Return the standard errors of x, y [m] and yaw [rad] of the mounting.

    Those of ``calibrate lidar``, else of a lidar that was screwed on by hand.
    """
    table = files.calibration.lidar if files.calibration else LidarCalibration()
    x, y, yaw = (m.std if m else usual for m, usual in zip(
        (table.mount_x, table.mount_y, table.mount_yaw), UNMEASURED_MOUNT_STD, strict=True))
    return x, y, yaw


def list_map_errors(map_std: float) -> tuple[float, float, float]:
    """Return the standard errors of x, y [m] and yaw [rad] of a pose by errors of its map.

    map_std [m]: of the places of its walls. They persist while the car sees the same walls.
    """
    return map_std, map_std, map_std / WALL_DISTANCE


def mounting_covariance(files: CarFiles, yaw: float) -> FloatArray:
    """Return the covariance (3, 3) of a pose of the car [m, m, rad] by errors of the mounting.

    yaw [rad]: of the car. A lidar that is turned by d on the car turns the car by d about itself.
    """
    mount = mount_of(files)
    c = cos(yaw)
    s = sin(yaw)
    slopes = np.array([[c, -s, s * mount.x + c * mount.y],
                       [s, c, s * mount.y - c * mount.x],
                       [0.0, 0.0, 1.0]]) * mount_std(files)
    return np.asarray(slopes @ slopes.T)


def attach_lidar(backend: Backend, lidar: str | ScanSource | None) -> None:
    """Attach ``lidar``, else $DART_HAL_LIDAR, to a backend that has no lidar of its own.

    A recording keeps its own scans. Raises what ``open_lidar`` raises.
    """
    if lidar is None and backend.lidar is None and backend.bus is not None:
        lidar = os.environ.get("DART_HAL_LIDAR") or None
    if lidar is not None:
        backend.lidar = _open_named_lidar(lidar) if isinstance(lidar, str) else lidar
    if backend.lidar is not None:
        backend.closers += (backend.lidar.close,)


def _open_named_lidar(text: str) -> ScanSource:
    from dart_hal.devices.lidar import open_lidar

    return open_lidar(text)
