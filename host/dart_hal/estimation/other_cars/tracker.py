"""Detection and tracking of other cars by the beams that the map does not explain.

For each sweep:

0. It is cut where the map explains all beams, and begins with what the last one left: a scan begins
   and ends in front of the car, so one ahead would be in two halves at different times.
1. Beams that end where others have ended for seconds are left out: new boxes, people at rest.
   Those of the size of a car become tracks at rest.
2. Each track is predicted to the time of the beams near it, and updated with the poses that
   explain them.
3. Unexplained beams elsewhere are grouped. A rectangle is fitted to each group, at any heading.
4. Fits of successive sweeps that move like one car become a track: then the heading is known.
   Fits that stay at one place become a track at rest: a car, or a new box of its size.

Until its track is confirmed, what has been fitted in two turns is a possible car, and so is all
that is at rest.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, hypot, pi, sin
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.estimation.other_cars.rectangle import (
    CarSize,
    RectangleFit,
    fit_rectangle,
    select_window,
)
from dart_hal.estimation.other_cars.resting import RestingPoints
from dart_hal.estimation.other_cars.sweep import RoomBeams
from dart_hal.estimation.other_cars.tracks import (
    CarTrack,
    start_resting_track,
    start_track,
)

# Beams and m between neighbours of one group, and smallest number of beams of a group.
MAX_BEAM_GAP = 3
MAX_POINT_GAP = 0.15
MIN_GROUP_BEAMS = 3
# m beyond the diagonal of a car up to which a group may be large.
GROUP_MARGIN = 0.10
# Smallest number of hits and share of the beams that should hit, of a fit that counts.
MIN_HITS = 3
MIN_START_SHARE = 0.8
MIN_TRACK_SHARE = 0.6
# A candidate becomes a track by this many fits, within s, at these speeds [m/s] and with this
# deviation [m] from a straight line at constant speed.
START_FITS = 4
MAX_CANDIDATE_TIME = 1.0
START_SPEEDS = (0.25, 4.0)
MAX_START_DEVIATION = 0.05
# The same for a track at rest; the time includes that in which a walking person lifts its foot.
REST_FITS = 6
MAX_REST_SPEED = 0.1
# Share of a sweep that may wait for the next, and s after which it is too old.
MAX_TAIL_SHARE = 0.25
MAX_TAIL_AGE = 0.1
# Sweeps between two searches among the places of rest.
REST_SEARCH_SWEEPS = 4
# m between a fit and the place where the candidate is expected; s without a fit.
CANDIDATE_GATE = 0.35
MAX_CANDIDATE_GAP = 0.4
# m between two listed points of what is at rest: less than the width of a car or of a person.
REST_SPACING = 0.2
# Fits, each of another turn, after which a candidate counts as a possible car.
MIN_POSSIBLE_FITS = 2
# s without beams on a car after which its track ends.
MAX_COAST_TIME = 0.6
# m/s, beyond the fastest car.
MAX_TRACK_SPEED = 5.0
# m between two tracks of one car.
MIN_TRACK_DISTANCE = 0.2
# Poses that are tried: of a track, and of a group in two rounds.
TRACK_POSES = 600
GROUP_POSES = (1500, 400)
# m and rad around the best pose of the first round.
REFINED_STDS = (0.03, 0.03, 0.12)


class PossibleCar(NamedTuple):
    """Something that may be a car: its centre (2,) [m] at t [s]."""

    t: float
    centre: FloatArray


@dataclass(slots=True)
class _Candidate:
    """Fits of something that may be a car: times [s] and centres [m]."""

    times: list[float]
    centres: list[FloatArray]

    def place(self, t: float) -> FloatArray:
        """Return where it is expected at t [s]."""
        if len(self.times) < 2:
            return self.centres[-1]
        dt = self.times[-1] - self.times[-2]
        moved: FloatArray = self.centres[-1] + (t - self.times[-1]) / dt * (
            self.centres[-1] - self.centres[-2])
        return moved

    def add(self, t: float, centre: FloatArray) -> None:
        """Add a fit, and forget those that are too old for a start."""
        self.times.append(t)
        self.centres.append(centre)
        while t - self.times[0] > MAX_CANDIDATE_TIME:
            del self.times[0], self.centres[0]

    def line(self) -> tuple[FloatArray, FloatArray, float]:
        """Return the place (2,) at the last time and the velocity (2,) of the straight line through
        the fits, and their root mean square deviation [m] from it."""
        t = np.array(self.times) - self.times[-1]
        design = np.column_stack((np.ones(len(t)), t))
        centres = np.array(self.centres)
        line = np.linalg.lstsq(design, centres, rcond=None)[0]
        deviation = float(np.sqrt(np.mean(np.sum((centres - design @ line)**2, axis=1))))
        return line[0], line[1], deviation


@dataclass(slots=True)
class CarTracker:
    """Call ``add`` with each sweep, which returns the cars, each at the time of its last beams."""

    size: CarSize
    _tracks: tuple[CarTrack, ...] = ()
    _candidates: list[_Candidate] = field(default_factory=list)
    _resting: RestingPoints = field(default_factory=RestingPoints)
    _count: int = 0
    _sweeps: int = 0
    _tail: RoomBeams | None = None
    _at_rest: tuple[PossibleCar, ...] = ()
    _normal: FloatArray = field(
        default_factory=lambda: np.random.default_rng(0).normal(size=(max(GROUP_POSES), 3)))

    def add(self, sweep: RoomBeams) -> tuple[CarTrack, ...]:
        """Add a sweep; return the confirmed tracks."""
        all_points = sweep.points[sweep.unexplained]
        whole = sweep = self._cut(sweep)
        rests = sweep.unexplained & self._resting.contains(sweep.points)
        self._at_rest = _list_resting(sweep, rests)
        sweep = sweep.select(~rests)
        if not len(sweep.t):
            return self._list_confirmed()
        now = float(sweep.t[-1])
        found = [self._follow(track, whole if track.at_rest else sweep) for track in self._tracks]
        alive = [track for track in found if now - track.hit_t < MAX_COAST_TIME
                 and abs(track.mean[3]) < MAX_TRACK_SPEED and not track.is_contradicted]
        self._tracks = tuple(_drop_copies(alive))
        free = sweep.unexplained.copy()
        for track in self._tracks:
            free &= ~self._is_near(sweep.points, track.predict(now))
        for group in list_groups(sweep, free):
            self._consider(sweep, group)
        self._sweeps += 1
        if self._sweeps % REST_SEARCH_SWEEPS == 0:
            for track in self._tracks:
                rests &= ~self._is_near(whole.points, track.predict(now))
            for group in list_groups(whole, rests):
                fit, t = self._fit_group(whole, group)
                if fit is not None:
                    self._start(start_resting_track(self._count + 1, t, fit.mean))
        self._candidates = [one for one in self._candidates
                            if now - one.times[-1] < MAX_CANDIDATE_GAP]
        self._learn_resting(all_points, now)
        return self._list_confirmed()

    def list_possible(self, t: float) -> tuple[PossibleCar, ...]:
        """Return what may be a car at t [s] without a confirmed track, where beams last ended on
        it; some points of all that is at rest."""
        tracks = [PossibleCar(track.hit_t, self._centre(track.mean)) for track in self._tracks
                  if not track.confirmed and t - track.hit_t < MAX_CANDIDATE_GAP]
        fitted = [PossibleCar(one.times[-1], one.centres[-1]) for one in self._candidates
                  if len(one.times) >= MIN_POSSIBLE_FITS]
        resting = [one for one in self._at_rest if t - one.t < MAX_CANDIDATE_GAP]
        return (*tracks, *fitted, *resting)

    def _cut(self, sweep: RoomBeams) -> RoomBeams:
        """Return the end of the last sweep with this one up to its own cut.

        The cut is in the middle of the longest run of explained beams near the end.
        """
        if not len(sweep.t):
            return sweep
        begin = round((1.0 - MAX_TAIL_SHARE) * len(sweep.t))
        edges = np.concatenate(([begin - 1], begin + np.flatnonzero(sweep.unexplained[begin:]),
                                [len(sweep.t)]))
        k = int(np.argmax(np.diff(edges)))
        is_head = np.arange(len(sweep.t)) < (edges[k] + edges[k + 1]) // 2 + 1
        tail = self._tail
        self._tail = sweep.select(~is_head)
        head = sweep.select(is_head)
        if tail is None or not len(tail.t) or sweep.t[0] - tail.t[-1] > MAX_TAIL_AGE:
            return head
        return tail.extend(head)

    def _learn_resting(self, points: FloatArray, now: float) -> None:
        """Add unexplained points (n, 2) that are on no confirmed track to those at rest."""
        for track in self._list_confirmed():
            points = points[~self._is_near(points, track.predict(now))]
        self._resting.add(points, now)

    def _list_confirmed(self) -> tuple[CarTrack, ...]:
        """Return the tracks that have moved as one car for some time."""
        return tuple(track for track in self._tracks if track.confirmed)

    def _is_near(self, points: FloatArray, track: CarTrack) -> BoolArray:
        """Return which points (n, 2) are within a body of a track."""
        centre = self._centre(track.mean)
        radius = 0.5 * hypot(self.size.length, self.size.width) + GROUP_MARGIN
        near: BoolArray = np.hypot(*(points - centre).T) < radius
        return near

    def _centre(self, pose: FloatArray) -> FloatArray:
        """Return the centre (2,) [m] of the body of an axle pose."""
        yaw = float(pose[2])
        centre: FloatArray = pose[:2] + self.size.centre_x * np.array((cos(yaw), sin(yaw)))
        return centre

    def _follow(self, track: CarTrack, sweep: RoomBeams) -> CarTrack:
        """Return a track updated with the beams near it, unchanged without any on it."""
        middle = track.predict(float(np.median(sweep.t)))
        window = select_window(sweep, self._centre(middle.mean), self.size)
        if not len(window.t):
            return track
        predicted = track.predict(float(np.median(window.t)))
        if predicted.t <= track.t:
            return track
        spread = np.linalg.cholesky(predicted.cov[:3, :3] + 1e-10 * np.eye(3))
        poses = predicted.mean[:3] + self._normal[:TRACK_POSES] @ spread.T
        fit = fit_rectangle(poses, self.size, window)
        if fit.shadowed:
            return track
        if fit.hits < MIN_HITS or fit.share < MIN_TRACK_SHARE:
            return track.contradict(fit) if fit.due else track
        return predicted.update(fit)

    def _consider(self, sweep: RoomBeams, group: BoolArray) -> None:
        """Fit a rectangle to a group; add it to its candidate, which may become a track."""
        fit, t = self._fit_group(sweep, group)
        if fit is None:
            return
        centre = self._centre(fit.mean)
        near = [one for one in self._candidates if one.times[-1] < t - 0.01
                and np.hypot(*(one.place(t) - centre)) < CANDIDATE_GATE]
        if not near:
            self._candidates.append(_Candidate([t], [centre]))
            return
        candidate = min(near, key=lambda one: float(np.hypot(*(one.place(t) - centre))))
        candidate.add(t, centre)
        if len(candidate.times) < START_FITS:
            return
        place, velocity, deviation = candidate.line()
        speed = float(np.hypot(*velocity))
        if deviation > MAX_START_DEVIATION:
            return
        if START_SPEEDS[0] < speed < START_SPEEDS[1]:
            track = start_track(self._count + 1, t, place, velocity, self.size.centre_x)
        elif speed < MAX_REST_SPEED and len(candidate.times) >= REST_FITS:
            track = start_resting_track(self._count + 1, t, fit.mean)
        else:
            return
        self._start(track)
        self._candidates.remove(candidate)

    def _start(self, track: CarTrack) -> None:
        """Add a track, unless there is one at its place."""
        if not any(np.hypot(*(one.predict(track.t).mean[:2] - track.mean[:2]))
                   < MIN_TRACK_DISTANCE for one in self._tracks):
            self._count += 1
            self._tracks = (*self._tracks, track)

    def _fit_group(self, sweep: RoomBeams, group: BoolArray) -> tuple[RectangleFit | None, float]:
        """Return the fit of a group, None if it is no car, and its time [s]."""
        points = sweep.points[group]
        diagonal = hypot(self.size.length, self.size.width)
        extent = float(np.hypot(*np.ptp(points, axis=0)))
        middle = points.mean(axis=0)
        window = select_window(sweep, middle, self.size)
        if extent > diagonal + GROUP_MARGIN or not len(window.t):
            return None, 0.0
        # First round: centres behind the visible points, all headings.
        count, refined = GROUP_POSES
        away = sweep.direction[group].mean(axis=0)
        yaw = np.linspace(0.0, pi, count, endpoint=False)
        centre = middle + 0.5 * self.size.width * away + 0.08 * self._normal[:count, :2]
        poses = np.column_stack((centre[:, 0] - self.size.centre_x * np.cos(yaw),
                                 centre[:, 1] - self.size.centre_x * np.sin(yaw), yaw))
        best = min((fit_rectangle(part, self.size, window)
                    for part in np.array_split(poses, 6)), key=lambda fit: (-fit.share, -fit.hits))
        # Second round: around the best.
        poses = best.mean + self._normal[:refined] * REFINED_STDS
        fit = fit_rectangle(poses, self.size, window)
        good = fit.hits >= MIN_HITS and fit.share >= MIN_START_SHARE and not fit.shadowed
        return (fit if good else None), float(np.median(window.t))


def list_groups(sweep: RoomBeams, free: BoolArray) -> list[BoolArray]:
    """Return groups of neighbouring beams of a mask ``free`` (n,), as masks (n,)."""
    rows = np.flatnonzero(free)
    if not len(rows):
        return []
    points = sweep.points[rows]
    gap = np.hypot(*np.diff(points, axis=0).T)
    cuts = np.flatnonzero((np.diff(rows) > MAX_BEAM_GAP) | (gap > MAX_POINT_GAP)) + 1
    groups = []
    for part in np.split(rows, cuts):
        if len(part) >= MIN_GROUP_BEAMS:
            mask = np.zeros(len(free), bool)
            mask[part] = True
            groups.append(mask)
    return groups


def _list_resting(sweep: RoomBeams, rests: BoolArray) -> tuple[PossibleCar, ...]:
    """Return points of the groups at rest, with at least ``REST_SPACING`` between them."""
    kept: list[PossibleCar] = []
    for group in list_groups(sweep, rests):
        for t, point in zip(sweep.t[group], sweep.points[group], strict=True):
            if all(hypot(*(point - one.centre)) > REST_SPACING for one in kept):
                kept.append(PossibleCar(float(t), point))
    return tuple(kept)


def _drop_copies(tracks: list[CarTrack]) -> list[CarTrack]:
    """Return the tracks without younger ones at the place of an older one."""
    kept: list[CarTrack] = []
    for track in tracks:
        if not any(np.hypot(*(one.predict(track.t).mean[:2] - track.mean[:2]))
                   < MIN_TRACK_DISTANCE for one in kept):
            kept.append(track)
    return kept
