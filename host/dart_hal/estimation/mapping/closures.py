"""Loop closures: the pose of a keyframe in an earlier submap, and its validation.

1. The candidate is the earlier submap with the keyframe nearest to the car, by the poses of the
   graph, if that is within ``MAX_CANDIDATE_DISTANCE``. Only one is tried.
2. The matcher refines the pose in the submap.
3. Ray casting checks whether the submap explains the scan there.
"""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.health import agreement
from dart_hal.estimation.localisation.matcher import match
from dart_hal.estimation.mapping.graph import Edge, relative_pose
from dart_hal.estimation.mapping.keyframes import Keyframe, Submap, make_submap

# m of travel in a submap.
SUBMAP_LENGTH = 4.0
# m from one to the next.
SUBMAP_SPACING = 2.0
# m of travel since the end of a submap from which on it may close a loop.
MIN_LOOP_LENGTH = 8.0
# m between the car and a keyframe of a submap.
MAX_CANDIDATE_DISTANCE = 1.0
# Prior information on the pose in the submap: the drift of a loop.
LOOP_INFORMATION = np.diag(1.0 / np.array((0.3, 0.3, 0.1, 1e-5))**2)
# Share of the beams that the submap must explain.
MIN_CLOSURE_AGREEMENT = 0.70
# m, m, rad: deformation of a submap.
SUBMAP_COVARIANCE = np.diag(np.array((0.003, 0.003, 0.001))**2)


class LoopClosures:
    """Submaps of one drive."""

    def __init__(self) -> None:
        self.submaps: list[Submap] = []
        self.tried = 0

    def find(self, frames: list[Keyframe], poses: FloatArray, k: int, cell: float
             ) -> list[Edge]:
        """Return the closures of keyframe k, the newest; cell [m] of the surfels."""
        self._add_submap(frames, poses, cell)
        best = None
        for sub in self.submaps:
            if frames[sub.last].travel > frames[k].travel - MIN_LOOP_LENGTH:
                break
            span = poses[sub.first:sub.last + 1, :2] - poses[k, :2]
            distance = float(np.hypot(*span.T).min())
            if distance < MAX_CANDIDATE_DISTANCE and (best is None or distance < best[0]):
                best = distance, sub
        if best is None:
            return []
        edge = match_submap(best[1], frames[k], relative_pose(poses[best[1].anchor], poses[k]), k)
        self.tried += 1
        return [edge] if edge else []

    def _add_submap(self, frames: list[Keyframe], poses: FloatArray, cell: float) -> None:
        """Add a submap once the car has driven its length."""
        begin = len(self.submaps) * SUBMAP_SPACING
        if frames[-1].travel < begin + SUBMAP_LENGTH:
            return
        ways = np.array([frame.travel for frame in frames])
        first, last = np.searchsorted(ways, (begin, begin + SUBMAP_LENGTH))
        self.submaps.append(make_submap(frames, poses, int(first), int(last), cell))


def match_submap(sub: Submap, frame: Keyframe, start: FloatArray, k: int) -> Edge | None:
    """Return the edge from a submap to keyframe k near ``start`` (3,) in its axes, or None."""
    own = frame.own
    found = match(sub.chart, own.points, own.rays, np.append(start, 0.0), LOOP_INFORMATION)
    agreed = agreement(sub.chart, found.pose, own.points, own.rays, own.origin)
    if agreed.share < MIN_CLOSURE_AGREEMENT:
        return None
    match_cov = np.linalg.inv((found.info + LOOP_INFORMATION)[:3, :3])
    info = np.linalg.inv(match_cov + SUBMAP_COVARIANCE)
    return Edge(sub.anchor, k, found.pose[:3], info, is_closure=True)
