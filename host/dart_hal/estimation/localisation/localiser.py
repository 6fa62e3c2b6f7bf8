"""Localisation in a map by scans, wheels and gyro: global search, tracking, detection of failure.

``update_odometry`` for each State, ``add`` for each complete scan. A scan is divided into beams,
each placed by the odometry at its own time in the axes of the car at the last one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import Pose, Scan
from dart_hal.devices.lidar.health import LidarHealthMonitor
from dart_hal.estimation.localisation.beams import Beams, place_beams
from dart_hal.estimation.localisation.belief import (
    DEFAULT_ERRORS,
    ERRORS,
    MATCHED,
    POSE,
    TAU,
    Belief,
    restart_belief,
    start_belief,
)
from dart_hal.estimation.localisation.field import Map
from dart_hal.estimation.localisation.health import MIN_PROOF, Status, TrackJudge, agreement
from dart_hal.estimation.localisation.path import OdometrySteps
from dart_hal.estimation.localisation.range_noise import RangeNoise
from dart_hal.estimation.localisation.search import search, search_period

# Scans after that of a search which its pose must explain; it is reported with the last of them.
MIN_PROOF_SCANS = 5
# m of travel in which it must explain them if boxes are not as in the map: another room of the
# same outline has walls elsewhere.
PROOF_DISTANCE = 4.0
# s without a scan that are bridged by wheels and gyro.
MAX_SCAN_GAP = 4.0
# Rotation of the scans over that of the gyro, 1 if right, below which the lidar is configured
# upside down.
MIN_ROTATION_SENSE = -0.3


@dataclass(frozen=True, slots=True)
class Located:
    """Result of one scan.

    t [s]: of the pose on the clock of the States; arrival [s]: of the scan; pose: None if unknown,
    also for a single scan that disagrees; agreement: share of beams that the map explains;
    mirrored: the scans rotate against the gyro.
    """

    t: float
    arrival: float
    status: Status
    pose: Pose | None
    agreement: float
    mirrored: bool = False


class Localiser:
    """One per car and map. start: x, y [m], yaw [rad] if known.

    ``belief``: the filter, None while the position is unknown; ``beams``: those of the last scan,
    None before it and if they were too few. deskew: False places all beams at
    the middle of the scan, as a negative control.
    """

    def __init__(self, chart: Map, start: tuple[float, float, float] | None = None, *,
                 deskew: bool = True) -> None:
        self.chart = chart
        self.deskew = deskew
        self.belief: Belief | None = None
        self.beams: Beams | None = None
        self._start = None if start is None else np.array(start)
        self._steps = OdometrySteps()
        self._noise = RangeNoise()
        self._watch = LidarHealthMonitor()
        self._yaw = 0.0
        self._judge = TrackJudge(1.0)
        self._failure = Status.LOST
        self._agreement = 0.0
        self._last_search = -np.inf
        self._proof_scans = 0
        self._proof_distance = 0.0
        # Whether this is the room of the map, by the given start or by a proven track.
        self._is_known_map = start is not None
        self._learnt: Belief | None = None

    def update_odometry(self, t: float, x: float, y: float, yaw: float,
                        accel: float | None = None) -> None:
        """Add the dead reckoning of the State at t [s]; accel [m/s2] along the nose."""
        self._steps.add(t, x, y, yaw, accel)
        self._yaw = yaw

    def add(self, scan: Scan) -> Located | None:
        """Add one scan; return None if it has too few beams, or no odometry."""
        if self._watch.sense is None:
            self._watch.add(scan, self._yaw)
        beams = self.beams = self._beams(scan)
        if beams is None:
            return None
        t = float(beams.stretch.t[-1])
        belief = self.belief
        if belief is not None and not (belief.t < t < belief.t + MAX_SCAN_GAP
                                       and self._steps.covers(belief.t, t)):
            belief = self.belief = None
        if belief is None and not self._find(beams):
            return Located(t, scan.arrival, self._failure, None, self._agreement, self._mirrored)
        return self._track(beams, scan.arrival)

    @property
    def _mirrored(self) -> bool:
        """Whether the scans rotate against the gyro."""
        return (self._watch.sense or 0.0) < MIN_ROTATION_SENSE

    def _beams(self, scan: Scan) -> Beams | None:
        """Place the beams with the learnt errors of wheels, gyro and latency."""
        known = self.belief or self._learnt
        errors = DEFAULT_ERRORS if known is None else known.mean[ERRORS]
        late = 0.0 if known is None else float(known.mean[TAU])
        self._noise.add(scan.range)
        return place_beams(scan, self._steps, errors, late, self._noise, deskew=self.deskew)

    def _find(self, beams: Beams) -> bool:
        """Find the car by the given start, or by a search if one is due; return whether found."""
        t = float(beams.stretch.t[-1])
        self._proof_scans = 0
        self._proof_distance = 0.0
        if self._start is not None:
            pose = self._start
            self._start = None
            self._proof_scans = MIN_PROOF_SCANS
            self._judge = TrackJudge(1.0)
        elif self._mirrored:
            self._agreement = 0.0
            self._failure = Status.LOST
            return False
        elif 0.0 <= t - self._last_search < search_period(self.chart):
            return False
        else:
            self._last_search = t
            found = search(self.chart, beams.points, beams.rays, beams.origin)
            self._agreement = found.agreement.share
            is_ambiguous = found.fits and not found.is_unique
            self._failure = Status.AMBIGUOUS if is_ambiguous else Status.LOST
            if is_ambiguous or not found.fits:
                return False
            pose = found.pose[:3]
            is_known = self._is_known_map or found.is_known_room
            self._proof_distance = 0.0 if is_known else PROOF_DISTANCE
            self._judge = TrackJudge(found.agreement.share,
                                     None if self._is_known_map else found.agreement)
        self.belief = (start_belief(t, pose) if self._learnt is None
                       else restart_belief(self._learnt, t, pose))
        return True

    def _track(self, beams: Beams, arrival: float) -> Located:
        """Predict, match and evaluate one scan; report the pose once it is proven."""
        assert self.belief is not None
        t = float(beams.stretch.t[-1])
        stretch = self._steps.stretch(self.belief.t, t, self.belief.mean[ERRORS])
        half = self._steps.stretch(0.5 * float(beams.stretch.t[0] + t), t, self.belief.mean[ERRORS])
        predicted = self.belief.predict(stretch)
        belief = predicted.update_with_scan(self.chart, beams, half)[0]
        agreed = agreement(self.chart, belief.mean[MATCHED,], beams.points, beams.rays,
                           beams.origin)
        status = self._judge.add(agreed)
        if status is Status.LOST or self._mirrored or (self._proof_scans < MIN_PROOF_SCANS
                                                            and agreed.proof() < MIN_PROOF):
            self.belief = None
            self._agreement = agreed.share
            return Located(t, arrival, Status.LOST, None, agreed.share, self._mirrored)
        self.belief = belief
        self._proof_scans += 1
        self._proof_distance -= stretch.distance
        proven = self._proof_scans > MIN_PROOF_SCANS and self._proof_distance <= 0.0
        if not proven or self._judge.in_doubt:
            return Located(t, arrival, status if proven else Status.LOST, None, agreed.share)
        self._learnt = belief
        self._is_known_map = self._is_known_map or not self._judge.on_probation
        cov = belief.cov[POSE, POSE].copy()
        cov.setflags(write=False)
        x, y, yaw = belief.mean[POSE].tolist()
        return Located(t, arrival, status, Pose(x, y, yaw, cov), agreed.share)
