"""Checks of a mapping drive: conditions under which no useful map can result."""

from __future__ import annotations

from math import degrees

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray, Scan
from dart_hal.devices.lidar.health import LidarHealthMonitor, find_blind_sectors
from dart_hal.estimation.localisation.localiser import MIN_ROTATION_SENSE

# rad: a sector without any return in the whole drive. A post hides 10 to 20 deg; if the lidar
# turns more than 8.25 times a second the gap is wider.
MIN_BLIND_SECTOR = np.radians(30.0)
# m that must be driven.
MIN_DRIVE = 1.0
# Scans per one that is checked for blind sectors: one a second.
SCAN_STRIDE = 8


class MapChecks:
    """Checks of a drive: ``add`` for each scan with the yaw [rad, unwrapped] of the car, then
    ``judge``."""

    def __init__(self) -> None:
        self.scans = 0
        self._watch = LidarHealthMonitor()
        self._bearings = list[FloatArray]()

    def add(self, scan: Scan, yaw: float) -> None:
        """Add one scan. Raises UsageError as soon as the scans rotate against the gyro."""
        self._watch.add(scan, yaw)
        if self.scans % SCAN_STRIDE == 0:
            self._bearings.append(scan.bearing[np.isfinite(scan.distance)])
        self.scans += 1
        sense = self._watch.sense
        if sense is not None and sense < MIN_ROTATION_SENSE:
            raise UsageError(
                "the scans turn against the gyro", found=f"{sense:+.2f} of the gyro's turns",
                expected="+1", likely="the lidar is upside down and `inverted` in [lidar] of "
                "car.toml is not set, or the opposite; or the gyro's sign is wrong",
                remedy="dart-hal doctor, then set inverted in [lidar] of car.toml")

    def judge(self, distance: float) -> None:
        """Check a complete drive of ``distance`` [m]. Raises UsageError."""
        if not self.scans:
            raise UsageError("there is nothing to map", found="no scan", expected="a lidar",
                             remedy="export DART_HAL_LIDAR=serial:///dev/dart-lidar")
        for start, end in find_blind_sectors(np.concatenate(self._bearings)):
            if end - start >= MIN_BLIND_SECTOR:
                raise UsageError(
                    "a sector of the lidar is blind: it had no return in the whole drive",
                    found=f"{degrees(start):.0f} to {degrees(end):.0f} deg, left positive",
                    expected="less than 30 deg without a return", likely="a part of the car, a "
                    "lidar that turns more than 8.25 times a second, or one with too little power",
                    remedy="dart-hal doctor")
        if distance < MIN_DRIVE:
            raise UsageError("the car did not move far: one place is no map",
                             found=f"{distance:.2f} m", expected=f"{MIN_DRIVE:g} m and more")

    @property
    def is_sense_unknown(self) -> bool:
        """Whether the car turned too little to determine the rotation of the scans."""
        return self._watch.sense is None
