"""A follower behind a slower car that it detects in its own scans, on the light simulation.

    python -m studies.control.overtaking --seeds 6 --first 1 [--tracker mpcc ca-mpcc] [--blind]
        [--person --share 0]

An oval of 16.8 m in a room with inner boxes; the other car wanders up to 8 cm off the path, at
speeds around a share of the 1 m/s of the own car. The lidar has 8.25 revolutions per second, 1.5 cm
of noise and 3 % drop-outs. Tracks come from ``LidarPoses``; the controller knows its pose exactly.

contacts: drives in which the true outlines overlap; overtakes: drives in which the car comes past;
behind: drives in which it does not; lane left: drives with the rear axle outside the lane; headway:
smallest gap between the bodies over the own speed while behind at more than 0.3 m/s. --blind: the
negative control, without tracks. --person: a person at rest instead. Some 10 s a drive.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from math import cos, inf, pi, sin
from types import SimpleNamespace

import numpy as np

from dart_hal.car.others import Others
from dart_hal.control.follow import Follower, Phase, Rules
from dart_hal.control.paths import Path
from dart_hal.control.trackers import contouring, curvature_aware
from dart_hal.core.types import FloatArray, MotionEstimate, Mount, Scan
from dart_hal.estimation.localisation.field import map_of_lines
from dart_hal.estimation.localisation.rays import LineIndex, fastest_cast
from dart_hal.estimation.localisation.source import LidarPoses
from dart_hal.estimation.other_cars.rectangle import CarSize
from dart_lab.sim.lidar.maps import box
from dart_lab.sim.light.world import CAR_OUTLINE, corners, overlaps
from studies.control.light_follow import LATER, light_drive, plant_by

RADIUS = 1.4
STRAIGHT = 4.0
OVAL = Path([(STRAIGHT, 0.0), (pi * RADIUS, 1.0 / RADIUS)] * 2, closed=True)
BEAMS = 606
SAMPLE_PERIOD = 2e-4
MOUNT_X = 0.13
NOISE = 0.015
DROPOUT = 0.03
OWN_SPEED = 1.0
LANES = {"wide": 0.55, "narrow": 0.3}
SHARES = (0.0, 0.3, 0.6)
LEG = 0.1
MAKERS = {"mpcc": contouring, "ca-mpcc": curvature_aware}
SIZE = CarSize(CAR_OUTLINE.length, CAR_OUTLINE.width, CAR_OUTLINE.ahead)


def make_walls() -> FloatArray:
    """Lines (m, 4) of the room about the oval, no two views of which are the same."""
    outer = box(0.5 * STRAIGHT, RADIUS, 0.0, STRAIGHT + 2.0 * RADIUS + 2.0, 2.0 * RADIUS + 2.0)
    return np.vstack((outer, box(0.6, RADIUS, 0.3, 0.8, 0.5), box(3.2, 1.6, 1.0, 0.5, 0.4),
                      box(2.0, -0.85, 0.2, 0.3, 0.2), box(5.9, 3.4, 0.8, 0.5, 0.3)))


WALLS = make_walls()


@dataclass(frozen=True)
class Encounter:
    """rows (n, 5): t [s], distance along the path to the other car [m], own speed [m/s], offset
    [m], overlap of the bodies (0 or 1)."""

    follower: Follower
    rows: FloatArray
    lane: float

    @property
    def touched(self) -> bool:
        return bool(self.rows[:, 4].any())

    @property
    def passed(self) -> bool:
        return bool((self.rows[:, 1] < -2.0 * SIZE.length).any())

    @property
    def lane_left(self) -> bool:
        return bool((np.abs(self.rows[:, 3]) > self.lane).any())

    @property
    def headway(self) -> float:
        """Smallest gap over the speed of a drive without overtaking [s], inf with one."""
        gap = self.rows[:, 1] - SIZE.length
        behind = (self.rows[:, 2] > 0.3) & (not self.passed)
        return float(np.min(gap[behind] / self.rows[behind, 2], initial=inf))


class LidarWorld:
    """Own car, other car and room: call it with each State of ``light_drive``."""

    def __init__(self, seed: int, share: float, others: Others) -> None:
        self._rng = np.random.default_rng([seed, 41])
        self._speed = share * OWN_SPEED
        self._start, self._phase, self._side = self._rng.uniform((2.5, 0.0, -0.04),
                                                                 (5.0, 6.3, 0.04))
        self._scale = 1.0 + float(self._rng.uniform(-0.02, 0.02))
        self._others = others
        self._walls = LineIndex(WALLS)
        self._cast = fastest_cast()
        self._poses: list[tuple[float, float, float, float]] = []
        self._next = 0.05
        self.rows: list[tuple[float, ...]] = []

    def other(self, t: float) -> tuple[float, float, float, float]:
        """Return x, y, yaw of the rear axle of the other car, and its arc length."""
        wave = 0.2 * self._speed / 0.8 * (cos(self._phase) - cos(self._phase + 0.8 * t))
        s = self._start + self._speed * t + wave
        spot = OVAL.interpolate(s)
        side = self._side + 0.04 * sin(self._phase + 1.2 * s)
        slope = 0.04 * 1.2 * cos(self._phase + 1.2 * s)
        return (spot.x - side * sin(spot.heading), spot.y + side * cos(spot.heading),
                spot.heading + slope, s)

    def __call__(self, t: float, follower: Follower, motion: MotionEstimate) -> MotionEstimate:
        pose = motion.pose
        self._poses.append((t, pose.x, pose.y, pose.yaw))
        if self._others.lidar is not None:
            self._others.lidar.add_states([SimpleNamespace(
                t=t, pose=SimpleNamespace(x=self._scale * pose.x, y=self._scale * pose.y,
                                          yaw=pose.yaw), accel_x=None)])
            if t >= self._next + BEAMS * SAMPLE_PERIOD + 0.01:
                self._others.lidar.add(self.scan(self._next))
                self._next += BEAMS * SAMPLE_PERIOD
        self._others.update(motion)
        x, y, yaw, s = self.other(t)
        outlines = corners(np.array(((pose.x, pose.y, pose.yaw), (x, y, yaw))), CAR_OUTLINE)
        tracker = follower.tracker
        self.rows.append((t, s - tracker.s, motion.speed, tracker.offset,
                          float(overlaps(outlines)[0, 1])))
        return motion

    def body(self, t: float) -> FloatArray:
        """Return the lines (m, 4) that the lidar detects of the other car."""
        x, y, yaw, _ = self.other(t)
        return box(x + SIZE.centre_x * cos(yaw), y + SIZE.centre_x * sin(yaw), yaw,
                   SIZE.length, SIZE.width)

    def scan(self, first: float) -> Scan:
        """Return the revolution that begins at ``first`` [s]."""
        when = first + SAMPLE_PERIOD * np.arange(BEAMS)
        t, x, y, yaw = np.array(self._poses[-40:]).T
        x, y, yaw = (np.interp(when, t, v) for v in (x, y, np.unwrap(yaw)))
        turn = 2.0 * pi / BEAMS * np.arange(BEAMS)
        ahead = yaw - turn
        origin = np.column_stack((x + MOUNT_X * np.cos(yaw), y + MOUNT_X * np.sin(yaw)))
        beam = np.column_stack((np.cos(ahead), np.sin(ahead)))
        r = self._walls.cast(origin, beam)
        for k in range(0, BEAMS, 20):
            part = slice(k, k + 20)
            body = self.body(float(when[k]))
            r[part] = np.minimum(r[part], self._cast(body, origin[part], beam[part]))
        r[(r > 10.0) | (r < 0.12)] = np.nan
        r = r + NOISE * self._rng.normal(size=BEAMS)
        r[self._rng.uniform(size=BEAMS) < DROPOUT] = np.nan
        return Scan(float(when[-1]) + 0.01, first, 8.25, when - first, turn, r, 0.0,
                    Mount(x=MOUNT_X))


class PersonAtRest(LidarWorld):
    """The same with two legs at the place of the other car's rear axle."""

    def body(self, t: float) -> FloatArray:
        x, y, yaw, _ = self.other(t)
        return np.vstack([box(x - side * sin(yaw), y + side * cos(yaw), yaw, LEG, LEG)
                          for side in (-LEG, LEG)])


def meet(seed: int, share: float, lane: float, tracker: str, *, blind: bool = False,
         seconds: float = 25.0, make_world: type[LidarWorld] = LidarWorld) -> Encounter:
    """Drive behind a car of ``share`` of the own speed, in a lane [m]."""
    def make(path, plant):
        return MAKERS[tracker](path, plant, lane=lane)

    follower = Follower(OVAL, plant_by(LATER), OWN_SPEED, make, Rules(laps=9, lane=lane))
    lidar = None
    if not blind:
        start = float(OVAL.x[0]), float(OVAL.y[0]), float(OVAL.heading[0])
        lidar = LidarPoses(map_of_lines(WALLS), start)
        lidar.track_cars(SIZE)
    world = make_world(seed, share, Others(None, follower, lidar))
    light_drive(follower, each=world, seconds=seconds)
    follower.phase = Phase.ENDED
    return Encounter(follower, np.array(world.rows), lane)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--tracker", nargs="*", choices=list(MAKERS), default=list(MAKERS))
    parser.add_argument("--lane", nargs="*", choices=list(LANES), default=list(LANES))
    parser.add_argument("--share", nargs="*", type=float, default=list(SHARES))
    parser.add_argument("--blind", action="store_true")
    parser.add_argument("--person", action="store_true")
    given = parser.parse_args()
    for tracker in given.tracker:
        for lane in given.lane:
            for share in given.share:
                drives = [meet(seed, share, LANES[lane], tracker, blind=given.blind,
                               make_world=PersonAtRest if given.person else LidarWorld)
                          for seed in range(given.first, given.first + given.seeds)]
                passed = sum(d.passed for d in drives)
                headway = min(d.headway for d in drives)
                whys = {d.follower.why for d in drives if d.follower.why}
                print(f"{tracker}, {lane} lane, other car at {share:g}: {len(drives)} drives, "
                      f"contacts {sum(d.touched for d in drives)}, overtakes {passed}, behind "
                      f"{len(drives) - passed}, lane left {sum(d.lane_left for d in drives)}, "
                      f"headway {headway:.2f} s; {whys or ''}", flush=True)


if __name__ == "__main__":
    main()
