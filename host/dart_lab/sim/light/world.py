"""Several cars in one area: poses, contacts between their outlines, and the bounds of the floor."""

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
from dart_lab.sim.light.config import CheckedNumbers, LightConfig

Array = NDArray[Any]


@dataclass(frozen=True, slots=True)
class Outline(CheckedNumbers):
    """Rectangle of a car [m] in top view; ``ahead``: its centre from the rear axle.

    The values are assumed, since no drawing shows the whole car.
    """

    length: float = 0.30
    width: float = 0.19
    ahead: float = 0.0875


CAR_OUTLINE = Outline()


@dataclass(frozen=True, slots=True)
class Area:
    """A rectangle of free floor [m]. Raises ConfigError if it is empty."""

    x_low: float
    x_high: float
    y_low: float
    y_high: float

    def __post_init__(self) -> None:
        if not (self.x_low < self.x_high and self.y_low < self.y_high):
            raise ConfigError("the area is empty", found=repr(self),
                              expected="low < high", remedy="order the numbers")


@dataclass(frozen=True, slots=True)
class WorldConfig:
    """A light simulation, the outline of its cars and the floor, None = unbounded."""

    light: LightConfig = field(default_factory=LightConfig)
    outline: Outline = field(default_factory=Outline)
    area: Area | None = None


class LightWorld(LightBatch):
    """Cars that share a floor: a LightBatch with contacts.

    ``poses``: (n, 3) x, y [m], yaw [rad] of the rear axles at the start, at rest. Contacts are
    reported but not simulated: cars pass through each other. ``contacts`` computes them from the
    present poses.
    """

    def __init__(self, vehicles: Sequence[Named], poses: FloatArray | Sequence[Sequence[float]],
                 config: WorldConfig | None = None, seed: int = 0) -> None:
        """Raises UsageError for another number of poses, and what LightBatch raises."""
        self.world = config or WorldConfig()
        start = np.asarray(poses, dtype=np.float64)
        if start.shape != (len(vehicles), 3):
            raise UsageError("a pose for each car is needed", found=f"poses {start.shape}",
                             expected=f"({len(vehicles)}, 3)")
        super().__init__(vehicles, len(vehicles), self.world.light, seed)
        self.place(start)

    def place(self, poses: FloatArray) -> None:
        """Put all cars at rest with their rear axles at (n, 3) poses."""
        rest = np.zeros((6, self.n))
        l_r = np.asarray(apply_parameter_effects(self.vehicle).body.l_r)
        rest[0] = poses[:, 0] + l_r * np.cos(poses[:, 2])
        rest[1] = poses[:, 1] + l_r * np.sin(poses[:, 2])
        rest[2] = poses[:, 2]
        self.reset(rest)

    @property
    def poses(self) -> FloatArray:
        """Return the true poses (n, 3) of the rear axles."""
        x, y, yaw = (np.asarray(v, dtype=np.float64) for v in self.state[:3])
        l_r = np.asarray(apply_parameter_effects(self.vehicle).body.l_r)
        return np.stack([x - l_r * np.cos(yaw), y - l_r * np.sin(yaw), yaw], axis=1)

    def contacts(self) -> Array:
        """Return which cars overlap, (n, n) of bool, symmetric, False on the diagonal."""
        return overlaps(corners(self.poses, self.world.outline))

    def outside(self) -> Array:
        """Return which cars have a corner outside the area, (n,) of bool."""
        a = self.world.area
        if a is None:
            return np.zeros(self.n, dtype=bool)
        x, y = corners(self.poses, self.world.outline).transpose(2, 0, 1)
        out: Array = ((x < a.x_low) | (x > a.x_high) | (y < a.y_low) | (y > a.y_high)).any(axis=1)
        return out


def corners(poses: FloatArray, outline: Outline) -> FloatArray:
    """Return the corners (n, 4, 2) [m] of the outlines of cars with rear axles at (n, 3)."""
    half_l = 0.5 * outline.length
    half_w = 0.5 * outline.width
    along = outline.ahead + half_l * np.array([1.0, -1.0, -1.0, 1.0])
    left = half_w * np.array([1.0, 1.0, -1.0, -1.0])
    c = np.cos(poses[:, 2, None])
    s = np.sin(poses[:, 2, None])
    return np.stack([poses[:, 0, None] + along * c - left * s,
                     poses[:, 1, None] + along * s + left * c], axis=2)


def overlaps(boxes: FloatArray) -> Array:
    """Return which pairs of rectangles (n, 4, 2) overlap, (n, n) of bool.

    Two convex outlines are separate if and only if the normal of some side separates them. A
    rectangle has two such normals.
    """
    sides = boxes[:, 1:3] - boxes[:, 0:2]
    # Corners c of rectangle j, projected on sides a of rectangle i.
    spread = np.einsum("iak,jck->ijac", sides, boxes)
    low = spread.min(axis=3)
    high = spread.max(axis=3)
    # The same projections of rectangle i itself.
    own = np.einsum("iak,ick->iac", sides, boxes)
    separate = ((low > own.max(axis=2)[:, None]) | (high < own.min(axis=2)[:, None])).any(axis=2)
    touching: Array = ~(separate | separate.T)
    np.fill_diagonal(touching, False)
    return touching
