"""What makes a drive no map: refused in words, before somebody trusts it."""

from __future__ import annotations

from math import degrees

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray, Scan
from dart_hal.devices.lidar.health import Watch, blind
from dart_hal.estimation.localisation.localiser import MIRRORED

BLIND = np.radians(30.0)
"""rad: a sector from which nothing came in the whole drive. A post hides 10 to 20 deg; where the
lidar turns above 8.25 times a second the gap is wider."""
LEAST_WAY = 1.0
"""m that have to be driven."""
EVERY = 8
"""Of the scans that are looked at for blind sectors: one a second."""


class Checks:
    """``add`` for each scan, with the car's yaw [rad, unwrapped] then; ``judge`` at the end."""

    def __init__(self) -> None:
        self.scans = 0
        self._watch, self._seen = Watch(), list[FloatArray]()

    def add(self, scan: Scan, yaw: float) -> None:
        """One more scan. Raises UsageError as soon as the scans are seen to turn the wrong way."""
        self._watch.add(scan, yaw)
        if self.scans % EVERY == 0:
            self._seen.append(scan.bearing[np.isfinite(scan.distance)])
        self.scans += 1
        sense = self._watch.sense
        if sense is not None and sense < MIRRORED:
            raise UsageError(
                "the scans turn against the gyro", found=f"{sense:+.2f} of the gyro's turns",
                expected="+1", likely="the lidar is upside down and `inverted` in [lidar] of "
                "car.toml does not say so, or the other way round; or the gyro's sign is wrong",
                remedy="dart-hal doctor, then set inverted in [lidar] of car.toml")

    def judge(self, way: float) -> None:
        """After a drive of ``way`` [m]. Raises UsageError."""
        if not self.scans:
            raise UsageError("there is nothing to map", found="no scan", expected="a lidar",
                             remedy="export DART_HAL_LIDAR=serial:///dev/dart-lidar")
        for start, end in blind(np.concatenate(self._seen)):
            if end - start >= BLIND:
                raise UsageError(
                    "a sector of the lidar is missing: nothing ever came from there",
                    found=f"{degrees(start):.0f} to {degrees(end):.0f} deg, left positive",
                    expected="less than 30 deg without a return", likely="a part of the car, a "
                    "lidar that turns more than 8.25 times a second, or one without power enough",
                    remedy="dart-hal doctor")
        if way < LEAST_WAY:
            raise UsageError("the car did not move: one place is no map", found=f"{way:.2f} m",
                             expected=f"{LEAST_WAY:g} m and more")

    @property
    def unsure(self) -> bool:
        """Whether the car turned too little to tell which way its scans turn."""
        return self._watch.sense is None
