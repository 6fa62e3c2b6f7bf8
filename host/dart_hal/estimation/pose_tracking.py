"""Where the car is in the room: the last believed external pose and the odometry since.

    room(t) = pose(t0) + R(offset) (odometry(t) - odometry(t0))

The covariance grows with what wheels and gyro get wrong between, and with what
is not known of where the marker sits. A pose that the car cannot have reached
is not believed; nor is one that stands while the wheels turn (false lock). The
track is taken up again where poses have moved as the car did for ``CONFIRMED``
metres: while it stands nobody can tell a right pose from a wrong one.
"""

from __future__ import annotations

from collections import deque
from enum import Enum
from itertools import pairwise
from math import atan2, cos, hypot, inf, sin, sqrt, tau
from typing import NamedTuple

import numpy as np

from dart_hal.core.clock_fit import ClockFit
from dart_hal.core.types import External, ExternalPose, Pose, Tracking

STEP, YAW_STEP = 0.06, 0.2
"""m, rad: steps of the mocap beyond which the published recordings hold outliers."""
SIGMAS = 4.0
"""Standard errors: 1 in 16 000 by chance, once in two and a half minutes of 100 Hz."""
MARKER, MARKER_YAW = 0.15, 0.05
"""m, rad: the marker is at most so far from the rear axle and from the car's heading
(0.115 m and 0.027 rad in the published recordings); odometry turns about the axle."""
STANDS_FOR, STANDS, DRIVES = 0.3, 0.05, 0.25
"""s, m/s, m/s: false lock as in the published recordings, mocap slower, wheels faster."""
CONFIRMED = 0.25
"""m of the car's travel along which poses must agree to be taken up again."""
FRESH, STEPS = 0.05, 2.5
"""s, or so many usual steps of the source, for which the last pose is news."""
LOST_AFTER = 5.0
"""s without a believed pose: a drift of 1 deg/s of the gyro is 5 deg by then."""
SHORTER, LONGER, ASIDE = 0.7, 1.4, 0.5
"""Way of the poses over the car's, and rad between them, along ``CONFIRMED``: a gyro and wheels
that were never calibrated are off by less, another body by more."""
HISTORY = 2.0
"""s of odometry kept for poses that arrive late."""


class _Fix(NamedTuple):
    """An external pose with the time [s] of its measurement and the odometry then."""

    t: float
    pose: ExternalPose
    odometry: Pose


class Taken(Enum):
    """What became of a pose."""

    FIRST = "there was none before"
    FITS = "it goes on from the last one believed"
    ANEW = "the track goes on elsewhere: it has moved there as the car did"
    FOOLED = "it is a false lock, and so were all since the time that is given"
    REFUSED = "the car cannot have reached it"
    OLD = "it is no news"


class PoseTracker:
    """One per open car. ``moved`` for each State, ``add`` for each pose, ``at`` to ask.

    own_clock: stamps are on the car's clock, those of its own lidar.
    """

    def __init__(self, *, own_clock: bool = False) -> None:
        self._own_clock = own_clock
        self._clock = ClockFit(byte_time=0.0, latch_delay=0.0)
        self._first_stamp: float | None = None
        self._stamp = -inf
        self._odometry: deque[tuple[float, Pose]] = deque()
        self._believed: deque[_Fix] = deque()
        self._candidates: list[_Fix] = []
        self._newest: ExternalPose | None = None
        self._newest_t = -inf
        self._step = 0.01

    def moved(self, t: float, odometry: Pose) -> None:
        """The odometry of the State at t [s]."""
        kept = self._odometry
        if kept and t <= kept[-1][0]:
            return
        kept.append((t, odometry))
        while kept[0][0] < t - HISTORY:
            kept.popleft()

    def add(self, pose: ExternalPose) -> tuple[Taken, float]:
        """A pose that has arrived; one out of order is only noted as the newest.

        Returns what became of it and the time [s] of its measurement on the car's clock.
        """
        self._newest = pose
        if self._first_stamp is None:
            self._first_stamp = pose.stamp
        if pose.stamp <= self._stamp or not self._odometry:
            return Taken.OLD, pose.arrival
        self._stamp = pose.stamp
        since = pose.stamp - self._first_stamp
        self._clock.add_frame(since, pose.arrival, 0.0)
        told = pose.stamp if self._own_clock else self._clock.to_host(since)[0]
        t = min(told, pose.arrival)
        self._step += 0.1 * (min(t - self._newest_t, 1.0) - self._step)
        self._newest_t = t
        fix = _Fix(t, pose, self._odometry_at(t))
        if not self._candidates and self._agrees(fix):
            return self._believe(fix)
        return self._take_up(fix)

    def at(self, t: float) -> External:
        """What is known for the State at t [s], the newest that was ``moved``."""
        if not self._believed:
            return External(Tracking.JUMPED if self._candidates else Tracking.LOST, inf, None,
                            self._newest)
        last = self._believed[-1]
        age = max(t - last.t, 0.0)
        fresh = max(FRESH, STEPS * self._step)
        if self._candidates and t - self._newest_t <= fresh:
            tracking = Tracking.JUMPED
        elif age <= fresh:
            tracking = Tracking.TRACKING
        else:
            tracking = Tracking.DEAD_RECKONING if age <= LOST_AFTER else Tracking.LOST
        return External(tracking, age, carried(last.pose, last.odometry, self._odometry_at(t)),
                        self._newest)

    def _odometry_at(self, t: float) -> Pose:
        """Linear between States; beyond the newest the last step goes on."""
        kept = self._odometry
        k = len(kept) - 1
        while k > 1 and kept[k - 1][0] > t:
            k -= 1
        if k < 1 or t >= kept[-1][0] + FRESH or t == kept[k][0]:
            return kept[-1][1] if t > kept[-1][0] else kept[k][1]
        (t0, a), (t1, b) = kept[k - 1], kept[k]
        part = max((t - t0) / (t1 - t0), 0.0)
        return Pose(a.x + part * (b.x - a.x), a.y + part * (b.y - a.y),
                    a.yaw + part * (b.yaw - a.yaw), b.cov)

    def _agrees(self, fix: _Fix) -> bool:
        """Whether the car can have come from the last believed pose to this one."""
        return not self._believed or _reachable(self._believed[-1], fix)

    def _believe(self, fix: _Fix) -> tuple[Taken, float]:
        """Believe, unless for a while poses have stood that the wheels left behind."""
        kept = self._believed
        taken = Taken.FITS if kept else Taken.FIRST
        kept.append(fix)
        while len(kept) > 1 and kept[0].t < fix.t - HISTORY:
            kept.popleft()
        start = next((old for old in reversed(kept) if old.t <= fix.t - STANDS_FOR), None)
        if start is None:
            return taken, fix.t
        seconds = fix.t - start.t
        drove = _distance(start.odometry, fix.odometry)
        moved = hypot(fix.pose.x - start.pose.x, fix.pose.y - start.pose.y)
        if drove > DRIVES * seconds and moved < STANDS * seconds:
            while len(kept) > 1 and kept[-1].t > start.t:
                kept.pop()
            self._candidates = [fix]
            return Taken.FOOLED, start.t
        return taken, fix.t

    def _take_up(self, fix: _Fix) -> tuple[Taken, float]:
        """Poses beside the track: believed again once they move as the car does."""
        found = self._candidates
        if found and not _reachable(found[-1], fix):
            found.clear()
        if not found and self._agrees(fix):
            return self._believe(fix)
        found.append(fix)
        start = found[0]
        travel = sum(_distance(a.odometry, b.odometry) for a, b in pairwise(found))
        if travel >= CONFIRMED:
            if _reachable(start, fix) and _went(start, fix):
                found.clear()
                self._believed.clear()
                self._believed.append(fix)
                return Taken.ANEW, fix.t
            self._candidates = [fix]
        return Taken.REFUSED, fix.t


def _moved(pose: ExternalPose, start: Pose, end: Pose) -> tuple[float, float, float]:
    """x, y, yaw of the marker after the odometry has gone on from ``start`` to ``end``."""
    turned = pose.yaw - start.yaw
    c, s = cos(turned), sin(turned)
    ox, oy = end.x - start.x, end.y - start.y
    return pose.x + c * ox - s * oy, pose.y + s * ox + c * oy, pose.yaw + end.yaw - start.yaw


def carried(pose: ExternalPose, start: Pose, end: Pose) -> Pose:
    """The marker's pose, with its covariance, after the odometry has gone on.

    What the odometry got wrong since is taken as equal to all sides, and as
    independent of the pose: never too small.
    """
    x, y, yaw = _moved(pose, start, end)
    ox, oy = end.x - start.x, end.y - start.y
    xx, xt, yy, yt, tt = (float(start.cov[i]) for i in ((0, 0), (0, 2), (1, 1), (1, 2), (2, 2)))
    lag = (MARKER * (end.yaw - start.yaw))**2 + (MARKER_YAW**2) * (ox * ox + oy * oy)
    aside = lag + (max(float(end.cov[0, 0]) - (xx - 2.0 * oy * xt + oy * oy * tt), 0.0)
                   + max(float(end.cov[1, 1]) - (yy + 2.0 * ox * yt + ox * ox * tt), 0.0))
    turn = max(float(end.cov[2, 2]) - tt, 0.0)
    lever = np.array(((1.0, 0.0, pose.y - y), (0.0, 1.0, x - pose.x), (0.0, 0.0, 1.0)))
    cov = lever @ pose.cov @ lever.T
    cov[(0, 1, 2), (0, 1, 2)] += (aside, aside, turn)
    cov.setflags(write=False)
    return Pose(x, y, yaw, cov)


def _distance(a: Pose, b: Pose) -> float:
    return hypot(b.x - a.x, b.y - a.y)


def _reachable(a: _Fix, b: _Fix) -> bool:
    """Whether the car can have come from a to b, by its odometry and its errors."""
    x, y, yaw = _moved(a.pose, a.odometry, b.odometry)
    error = hypot(b.pose.x - x, b.pose.y - y)
    off = b.pose.yaw - yaw
    off = abs(off - tau * round(off / tau))
    if error <= STEP and off <= YAW_STEP:
        return True
    there = carried(a.pose, a.odometry, b.odometry)
    seen = b.pose.cov
    spread = sqrt(float(there.cov[0, 0] + there.cov[1, 1] + seen[0, 0] + seen[1, 1]))
    turn = sqrt(float(there.cov[2, 2] + seen[2, 2]))
    return error <= STEP + SIGMAS * spread and off <= YAW_STEP + SIGMAS * turn


def _went(a: _Fix, b: _Fix) -> bool:
    """Whether the pose went as far as the car did, and the same way."""
    x, y, _ = _moved(a.pose, a.odometry, b.odometry)
    ax, ay = x - a.pose.x, y - a.pose.y
    bx, by = b.pose.x - a.pose.x, b.pose.y - a.pose.y
    off = atan2(ax * by - ay * bx, ax * bx + ay * by)
    far, seen = hypot(ax, ay), hypot(bx, by)
    return SHORTER * far < seen < LONGER * far + STEP and abs(off) < ASIDE
