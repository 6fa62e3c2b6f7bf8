"""Loop closures: where a keyframe is in a submap that was made before, and whether that is so.

Candidates are the submaps in whose keyframes' places the car is by the graph. The matcher places
the scan in them, from where the graph has it; rays say whether the submap explains it there.
"""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.health import agreement
from dart_hal.estimation.localisation.matcher import match
from dart_hal.estimation.mapping.graph import Edge, between
from dart_hal.estimation.mapping.keyframes import Keyframe, Submap, submap

LENGTH, EVERY = 4.0, 2.0
"""m of way in a submap, and from one to the next."""
OLD = 8.0
"""m of way from the end of a submap on, behind which it is one of a loop."""
NEAR = 1.0
"""m between the car and a keyframe of a submap."""
LOOSE = np.diag(1.0 / np.array((0.3, 0.3, 0.1, 1e-5))**2)
"""What is known of the pose in the submap: the drift of a loop."""
AGREES = 0.70
"""Share of the beams that the submap has to explain."""
FLOOR = np.diag(np.array((0.003, 0.003, 0.001))**2)
"""m, m, rad: what a submap is bent by."""


class Closures:
    """One per drive: its submaps."""

    def __init__(self) -> None:
        self.submaps: list[Submap] = []
        self.tried = 0

    def of(self, frames: list[Keyframe], poses: FloatArray, k: int) -> list[Edge]:
        """Closures of keyframe k, the newest."""
        self._grow(frames, poses)
        best = None
        for sub in self.submaps:
            if frames[sub.last].way > frames[k].way - OLD:
                break
            span = poses[sub.first:sub.last + 1, :2] - poses[k, :2]
            off = float(np.hypot(*span.T).min())
            if off < NEAR and (best is None or off < best[0]):
                best = off, sub
        if best is None:
            return []
        edge = closure(best[1], frames[k], between(poses[best[1].anchor], poses[k]), k)
        self.tried += 1
        return [edge] if edge else []

    def _grow(self, frames: list[Keyframe], poses: FloatArray) -> None:
        """One more submap, where the car has come so far."""
        begin = len(self.submaps) * EVERY
        if frames[-1].way < begin + LENGTH:
            return
        ways = np.array([frame.way for frame in frames])
        first, last = np.searchsorted(ways, (begin, begin + LENGTH))
        self.submaps.append(submap(frames, poses, int(first), int(last)))


def closure(sub: Submap, frame: Keyframe, start: FloatArray, k: int) -> Edge | None:
    """The edge from a submap to keyframe k, which is at about ``start`` (3,) in its axes."""
    own = frame.own
    found = match(sub.chart, own.points, own.rays, np.append(start, 0.0), LOOSE)
    if agreement(sub.chart, found.pose, own.points, own.rays, own.origin).share < AGREES:
        return None
    seen = np.linalg.inv((found.info + LOOSE)[:3, :3])
    return Edge(sub.anchor, k, found.pose[:3], np.linalg.inv(seen + FLOOR), closes=True)
