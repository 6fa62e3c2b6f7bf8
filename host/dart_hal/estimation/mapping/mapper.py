"""Mapping by scans, wheels and gyro: tracking, keyframes, pose graph, loop closures.

``update_odometry`` for each State, ``add`` for each complete scan, ``finish`` at the end.

1. Each scan is matched to a map of the last metres.
2. A keyframe is added when the car has moved far enough; the motion since the last one is an edge
   of the graph.
3. The match of a keyframe in an earlier submap is another edge, a loop closure.
"""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray, Scan
from dart_hal.estimation.localisation.beams import Beams, place_beams
from dart_hal.estimation.localisation.belief import (
    ERRORS,
    POSE,
    START_STDS,
    TAU,
    Belief,
    start_belief,
)
from dart_hal.estimation.localisation.localiser import MAX_SCAN_GAP
from dart_hal.estimation.localisation.path import OdometrySteps
from dart_hal.estimation.localisation.range_noise import RangeNoise
from dart_hal.estimation.mapping.closures import LoopClosures
from dart_hal.estimation.mapping.graph import Edge, relative_pose, solve
from dart_hal.estimation.mapping.keyframes import Keyframe, ScanView, Survey, collect_points
from dart_hal.estimation.mapping.surfels import SURFEL_CELL, WIDE_SURFEL_CELL, chart_of_points

# m from one keyframe to the next: what a car at 2 m/s drives in a revolution of the lidar.
KEYFRAME_DISTANCE = 0.25
# rad, likewise.
KEYFRAME_ANGLE = 0.25
# Scans stored per keyframe: at rest further ones add nothing.
MAX_VIEWS = 8
# m of travel whose keyframes are the map for matching: the length of a room; older ones are used
# by closures only.
LOCAL_MAP_LENGTH = 6.0
# m, m, rad: one sigma of a match, which the map of the last keyframes contains.
MATCH_STD = np.array((0.002, 0.002, 0.001))
# One sigma at the start. The first pose is the origin of the map; the lidar distances define its
# scale, because the wheels know it less well. The delay stays near its prior: where the map is made
# of the same scans, it is confounded with their errors along the path.
DELAY_STD = 0.003
MAPPING_STDS = np.concatenate((MATCH_STD, START_STDS[3:7], (DELAY_STD, 1e-5)))


class Mapper:
    """One per drive.

    closing: False leaves loops open; deskew: False places all beams of a scan at its middle. Both
    are negative controls.
    """

    def __init__(self, *, closing: bool = True, deskew: bool = True) -> None:
        self.belief: Belief | None = None
        self.frames: list[Keyframe] = []
        self.edges: list[Edge] = []
        self.poses = np.empty((0, 3))
        # Reason for a premature end, else empty.
        self.broken = ""
        self._steps = OdometrySteps()
        self._noise = RangeNoise()
        self._deskew = deskew
        self._closures = LoopClosures() if closing else None
        self._travel = 0.0

    def update_odometry(self, t: float, x: float, y: float, yaw: float) -> None:
        """Add the dead reckoning of the State at t [s]."""
        self._steps.add(t, x, y, yaw)

    def add(self, scan: Scan) -> None:
        """Add one scan; ignored if it has too few beams or no odometry."""
        known = self.belief or start_belief(0.0, np.zeros(3), MAPPING_STDS)
        self._noise.add(scan.range)
        beams = place_beams(scan, self._steps, known.mean[ERRORS], float(known.mean[TAU]),
                            deskew=self._deskew)
        if beams is None or self.broken:
            return
        t = float(beams.stretch.t[-1])
        if self.belief is None:
            self._add_keyframe(start_belief(t, np.zeros(3), MAPPING_STDS), beams)
        elif not (t < self.belief.t + MAX_SCAN_GAP and self._steps.covers(self.belief.t, t)):
            self.broken = f"no scan for {t - self.belief.t:.1f} s"
        elif t > self.belief.t:
            self._track(self.belief, beams)

    def finish(self) -> Survey:
        """Return the final poses and all scans."""
        found = solve(self.poses, self.edges)
        return Survey(self.frames, found.poses, self.edges, found.weight)

    @property
    def _cell(self) -> float:
        """Return the side [m] of the cells of surfels; far points of a noise that grows need more.

        Their weights are equal: with weights by the noise the path was 1.5 to 4 times worse.
        """
        return SURFEL_CELL if self._noise.share == 0.0 else WIDE_SURFEL_CELL

    def _track(self, belief: Belief, beams: Beams) -> None:
        """Predict and match one scan; store it, or add a keyframe."""
        t = float(beams.stretch.t[-1])
        errors = belief.mean[ERRORS]
        stretch = self._steps.stretch(belief.t, t, errors)
        half = self._steps.stretch(0.5 * float(beams.stretch.t[0] + t), t, errors)
        belief, _ = belief.predict(stretch).update_with_scan(self._chart, beams, half)
        self._travel += stretch.distance
        relative = relative_pose(self.poses[-1], belief.mean[POSE])
        x, y, yaw = relative.tolist()
        if np.hypot(x, y) > KEYFRAME_DISTANCE or abs(yaw) > KEYFRAME_ANGLE:
            self._add_keyframe(belief, beams, relative, _info(belief, float(belief.mean[2]) - yaw))
        else:
            self.belief = belief
            if len(self.frames[-1].views) < MAX_VIEWS:
                self.frames[-1].views.append(_view(beams, relative))

    def _add_keyframe(self, belief: Belief, beams: Beams, relative: FloatArray | None = None,
                      info: FloatArray | None = None) -> None:
        """Add a keyframe at the belief, ``relative`` in the axes of the last, and close loops."""
        self.frames.append(Keyframe(self._travel, [_view(beams, np.zeros(3))]))
        self.poses = np.vstack((self.poses, belief.mean[POSE]))
        last = len(self.frames) - 1
        if relative is not None and info is not None:
            self.edges.append(Edge(last - 1, last, relative, info))
        if self._closures is not None:
            found = self._closures.find(self.frames, self.poses, last, self._cell)
            if found:
                self.edges += found
                self.poses = solve(self.poses, self.edges).poses
        self.belief = _fix_pose(belief, self.poses[-1])
        ways = np.array([frame.travel for frame in self.frames])
        first = int(np.searchsorted(ways, self._travel - LOCAL_MAP_LENGTH))
        self._chart = chart_of_points(collect_points(self.frames[first:], self.poses[first:]),
                                      self._cell)


def _view(beams: Beams, relative: FloatArray) -> ScanView:
    """Convert beams to a stored scan."""
    return ScanView(float(beams.stretch.t[-1]), beams.points, beams.rays, beams.origin, relative)


def _info(belief: Belief, yaw: float) -> FloatArray:
    """Return the information (3, 3) of the pose, in axes turned by ``yaw`` [rad]."""
    c = np.cos(yaw)
    s = np.sin(yaw)
    rotation = np.array(((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)))
    cov = belief.cov[POSE, POSE] + np.diag(MATCH_STD**2)
    info: FloatArray = np.linalg.inv(rotation @ cov @ rotation.T)
    return info


def _fix_pose(belief: Belief, pose: FloatArray) -> Belief:
    """Return the belief with the pose of a keyframe, from which the next is measured."""
    mean = belief.mean.copy()
    cov = belief.cov.copy()
    mean[POSE] = pose
    cov[POSE, :] = cov[:, POSE] = 0.0
    cov[POSE, POSE] = np.diag(MATCH_STD**2)
    return Belief(belief.t, mean, cov)
