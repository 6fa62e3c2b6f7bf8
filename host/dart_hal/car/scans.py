"""Scans of an open car: polled at each chunk, mounted by its files, recorded, told in States."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from dataclasses import replace

from dart_hal.core.config import CarFiles
from dart_hal.core.config.calibration import LidarCalibration
from dart_hal.core.ports import ScanSource
from dart_hal.core.types import Mount, Scan, State
from dart_hal.devices.lidar import open_lidar
from dart_hal.devices.lidar.health import Watch
from dart_hal.devices.links.base import Backend

KEPT = 64
"""Scans that wait for ``Car.scans``: 8 s; of a program that never asks the oldest are dropped."""
AXIS_X = 0.13
"""m of the axis before the rear axle where no file says it: the drawing of the base plate."""


class ScanFeed:
    """One per open car with a lidar. ``record`` is called with each scan as the unit told it,
    ``place`` with each as it is mounted."""

    def __init__(self, source: ScanSource, mount: Mount) -> None:
        self.source = source
        self.record: Callable[[Scan], None] = lambda scan: None
        self.place: Callable[[Scan], None] = lambda scan: None
        self.newest: Scan | None = None
        self.waiting: deque[Scan] = deque(maxlen=KEPT)
        self.watch = Watch()
        self._mount, self._yaw = mount, 0.0
        self._early: deque[Scan] = deque()

    def take(self, states: list[State], t: float, now: float) -> list[State]:
        """States of a chunk that arrived at ``t``, with the newest scan that was there by then.

        What arrived later waits, so that a replay sees the same. now [s]: the car's clock.
        """
        self._early.extend(self.source.poll(now))
        self._yaw = states[-1].pose.yaw if states else self._yaw
        while self._early and self._early[0].arrival <= t:
            scan = self._early.popleft()
            self.record(scan)
            self.newest = scan.mounted(self._mount)
            self.waiting.append(self.newest)
            self.place(self.newest)
            self.watch.add(self.newest, self._yaw)
        return [replace(state, scan=self.newest) for state in states]

    def taken(self) -> tuple[Scan, ...]:
        """Those that came since the last call."""
        came = tuple(self.waiting)
        self.waiting.clear()
        return came


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
