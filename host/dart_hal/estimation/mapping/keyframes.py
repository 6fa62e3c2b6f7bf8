"""What is kept of a drive: every scan at its keyframe, and stretches of keyframes as submaps."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.field import Map
from dart_hal.estimation.mapping.graph import Edge, between, onto
from dart_hal.estimation.mapping.surfels import chart_of_points


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One scan. t [s]: of its end; points, rays, origin (n, 2) [m] as ``Beams`` has them; at (3,):
    x, y [m], yaw [rad] of the car in the axes of its keyframe."""

    t: float
    points: FloatArray
    rays: FloatArray
    origin: FloatArray
    at: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """A place of the car. way [m]: driven before it; views: the first is its own, the others were
    taken before the next."""

    way: float
    views: list[View] = field(default_factory=list)

    @property
    def own(self) -> View:
        """The scan that was taken here."""
        return self.views[0]


def points_of(frames: list[Keyframe], poses: FloatArray) -> FloatArray:
    """End points (n, 2) [m] of the keyframes' own scans, with the keyframes at poses (k, 3)."""
    return np.vstack([placed(frame.own.points, pose)
                      for frame, pose in zip(frames, poses, strict=True)])


def placed(points: FloatArray, pose: FloatArray) -> FloatArray:
    """Points (n, 2) [m] of the axes of a pose (3,)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    turned: FloatArray = points @ np.array(((c, s), (-s, c))) + pose[:2]
    return turned


@dataclass(frozen=True, slots=True, eq=False)
class Submap:
    """A stretch of keyframes, first to last, as a map in the axes of the keyframe ``anchor``."""

    anchor: int
    first: int
    last: int
    chart: Map


def submap(frames: list[Keyframe], poses: FloatArray, first: int, last: int) -> Submap:
    """Of the keyframes first to last, at poses (n, 3)."""
    anchor = (first + last) // 2
    local = between(poses[anchor], poses[first:last + 1])
    return Submap(anchor, first, last, chart_of_points(points_of(frames[first:last + 1], local)))


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """What came of a drive. frames (n); poses (n, 3): x, y [m], yaw [rad] in the frame of the
    first; edges with the weight (m,) that the solution gave them."""

    frames: list[Keyframe]
    poses: FloatArray
    edges: list[Edge]
    weight: FloatArray

    @property
    def closures(self) -> list[Edge]:
        """Those that are believed."""
        return [e for e, w in zip(self.edges, self.weight, strict=True) if e.closes and w > 0.5]

    def path(self) -> FloatArray:
        """t [s], x, y [m], yaw [rad] (n, 4) at the end of each scan."""
        rows = [(view.t, *onto(pose, view.at)) for frame, pose in
                zip(self.frames, self.poses, strict=True) for view in frame.views]
        return np.array(rows)
