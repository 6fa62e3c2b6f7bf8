"""Scans, wheels and gyro into keyframes in a pose graph: track, keep, close loops.

``moved`` for each State, ``add`` for each scan that is whole by then, ``finish`` at the end. Each
scan is matched to a map of the last metres; what the car moved between two keyframes and what a
keyframe tells of an old submap are the edges of the graph.
"""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray, Scan
from dart_hal.estimation.localisation.beams import Beams, beams_of
from dart_hal.estimation.localisation.belief import ERRORS, POSE, STD, TAU, Belief, begun
from dart_hal.estimation.localisation.localiser import LONGEST
from dart_hal.estimation.localisation.path import Steps
from dart_hal.estimation.mapping.closures import Closures
from dart_hal.estimation.mapping.graph import Edge, between, solve
from dart_hal.estimation.mapping.keyframes import Keyframe, Survey, View, points_of
from dart_hal.estimation.mapping.surfels import chart_of_points

APART, TURNED = 0.25, 0.25
"""m and rad from one keyframe to the next: a scan of a car at 2 m/s."""
VIEWS = 8
"""Scans that a keyframe keeps: a car that stands sees nothing new."""
RECENT = 6.0
"""m of way whose keyframes are the map that scans are matched to: a room's length; what is older
comes in by closures alone."""
ANCHORED = np.array((0.002, 0.002, 0.001))
"""m, m, rad: one sigma of a match, which the map of the last keyframes has in it."""
START = np.concatenate((ANCHORED, STD[3:8], (1e-5,)))
"""One sigma at the beginning. The first pose is the map's origin; distances are the map's measure:
nothing else tells how long a metre is, since the wheels know it less well."""


class Mapper:
    """One per drive. closing: False leaves loops open, deskew: False puts all beams of a scan at
    its middle; both are controls, no use."""

    def __init__(self, *, closing: bool = True, deskew: bool = True) -> None:
        self.belief: Belief | None = None
        self.frames: list[Keyframe] = []
        self.edges: list[Edge] = []
        self.poses = np.empty((0, 3))
        self.broken = ""
        """Why it went no further; empty while it does."""
        self._steps, self._deskew = Steps(), deskew
        self._closures = Closures() if closing else None
        self._way = 0.0

    def moved(self, t: float, x: float, y: float, yaw: float) -> None:
        """Dead reckoning of the State at t [s]."""
        self._steps.moved(t, x, y, yaw)

    def add(self, scan: Scan) -> None:
        """One scan; one that tells nothing is passed over."""
        known = self.belief or begun(0.0, np.zeros(3), START)
        beams = beams_of(scan, self._steps, known.mean[ERRORS], float(known.mean[TAU]),
                         deskew=self._deskew)
        if beams is None or self.broken:
            return
        t = float(beams.way.t[-1])
        if self.belief is None:
            self._keep(begun(t, np.zeros(3), START), beams)
        elif not (t < self.belief.t + LONGEST and self._steps.covers(self.belief.t, t)):
            self.broken = f"no scan for {t - self.belief.t:.1f} s"
        elif t > self.belief.t:
            self._track(self.belief, beams)

    def finish(self) -> Survey:
        """The best poses of all that was seen."""
        found = solve(self.poses, self.edges)
        return Survey(self.frames, found.poses, self.edges, found.weight)

    def _track(self, belief: Belief, beams: Beams) -> None:
        t, errors = float(beams.way.t[-1]), belief.mean[ERRORS]
        way = self._steps.stretch(belief.t, t, errors)
        half = self._steps.stretch(0.5 * float(beams.way.t[0] + t), t, errors)
        belief, _ = belief.moved(way).seen(self._chart, beams.points, beams.rays, half)
        self._way += way.way
        at = between(self.poses[-1], belief.mean[POSE])
        if np.hypot(at[0], at[1]) > APART or abs(at[2]) > TURNED:
            self._keep(belief, beams, at, _info(belief, float(belief.mean[2] - at[2])))
        else:
            self.belief = belief
            if len(self.frames[-1].views) < VIEWS:
                self.frames[-1].views.append(_view(beams, at))

    def _keep(self, belief: Belief, beams: Beams, at: FloatArray | None = None,
              info: FloatArray | None = None) -> None:
        """A keyframe at the belief, which is ``at`` that of the last."""
        self.frames.append(Keyframe(self._way, [_view(beams, np.zeros(3))]))
        self.poses = np.vstack((self.poses, belief.mean[POSE]))
        last = len(self.frames) - 1
        if at is not None and info is not None:
            self.edges.append(Edge(last - 1, last, at, info))
        if self._closures is not None:
            found = self._closures.of(self.frames, self.poses, last)
            if found:
                self.edges += found
                self.poses = solve(self.poses, self.edges).poses
        self.belief = _anchored(belief, self.poses[-1])
        ways = np.array([frame.way for frame in self.frames])
        first = int(np.searchsorted(ways, self._way - RECENT))
        self._chart = chart_of_points(points_of(self.frames[first:], self.poses[first:]))


def _view(beams: Beams, at: FloatArray) -> View:
    return View(float(beams.way.t[-1]), beams.points, beams.rays, beams.origin, at)


def _info(belief: Belief, yaw: float) -> FloatArray:
    """Of the belief's pose (3, 3), in axes turned by ``yaw`` [rad]."""
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array(((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)))
    cov = belief.cov[POSE, POSE] + np.diag(ANCHORED**2)
    info: FloatArray = np.linalg.inv(turn @ cov @ turn.T)
    return info


def _anchored(belief: Belief, pose: FloatArray) -> Belief:
    """At the pose of a keyframe, which the next ones are measured from."""
    mean, cov = belief.mean.copy(), belief.cov.copy()
    mean[POSE] = pose
    cov[POSE, :] = cov[:, POSE] = 0.0
    cov[POSE, POSE] = np.diag(ANCHORED**2)
    return Belief(belief.t, mean, cov)
