"""Several cars in one place: poses, contacts between outlines, and the walls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dart_hal.core.errors import ConfigError, UsageError
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_lab.sim.light.batch import LightBatch, Named
from dart_lab.sim.light.config import Checked, LightConfig

Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class Outline(Checked):
    """Rectangle of a car [m], seen from above; ``ahead``: its centre before the rear axle.

    Assumed: no drawing of the whole car states them.
    """

    length: float = 0.30
    width: float = 0.19
    ahead: float = 0.0875


@dataclass(frozen=True, slots=True)
class Area:
    """A rectangle of free floor [m]. Raises ConfigError when it has no inside."""

    x_low: float
    x_high: float
    y_low: float
    y_high: float

    def __post_init__(self) -> None:
        if not (self.x_low < self.x_high and self.y_low < self.y_high):
            raise ConfigError("an area without inside", found=repr(self),
                              expected="low < high", remedy="order the numbers")


@dataclass(frozen=True, slots=True)
class WorldConfig:
    """A light simulation, the outline of its cars and the floor, None = endless."""

    light: LightConfig = field(default_factory=LightConfig)
    outline: Outline = field(default_factory=Outline)
    area: Area | None = None


class LightWorld(LightBatch):
    """Cars that share a floor: a LightBatch that knows who touches whom.

    ``poses``: (n, 3) x, y [m], yaw [rad] of the rear axles at the start, at rest.
    Contact is reported, not simulated: cars pass through one another, and what
    that means is the caller's to say. It is looked for when asked, at the poses of
    that moment.
    """

    def __init__(self, vehicles: Sequence[Named], poses: FloatArray | Sequence[Sequence[float]],
                 config: WorldConfig | None = None, seed: int = 0) -> None:
        """Raises UsageError when vehicles and poses do not fit, and what LightBatch raises."""
        self.world = config or WorldConfig()
        start = np.asarray(poses, dtype=np.float64)
        if start.shape != (len(vehicles), 3):
            raise UsageError("a pose for each car is needed", found=f"poses {start.shape}",
                             expected=f"({len(vehicles)}, 3)")
        super().__init__(vehicles, len(vehicles), self.world.light, seed)
        self.place(start)

    def place(self, poses: FloatArray) -> None:
        """All cars at rest with their rear axles at (n, 3) poses."""
        rest = np.zeros((6, self.n))
        l_r = np.asarray(apply_parameter_effects(self.vehicle).body.l_r)
        rest[0] = poses[:, 0] + l_r * np.cos(poses[:, 2])
        rest[1] = poses[:, 1] + l_r * np.sin(poses[:, 2])
        rest[2] = poses[:, 2]
        self.reset(rest)

    @property
    def poses(self) -> FloatArray:
        """True poses (n, 3) of the rear axles."""
        x, y, yaw = (np.asarray(v, dtype=np.float64) for v in self.state[:3])
        l_r = np.asarray(apply_parameter_effects(self.vehicle).body.l_r)
        return np.stack([x - l_r * np.cos(yaw), y - l_r * np.sin(yaw), yaw], axis=1)

    def contacts(self) -> Array:
        """Which cars overlap, (n, n) of bool, symmetric, False on the diagonal."""
        return overlaps(corners(self.poses, self.world.outline))

    def outside(self) -> Array:
        """Which cars have a corner outside of the area, (n,) of bool."""
        a = self.world.area
        if a is None:
            return np.zeros(self.n, dtype=bool)
        x, y = corners(self.poses, self.world.outline).transpose(2, 0, 1)
        out: Array = ((x < a.x_low) | (x > a.x_high) | (y < a.y_low) | (y > a.y_high)).any(axis=1)
        return out


def corners(poses: FloatArray, outline: Outline) -> FloatArray:
    """Corners (n, 4, 2) [m] of the outlines of cars with rear axles at (n, 3)."""
    half_l, half_w = 0.5 * outline.length, 0.5 * outline.width
    along = outline.ahead + half_l * np.array([1.0, -1.0, -1.0, 1.0])
    left = half_w * np.array([1.0, 1.0, -1.0, -1.0])
    c, s = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    return np.stack([poses[:, 0, None] + along * c - left * s,
                     poses[:, 1, None] + along * s + left * c], axis=2)


def overlaps(boxes: FloatArray) -> Array:
    """Pairs of rectangles (n, 4, 2) that overlap, (n, n) of bool.

    Two convex outlines are apart if and only if the normal of some side
    separates them; a rectangle has two such normals.
    """
    sides = boxes[:, 1:3] - boxes[:, 0:2]
    spread = np.einsum("iak,jck->ijac", sides, boxes)        # corners of j along sides of i
    low, high = spread.min(axis=3), spread.max(axis=3)
    own = np.einsum("iak,ick->iac", sides, boxes)
    apart = ((low > own.max(axis=2)[:, None]) | (high < own.min(axis=2)[:, None])).any(axis=2)
    touching: Array = ~(apart | apart.T)
    np.fill_diagonal(touching, False)
    return touching
