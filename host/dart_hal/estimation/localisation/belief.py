"""What is known of the pose and of what wheels, gyro and clocks get wrong: an EKF of nine states.

    x, y, yaw   of the rear axle in the map at ``t``        k   travel scale, relative
    b           gyro bias, rad/s                           g   gyro scale, relative
    s           slip gain, rad per m/s2                    tau how late stamps of scans are, s
    scale       of the lidar's distances, relative

A scan is not a measurement with a noise of its own: the matcher minimises scan and belief together,
and what it makes of pose and scale moves the other states through the covariance. Stamps are late
by tau + e: then the scan was taken where the car had been e s before, which is how tau is seen.
What a scan tells is the pose in its middle; the way from there to its end is of wheels and gyro,
with their errors in it, and the filter knows that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.field import Map
from dart_hal.estimation.localisation.matcher import Match, match
from dart_hal.estimation.localisation.path import Stretch
from dart_hal.estimation.spin import SPIN_SPEED_STD

POSE, ERRORS, TAU, SCALE = slice(0, 3), slice(3, 7), 7, 8
SEEN = (0, 1, 2, SCALE)
"""What a scan is laid on the map by."""
STD = np.array((0.05, 0.05, 0.03, 0.03, 0.015, 0.02, 0.016, 0.010, 0.008))
"""One sigma at the beginning: pose of a coarse search; a car that was never calibrated; slip of
the published sets (0.011 and 0.034 rad per m/s2); 1.5 % of a bare X4's distances at 2 sigma."""
SLIP, LATE = 0.0225, 0.01
"""rad per m/s2 and s: means of the same. Half of a packet, its way, and 5 ms of odometry."""
UNLEARNT = np.array((0.0, 0.0, 0.0, SLIP))
"""k, b, g, s of a car of which nothing is known."""
WANDER = np.array((1e-4, 1e-4, 1e-4, 1e-3, 1e-4, 3e-5))**2
"""Variance per s of k, b, g, s, tau, scale: a bias goes by 0.001 rad/s in 100 s, the slip by the
tyres' being no line."""
ALONG, ASIDE, TURN = 0.004, 0.004, 0.002
"""m, m, rad per sqrt(m): random errors of the way, of the slip, of the heading."""
SURPRISE = 25.0
"""Squared deviation of four numbers, 1 in 20 000: a wheel spun, or the car was pushed."""
BENT = 0.5
"""Of what the way from the middle of a scan to its end may be wrong by, as an error of the match:
beams before and after the middle are off to opposite sides, and walls are not seen alike."""
SPREAD = 0.4
"""Of the surprise, one sigma of what it bends the scan itself by: what moved the car between two
middles of scans goes on from the middle to the end, or ended there."""
PUSHED = np.diag(np.array((0.15, 0.15, 0.06))**2)
"""m, m, rad by which it may have gone then between two scans: a wheel 60 % too quick at 2 m/s."""


@dataclass(frozen=True, slots=True)
class Belief:
    """t [s]: of the pose; mean (9,), cov (9, 9)."""

    t: float
    mean: FloatArray
    cov: FloatArray

    def moved(self, way: Stretch) -> Belief:
        """At the end of a stretch that begins at ``t``."""
        yaw = float(self.mean[2])
        c, s = np.cos(yaw), np.sin(yaw)
        turn = np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
        step = turn @ way.pose[-1]
        mean, by = self.mean.copy(), np.eye(len(STD))
        mean[POSE] += step
        by[0, 2], by[1, 2] = -step[1], step[0]
        by[POSE, ERRORS] = turn @ way.by
        cov = by @ self.cov @ by.T
        noise = np.diag((ALONG**2, ASIDE**2, TURN**2)) * way.way
        noise += SPIN_SPEED_STD**2 * np.outer(way.loose, way.loose)
        cov[POSE, POSE] += turn @ noise @ turn.T
        index = np.arange(3, len(STD))
        cov[index, index] += WANDER * (way.t[-1] - way.t[0])
        return Belief(float(way.t[-1]), mean, cov)

    def seen(self, chart: Map, points: FloatArray, rays: FloatArray, way: Stretch
             ) -> tuple[Belief, Match]:
        """With one scan: points and rays as ``match`` takes them, way: from the middle of it on."""
        end = float(way.pose[-1, 2])
        c, s = np.cos(self.mean[2] - end), np.sin(self.mean[2] - end)
        turn = np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
        sees = np.zeros((4, len(STD)))
        sees[(0, 1, 2, 3), SEEN] = 1.0
        sees[:3, ERRORS] = -turn @ way.by
        sees[:3, TAU] = -turn @ way.rate
        known = np.linalg.inv(sees @ self.cov @ sees.T)
        start = self.mean[SEEN,]
        found = match(chart, points, rays, start, known)
        off = found.pose - start
        if off @ known @ off < SURPRISE:
            return self._corrected(sees, known, found, off), found
        pushed = replace(self, cov=_pushed(self.cov))
        known = np.linalg.inv(sees @ pushed.cov @ sees.T)
        found = match(chart, points, rays, start, known)
        return pushed._corrected(sees, known, found, found.pose - start, SPREAD), found

    def _corrected(self, sees: FloatArray, known: FloatArray, found: Match, off: FloatArray,
                   spread: float = 0.0) -> Belief:
        """By a match that is ``off`` what was ``known``; its beams were placed by a bent way."""
        bent = np.zeros((4, 4))
        shape = sees[:3, ERRORS]
        bent[:3, :3] = BENT**2 * shape @ self.cov[ERRORS, ERRORS] @ shape.T
        bent[:3, :3] += spread**2 * np.outer(off[:3], off[:3])
        weaker = np.linalg.inv(np.eye(4) + found.info @ bent)
        pull = weaker @ (known + found.info) @ off
        after = np.linalg.inv(known + weaker @ found.info)
        gain = self.cov @ sees.T @ known
        cov = self.cov - gain @ (np.linalg.inv(known) - after) @ gain.T
        return Belief(self.t, self.mean + gain @ after @ pull, 0.5 * (cov + cov.T))


def begun(t: float, pose: FloatArray, std: FloatArray = STD) -> Belief:
    """At a pose (3,) that a search has found, with the errors that any car may have."""
    mean = np.zeros(len(STD))
    mean[POSE], mean[6], mean[TAU] = pose, SLIP, LATE
    return Belief(t, mean, np.diag(std**2))


def again(belief: Belief, t: float, pose: FloatArray) -> Belief:
    """At another pose, with what was learnt of the car."""
    fresh = begun(t, pose)
    fresh.mean[3:] = belief.mean[3:]
    fresh.cov[3:, 3:] = belief.cov[3:, 3:]
    return fresh


def _pushed(cov: FloatArray) -> FloatArray:
    wide: FloatArray = cov.copy()
    wide[POSE, POSE] += PUSHED
    return wide
