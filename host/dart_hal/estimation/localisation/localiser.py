"""Scans, wheels and gyro into poses in a map: search, then track, and say when it fails.

``moved`` for each State, ``add`` for each scan that is whole by then. A scan is taken apart into
beams, each placed by the odometry at its own time in the axes that the car has at the last one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import Pose, Scan
from dart_hal.devices.lidar.health import Watch
from dart_hal.estimation.localisation.beams import Beams, beams_of
from dart_hal.estimation.localisation.belief import (
    ERRORS,
    POSE,
    SEEN,
    TAU,
    UNLEARNT,
    Belief,
    again,
    begun,
)
from dart_hal.estimation.localisation.field import Map
from dart_hal.estimation.localisation.health import FITS, Judge, Status, agreement
from dart_hal.estimation.localisation.path import Steps
from dart_hal.estimation.localisation.search import search

PROVEN = 5
"""Scans that a pose which was searched must explain, while the car goes on, until it is told."""
FAR = 4.0
"""m that it must go on to explain them where boxes do not stand as in the map, for a pose to be
told: another room of the same outline has walls elsewhere."""
LONGEST = 4.0
"""s without a scan that are bridged by wheels and gyro."""
MIRRORED = -0.3
"""Sense of the scans against the gyro, 1 right, below which their rotation is taken wrongly."""


@dataclass(frozen=True, slots=True)
class Located:
    """What one scan told. t [s]: of the pose on the clock of the States; arrival [s]: of the scan;
    pose: None while there is none to go by, also of a single scan that disagrees; agreement: share
    of beams that the map explains; mirrored: the scans turn against the gyro."""

    t: float
    arrival: float
    status: Status
    pose: Pose | None
    agreement: float
    mirrored: bool = False


class Localiser:
    """One per car and map. start: x, y [m], yaw [rad] where it is known.

    ``belief``: the filter, None while the car is nowhere. deskew: False puts all beams at the
    middle of the scan: what comes of it is a control, no use.
    """

    def __init__(self, chart: Map, start: tuple[float, float, float] | None = None, *,
                 deskew: bool = True) -> None:
        self.chart, self.deskew = chart, deskew
        self.belief: Belief | None = None
        self._start = None if start is None else np.array(start)
        self._steps, self._watch, self._yaw = Steps(), Watch(), 0.0
        self._judge, self._proven, self._owed = Judge(1.0), 0, 0.0
        self._mapped = start is not None
        """Whether this is the room of the map: somebody said so, or a track has shown it."""
        self._learnt: Belief | None = None

    def moved(self, t: float, x: float, y: float, yaw: float, accel: float | None = None) -> None:
        """Dead reckoning of the State at t [s], acceleration [m/s2] along the nose."""
        self._steps.moved(t, x, y, yaw, accel)
        self._yaw = yaw

    def add(self, scan: Scan) -> Located | None:
        """One scan; None where it tells nothing: too few beams, or no odometry for it."""
        if self._watch.sense is None:
            self._watch.add(scan, self._yaw)
        beams = self._beams(scan)
        if beams is None:
            return None
        t, belief = float(beams.way.t[-1]), self.belief
        if belief is not None and not (belief.t < t < belief.t + LONGEST
                                       and self._steps.covers(belief.t, t)):
            belief = self.belief = None
        if belief is None and not self._begin(beams):
            return Located(t, scan.arrival, self._nowhere, None, self._agreed, self._mirrored)
        return self._track(beams, scan.arrival)

    @property
    def _mirrored(self) -> bool:
        return (self._watch.sense or 0.0) < MIRRORED

    def _beams(self, scan: Scan) -> Beams | None:
        known = self.belief or self._learnt
        errors = UNLEARNT if known is None else known.mean[ERRORS]
        late = 0.0 if known is None else float(known.mean[TAU])
        return beams_of(scan, self._steps, errors, late, deskew=self.deskew)

    def _begin(self, beams: Beams) -> bool:
        """Find the car; False where it cannot be found with this scan."""
        t = float(beams.way.t[-1])
        self._agreed, self._nowhere, self._proven, self._owed = 0.0, Status.LOST, 0, 0.0
        if self._start is not None:
            pose, self._start, self._proven = self._start, None, PROVEN
            self._judge = Judge(1.0)
        elif self._mirrored:
            return False
        else:
            found = search(self.chart, beams.points, beams.rays, beams.origin)
            self._agreed = found.agreement.share
            if not (found.fits and found.sure):
                self._nowhere = Status.AMBIGUOUS if found.fits else Status.LOST
                return False
            pose, self._owed = found.pose[:3], 0.0 if self._mapped or found.known else FAR
            self._judge = Judge(found.agreement.share,
                                None if self._mapped else found.agreement)
        self.belief = (begun(t, pose) if self._learnt is None else again(self._learnt, t, pose))
        return True

    def _track(self, beams: Beams, arrival: float) -> Located:
        assert self.belief is not None
        t = float(beams.way.t[-1])
        way = self._steps.stretch(self.belief.t, t, self.belief.mean[ERRORS])
        half = self._steps.stretch(0.5 * float(beams.way.t[0] + t), t, self.belief.mean[ERRORS])
        belief = self.belief.moved(way).seen(self.chart, beams.points, beams.rays, half)[0]
        agreed = agreement(self.chart, belief.mean[SEEN,], beams.points, beams.rays, beams.origin)
        status = self._judge.add(agreed)
        if status is Status.LOST or self._mirrored or (self._proven < PROVEN
                                                            and agreed.proof() < FITS):
            self.belief, self._agreed = None, agreed.share
            return Located(t, arrival, Status.LOST, None, agreed.share, self._mirrored)
        self.belief = belief
        self._proven += 1
        self._owed -= way.way
        proven = self._proven > PROVEN and self._owed <= 0.0
        if not proven or self._judge.doubted:
            return Located(t, arrival, status if proven else Status.LOST, None, agreed.share)
        self._learnt = belief
        self._mapped = self._mapped or not self._judge.fresh
        cov = belief.cov[POSE, POSE].copy()
        cov.setflags(write=False)
        x, y, yaw = belief.mean[POSE].tolist()
        return Located(t, arrival, status, Pose(x, y, yaw, cov), agreed.share)
