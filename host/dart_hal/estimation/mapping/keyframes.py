"""Stored data of a mapping drive: scans by keyframe, and stretches of keyframes as submaps."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.field import Map
from dart_hal.estimation.mapping.graph import Edge, compose_pose, relative_pose
from dart_hal.estimation.mapping.surfels import chart_of_points


@dataclass(frozen=True, slots=True, eq=False)
class ScanView:
    """One scan. t [s]: of its end; points, rays, origin (n, 2) [m]: as in ``Beams``;

    at (3,): x, y [m], yaw [rad] of the car in the axes of its keyframe.
    """

    t: float
    points: FloatArray
    rays: FloatArray
    origin: FloatArray
    at: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """Scans at one place of the drive; its pose is the same row of ``Survey.poses``.

    travel [m]: driven before it; views: the first was taken here and defines the place, the others
    before the next keyframe.
    """

    travel: float
    views: list[ScanView] = field(default_factory=list)

    @property
    def own(self) -> ScanView:
        """Return the scan that was taken here."""
        return self.views[0]


def collect_points(frames: list[Keyframe], poses: FloatArray) -> FloatArray:
    """End points (n, 2) [m] of the own scans of the keyframes, at poses (k, 3)."""
    return np.vstack([transform_points(frame.own.points, pose)
                      for frame, pose in zip(frames, poses, strict=True)])


def transform_points(points: FloatArray, pose: FloatArray) -> FloatArray:
    """Transform points (n, 2) [m] from the axes of a pose (3,)."""
    c = np.cos(pose[2])
    s = np.sin(pose[2])
    turned: FloatArray = points @ np.array(((c, s), (-s, c))) + pose[:2]
    return turned


@dataclass(frozen=True, slots=True, eq=False)
class Submap:
    """A stretch of keyframes, first to last, as a map in the axes of the keyframe ``anchor``."""

    anchor: int
    first: int
    last: int
    chart: Map


def make_submap(frames: list[Keyframe], poses: FloatArray, first: int, last: int,
                cell: float) -> Submap:
    """Make a submap of the keyframes first to last, at poses (n, 3); cell [m] of its surfels."""
    anchor = (first + last) // 2
    local = relative_pose(poses[anchor], poses[first:last + 1])
    points = collect_points(frames[first:last + 1], local)
    return Submap(anchor, first, last, chart_of_points(points, cell))


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """Result of a drive.

    frames (n); poses (n, 3): x, y [m], yaw [rad] in the frame of the first; edges with their final
    weight (m,).
    """

    frames: list[Keyframe]
    poses: FloatArray
    edges: list[Edge]
    weight: FloatArray

    @property
    def closures(self) -> list[Edge]:
        """Return the closures that the solution uses."""
        return [e for e, w in zip(self.edges, self.weight, strict=True) if e.is_closure and w > 0.5]

    def path(self) -> FloatArray:
        """Return t [s], x, y [m], yaw [rad] (n, 4) at the end of each scan."""
        rows = [(view.t, *compose_pose(pose, view.at)) for frame, pose in
                zip(self.frames, self.poses, strict=True) for view in frame.views]
        return np.array(rows)
