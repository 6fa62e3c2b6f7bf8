"""One revolution of a lidar: time, direction and distance of each beam."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi, tau

import numpy as np
from numpy.typing import NDArray

Column = NDArray[np.float32]
_Array = NDArray[np.float64]
# Function of times (n,) [s] that returns x, y [m] and yaw [rad] of the rear axle.
PoseAt = Callable[[_Array], tuple[_Array, _Array, _Array]]


@dataclass(frozen=True, slots=True)
class Mount:
    """Mounting of a lidar: its axis x, y [m] from the rear axle, its zero angle at ``yaw`` [rad].

    inverted: its angles increase clockwise in a top view, as of an upright YDLidar;
    scale: true distance / reported distance.
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    inverted: bool = True
    scale: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One revolution of n beams in the order of measurement.

    arrival [s]: reception of the last byte; start [s]: time of the first beam, both on the car's
    clock; std [s]: standard deviation of ``start``; rate [1/s]: revolutions per second;
    after (n,) [s]: delay of each beam from ``start``; angle (n,) [rad] and distance (n,) [m, NaN =
    no echo]: as reported by the lidar; mount: its mounting. The columns are float32, as in a
    recording. Raises ValueError if their lengths differ.
    """

    arrival: float
    start: float
    rate: float
    after: Column
    angle: Column
    distance: Column
    std: float = 0.0
    mount: Mount = Mount()

    def __post_init__(self) -> None:
        for name in ("after", "angle", "distance"):
            column = np.array(getattr(self, name), dtype=np.float32)
            if column.ndim != 1 or len(column) != len(self.after):
                raise ValueError(f"{name} has {column.shape}, not one number for each beam")
            column.setflags(write=False)
            object.__setattr__(self, name, column)

    def __len__(self) -> int:
        return len(self.after)

    @property
    def t(self) -> _Array:
        """Time of each beam on the car's clock [s]."""
        return self.start + self.after.astype(np.float64)

    @property
    def bearing(self) -> _Array:
        """Direction of each beam in the car's axes, left positive, within -pi to pi [rad]."""
        turn = self.angle.astype(np.float64)
        bearing = self.mount.yaw + (-turn if self.mount.inverted else turn)
        wrapped: _Array = np.mod(bearing + pi, tau) - pi
        return wrapped

    @property
    def range(self) -> _Array:
        """Distance from the lidar's axis (n,) [m]; NaN: no echo."""
        return self.distance.astype(np.float64) * self.mount.scale

    def in_car(self) -> _Array:
        """Return the end points (n, 2) [m] in the car's axes at the time of each beam."""
        bearing = self.bearing
        distance = self.range
        return np.column_stack((self.mount.x + distance * np.cos(bearing),
                                self.mount.y + distance * np.sin(bearing)))

    def points(self, pose_at: PoseAt) -> _Array:
        """Return end points (n, 2) [m] in the frame of ``pose_at``, by the pose of each beam."""
        x, y, yaw = pose_at(self.t)
        c = np.cos(yaw)
        s = np.sin(yaw)
        ahead, left = self.in_car().T
        return np.column_stack((x + c * ahead - s * left, y + s * ahead + c * left))

    def mounted(self, mount: Mount) -> Scan:
        """Return a copy of the scan with another mounting of the lidar."""
        return replace(self, mount=mount)
