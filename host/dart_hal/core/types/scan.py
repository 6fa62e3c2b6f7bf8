"""One revolution of a lidar: when each beam was taken, where it pointed, how far it went."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi, tau

import numpy as np
from numpy.typing import NDArray

Column = NDArray[np.float32]
_Array = NDArray[np.float64]
PoseAt = Callable[[_Array], tuple[_Array, _Array, _Array]]
"""x, y [m] and yaw [rad] of the rear axle at times (n,) [s]."""


@dataclass(frozen=True, slots=True)
class Mount:
    """How a lidar sits: its axis x, y [m] from the rear axle, its zero at ``yaw`` [rad] of the
    car. ``inverted``: its angles grow clockwise seen from above, as an upright YDLidar's do.
    ``scale``: true distance over the one that it tells."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    inverted: bool = True
    scale: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One revolution, of n beams in the order in which they were taken.

    arrival [s]: when its last byte was there; start [s]: its first beam, both on the car's
    clock; std [s]: one sigma of ``start``; rate [1/s]: revolutions; after (n,) [s]: of each
    beam behind ``start``; angle (n,) [rad] and distance (n,) [m, NaN = nothing came back] as
    the unit tells them; mount: how it sits on the car. The columns are float32, as a
    recording keeps them. Raises ValueError where their lengths differ.
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
        seen = self.mount.yaw + (-turn if self.mount.inverted else turn)
        wrapped: _Array = np.mod(seen + pi, tau) - pi
        return wrapped

    @property
    def range(self) -> _Array:
        """Distance from the lidar's axis [m]; NaN: nothing came back."""
        return self.distance.astype(np.float64) * self.mount.scale

    def in_car(self) -> _Array:
        """End points (n, 2) [m] from the rear axle, each in the car's axes at its own time."""
        bearing, reach = self.bearing, self.range
        return np.column_stack((self.mount.x + reach * np.cos(bearing),
                                self.mount.y + reach * np.sin(bearing)))

    def points(self, pose_at: PoseAt) -> _Array:
        """End points (n, 2) [m] in the frame of ``pose_at``, each by the pose at its own time."""
        x, y, yaw = pose_at(self.t)
        c, s = np.cos(yaw), np.sin(yaw)
        ahead, left = self.in_car().T
        return np.column_stack((x + c * ahead - s * left, y + s * ahead + c * left))

    def mounted(self, mount: Mount) -> Scan:
        """The same beams, of a unit that sits so."""
        return replace(self, mount=mount)
