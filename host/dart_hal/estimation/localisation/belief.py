"""Pose and errors of wheels, gyro and clocks: an extended Kalman filter with nine states.

    x, y, yaw   of the rear axle in the map at ``t``        k   travel scale, relative
    b           gyro bias, rad/s                           g   gyro scale, relative
    s           slip gain, rad per m/s2                    tau latency of the scan stamps, s
    scale       of the lidar distances, relative

A scan is not a measurement with its own noise: the matcher minimises scan and prior together, and
its correction of pose and scale updates the other states through the covariance. A wrong latency
shifts the scan along the path of the car; this makes tau observable. A scan measures the pose in
its middle; the motion from there to its end is of wheels and gyro, with their errors.

The pose filter of the car fuses these poses with the same wheels and gyro again and takes both for
independent. Where walls are visible the scan determines the pose, and the prior by wheels and gyro
has little weight in it. Along a corridor it has all the weight: there the pose filter counts their
information twice and may be too confident.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.beams import Beams
from dart_hal.estimation.localisation.field import Map
from dart_hal.estimation.localisation.matcher import Match, match
from dart_hal.estimation.localisation.path import Stretch
from dart_hal.estimation.spin import SPIN_SPEED_STD

POSE = slice(0, 3)
ERRORS = slice(3, 7)
SLIP = 6
TAU = 7
SCALE = 8
# States that the match of a scan estimates.
MATCHED = (0, 1, 2, SCALE)
# One sigma of each state at the start. x, y, yaw: of a coarse search. k, b, g: of an uncalibrated
# car. s: of the published sets (0.011 and 0.034 rad per m/s2). tau: as large as MEAN_LATENCY.
# scale: 1.5 % of the distances at 2 sigma, of an uncalibrated X4.
START_STDS = np.array((0.05, 0.05, 0.03, 0.03, 0.015, 0.02, 0.016, 0.010, 0.008))
# rad per m/s2: mean of the published sets.
MEAN_SLIP_GAIN = 0.0225
# s: half of a packet, its transfer, and 5 ms of odometry.
MEAN_LATENCY = 0.01
# k, b, g, s of an unknown car.
DEFAULT_ERRORS = np.array((0.0, 0.0, 0.0, MEAN_SLIP_GAIN))
# Variance per s of k, b, g, s, tau, scale: a bias changes by 0.001 rad/s in 100 s, the slip
# because tyres are not linear.
ERROR_WALK = np.array((1e-4, 1e-4, 1e-4, 1e-3, 1e-4, 3e-5))**2
# m per sqrt(m): random error of the travel.
TRAVEL_NOISE = 0.004
# m per sqrt(m), of the slip.
SLIP_NOISE = 0.004
# rad per sqrt(m), of the heading.
HEADING_NOISE = 0.002
# Squared Mahalanobis distance of four numbers, exceeded by 1 in 20 000: a wheel spun, or the car
# was pushed.
MAX_DISTANCE2 = 25.0
# Share of the error of the motion from the middle of a scan to its end that becomes an error of
# the match: beams before and after the middle are off to opposite sides, and walls are unevenly
# visible.
SCAN_MOTION_SHARE = 0.5
# Share of the innovation, one sigma, that also deforms the scan: a push between two middles of
# scans may continue from the middle to the end, or have ended there.
SCAN_PUSH_SHARE = 0.4
# m, m, rad by which the car may have moved between two scans after a push: a wheel 60 % too fast
# at 2 m/s.
PUSH_COVARIANCE = np.diag(np.array((0.15, 0.15, 0.06))**2)


@dataclass(frozen=True, slots=True)
class Belief:
    """State of the filter: t [s] of the pose; mean (9,), cov (9, 9)."""

    t: float
    mean: FloatArray
    cov: FloatArray

    def predict(self, stretch: Stretch) -> Belief:
        """Predict the state to the end of a stretch that begins at ``t``."""
        yaw = float(self.mean[2])
        c = np.cos(yaw)
        s = np.sin(yaw)
        rotation = np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
        step = rotation @ stretch.pose[-1]
        mean = self.mean.copy()
        jacobian = np.eye(len(START_STDS))
        mean[POSE] += step
        jacobian[0, 2] = -step[1]
        jacobian[1, 2] = step[0]
        jacobian[POSE, ERRORS] = rotation @ stretch.jacobian
        cov = jacobian @ self.cov @ jacobian.T
        noise = np.diag((TRAVEL_NOISE**2, SLIP_NOISE**2, HEADING_NOISE**2)) * stretch.distance
        noise += SPIN_SPEED_STD**2 * np.outer(stretch.spin_jacobian, stretch.spin_jacobian)
        cov[POSE, POSE] += rotation @ noise @ rotation.T
        index = np.arange(3, len(START_STDS))
        cov[index, index] += ERROR_WALK * (stretch.t[-1] - stretch.t[0])
        return Belief(float(stretch.t[-1]), mean, cov)

    def update_with_scan(self, chart: Map, beams: Beams, stretch: Stretch) -> tuple[Belief, Match]:
        """Update with one scan; return the new belief and the match.

        stretch: from the middle of the scan to its end.
        """
        end = float(stretch.pose[-1, 2])
        c = np.cos(self.mean[2] - end)
        s = np.sin(self.mean[2] - end)
        rotation = np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
        # 1. Observation matrix H (4, 9): the matched pose, x, y, yaw, and scale, by the state. The
        #    scan measures the pose in its middle, so the effect of the errors (k, b, g, s) and of
        #    tau on the motion from there to the end is subtracted.
        observation = np.zeros((4, len(START_STDS)))
        observation[(0, 1, 2, 3), MATCHED] = 1.0
        observation[:3, ERRORS] = -rotation @ stretch.jacobian
        observation[:3, TAU] = -rotation @ stretch.rate
        # 2. Match scan and prior; accept the result if it is close to the prior.
        information = np.linalg.inv(observation @ self.cov @ observation.T)
        start = self.mean[MATCHED,]
        found = match(chart, beams.points, beams.rays, start, information, spread=beams.spread)
        innovation = found.pose - start
        if innovation @ information @ innovation < MAX_DISTANCE2:
            return self._correct(observation, information, found, innovation), found
        # 3. Otherwise the car was pushed or a wheel spun: match again with a wider prior.
        pushed = replace(self, cov=_widen_pose(self.cov))
        information = np.linalg.inv(observation @ pushed.cov @ observation.T)
        found = match(chart, beams.points, beams.rays, start, information, spread=beams.spread)
        innovation = found.pose - start
        return pushed._correct(observation, information, found, innovation, SCAN_PUSH_SHARE), found

    def _correct(self, observation: FloatArray, information: FloatArray, found: Match,
                 innovation: FloatArray, push_share: float = 0.0) -> Belief:
        """Update by a match; the motion within the scan, and so its shape, is uncertain."""
        motion_cov = np.zeros((4, 4))
        shape = observation[:3, ERRORS]
        motion_cov[:3, :3] = SCAN_MOTION_SHARE**2 * shape @ self.cov[ERRORS, ERRORS] @ shape.T
        motion_cov[:3, :3] += push_share**2 * np.outer(innovation[:3], innovation[:3])
        weakening = np.linalg.inv(np.eye(4) + found.info @ motion_cov)
        weighted = weakening @ (information + found.info) @ innovation
        posterior = np.linalg.inv(information + weakening @ found.info)
        gain = self.cov @ observation.T @ information
        cov = self.cov - gain @ (np.linalg.inv(information) - posterior) @ gain.T
        return Belief(self.t, self.mean + gain @ posterior @ weighted, 0.5 * (cov + cov.T))


def start_belief(t: float, pose: FloatArray, std: FloatArray = START_STDS) -> Belief:
    """Return the belief at a pose (3,) from a search, with the errors of an unknown car."""
    mean = np.zeros(len(START_STDS))
    mean[POSE] = pose
    mean[SLIP] = MEAN_SLIP_GAIN
    mean[TAU] = MEAN_LATENCY
    return Belief(t, mean, np.diag(std**2))


def restart_belief(belief: Belief, t: float, pose: FloatArray) -> Belief:
    """Return the belief at another pose, with the learnt errors of the car."""
    restarted = start_belief(t, pose)
    restarted.mean[3:] = belief.mean[3:]
    restarted.cov[3:, 3:] = belief.cov[3:, 3:]
    return restarted


def _widen_pose(cov: FloatArray) -> FloatArray:
    """Return the covariance with that of a push added to the pose."""
    widened: FloatArray = cov.copy()
    widened[POSE, POSE] += PUSH_COVARIANCE
    return widened
