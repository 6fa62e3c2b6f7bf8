"""Maps and poses where the lidar's noise grows with distance, with people who walk.

    python -m studies.mapping.range_noise --first 9300 --seeds 2

Three halls: an oval of 11 x 7 m with a block, an L of 10 x 8 m with pillars, and 12 x 6 m with a
dividing wall. One car drives each of them for 45 s at 1 m/s, its recording becomes a map, and a
second car is localised on this map. Rows: noise that is constant, and 1 cm + 1 % of the distance.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.car.lidar import list_map_errors
from dart_hal.core.types import FloatArray, Mount, Scan
from dart_hal.estimation.localisation.field import map_of_grid, map_of_lines
from dart_hal.estimation.localisation.localiser import Localiser
from dart_hal.estimation.localisation.rays import LineIndex, fastest_cast
from dart_hal.estimation.mapping.occupancy import grid_of
from dart_lab.sim.lidar.maps import RoomMap, box, polyline
from studies.localisation.figures import rms
from studies.localisation.world import DT, Drive, Hidden, drive_along, hidden
from studies.mapping.figures import written
from studies.mapping.world import Placed, placed_on

# s of a drive.
SECONDS = 45.0
# m: a pose with a larger error is wrong.
WRONG_POSE = 0.2
# m from the middle of a person to each leg, and radius of a leg.
LEG_OFFSET = 0.12
LEG_RADIUS = 0.06
# m/s and number of people who walk.
WALKING_SPEED = 0.8
WALKERS = 2
NO_GLASS = np.empty((0, 4))


@dataclass(frozen=True)
class Hall:
    """A hall: its lines (m, 4) [m], and points (n, 2) [m] of a closed path through it."""

    lines: FloatArray
    path: FloatArray


def make_oval() -> Hall:
    """Make an oval hall of 11 x 7 m with a block in its middle."""
    turn = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    wall = np.column_stack((5.5 + 5.5 * np.cos(turn), 3.5 + 3.5 * np.sin(turn)))
    lines = np.vstack((polyline(wall, closed=True), box(5.5, 3.5, 0.2, 2.4, 1.0)))
    path = np.column_stack((5.5 + 3.3 * np.cos(turn), 3.5 + 1.9 * np.sin(turn)))
    return Hall(lines, path)


def make_corner() -> Hall:
    """Make an L of 10 x 8 m with three pillars."""
    corners = np.array(((0.0, 0.0), (10.0, 0.0), (10.0, 4.0), (5.0, 4.5), (5.0, 8.0), (0.0, 8.0)))
    pillars = [box(x, y, a, 0.4, 0.4) for x, y, a in ((2.5, 4.6, 0.3), (4.9, 2.1, 0.0),
                                                      (7.6, 2.0, 0.5))]
    lines = np.vstack((polyline(corners, closed=True), *pillars))
    path = np.array(((1.2, 1.2), (4.9, 1.0), (8.8, 1.2), (8.8, 2.9), (6.2, 3.1), (4.0, 3.4),
                     (3.8, 6.8), (1.2, 6.8), (1.2, 4.0)))
    return Hall(lines, path)


def make_divided() -> Hall:
    """Make a hall of 12 x 6 m with a dividing wall and cabinets."""
    lines = np.vstack((box(6.0, 3.0, 0.0, 12.0, 6.0), polyline(np.array(((3.0, 3.0), (9.0, 3.2)))),
                       box(0.2, 3.0, 0.0, 0.4, 1.2), box(11.8, 2.0, 0.0, 0.4, 0.8),
                       box(5.0, 5.8, 0.0, 1.0, 0.4), box(8.0, 0.2, 0.0, 1.4, 0.4)))
    path = np.array(((1.6, 1.5), (6.0, 1.6), (10.3, 1.5), (10.6, 3.1), (10.3, 4.5), (6.0, 4.6),
                     (1.6, 4.5), (1.4, 3.0)))
    return Hall(lines, path)


HALLS: dict[str, Callable[[], Hall]] = {"oval": make_oval, "corner": make_corner,
                                        "divided": make_divided}


def smooth_path(points: FloatArray, speed: float, seconds: float, *, backwards: bool
                ) -> FloatArray:
    """Return x, y [m], course [rad], curvature [1/m] (n, 4) every DT along a closed path."""
    from scipy.interpolate import CubicSpline

    closed = np.vstack((points, points[:1]))[::-1 if backwards else 1]
    chord = np.concatenate(((0.0,), np.cumsum(np.hypot(*np.diff(closed, axis=0).T))))
    spline = CubicSpline(chord, closed, bc_type="periodic")
    u = np.linspace(0.0, chord[-1], 4000)
    length = np.concatenate(((0.0,), np.cumsum(np.hypot(*np.diff(spline(u), axis=0).T))))
    distance = speed * DT * np.arange(int(seconds / DT) + 2)
    at = np.interp(np.mod(distance, length[-1]), length, u)
    dx, dy = spline(at, 1).T
    ddx, ddy = spline(at, 2).T
    course = np.unwrap(np.arctan2(dy, dx))
    curvature = (dx * ddy - dy * ddx) / np.hypot(dx, dy)**3
    return np.column_stack((spline(at), course, curvature))


def make_drive(name: str, seed: int, share: float, noise: float, *, backwards: bool) -> Drive:
    """Drive a hall with a hidden car and people; noise [m] + share of the distance."""
    hall = HALLS[name]()
    rng = np.random.default_rng([seed, 21, backwards])
    hid = hidden(seed, late=0.012, noise=noise, noise_share=share, stale=0.0, other=False,
                 seconds=SECONDS)
    way = smooth_path(hall.path, hid.speed, SECONDS, backwards=backwards)
    room = RoomMap(name, hall.lines, NO_GLASS, tuple(way[0, :3].tolist()))
    drive = drive_along(room, way, hid, rng, seed)
    return replace(drive, scans=list(scan_with_walkers(drive, hall, hid, rng)))


def scan_with_walkers(drive: Drive, hall: Hall, hid: Hidden, rng: np.random.Generator):
    """Yield the scans of a drive with people who walk to and fro."""
    beams = round(5000.0 / hid.rate)
    turn = np.arange(beams) * (2.0 * np.pi / beams)
    walls = LineIndex(hall.lines)
    low = hall.lines.reshape(-1, 2).min(axis=0)
    high = hall.lines.reshape(-1, 2).max(axis=0)
    ends = rng.uniform(low + 0.5, high - 0.5, (WALKERS, 2, 2))
    first = drive.t[0] + 0.05
    while first + beams * 2e-4 + 0.02 < drive.t[-1]:
        when = first + 2e-4 * np.arange(beams)
        first = when[-1] + 2e-4
        x, y, yaw = (np.interp(when, drive.t, column) for column in drive.truth.T)
        ahead = yaw - turn
        origin = np.column_stack((x + 0.13 * np.cos(yaw), y + 0.13 * np.sin(yaw)))
        direction = np.column_stack((np.cos(ahead), np.sin(ahead)))
        r = walls.cast(origin, direction)
        legs = [leg for a, b in ends for leg in legs_of_walker(a, b, float(when[-1]), origin[-1])]
        if legs:
            r = np.minimum(r, fastest_cast()(np.vstack(legs), origin, direction))
        r[(r > 10.0) | (r < 0.12)] = np.nan
        r = r + rng.normal(size=beams) * (hid.noise + hid.noise_share * r)
        r[rng.uniform(size=beams) < hid.dropout] = np.nan
        stamps = when + hid.late
        yield Scan(float(stamps[-1]) + 0.01, float(stamps[0]), hid.rate, stamps - stamps[0], turn,
                   r, 0.0, Mount(x=0.13))


def legs_of_walker(a: FloatArray, b: FloatArray, t: float, car: FloatArray) -> list[FloatArray]:
    """Return the outlines of both legs at t [s], between a and b (2,) [m]; none at the car."""
    length = float(np.hypot(*(b - a)))
    phase = np.mod(WALKING_SPEED * t / length, 2.0)
    place = a + (b - a) * min(phase, 2.0 - phase)
    if np.hypot(*(place - car)) < 0.6:
        return []
    side = np.array((a[1] - b[1], b[0] - a[0])) / length
    stride = 0.2 * np.sin(6.0 * t) * (b - a) / length
    middles = place + LEG_OFFSET * side + stride, place - LEG_OFFSET * side - stride
    return [box(*middle.tolist(), 0.0, 2.0 * LEG_RADIUS, 2.0 * LEG_RADIUS) for middle in middles]


def localise(chart, drive: Drive, placed: Placed) -> FloatArray:
    """Return distance [m], yaw error [rad] and NEES (n, 3) of a drive on a placed map."""
    x, y, yaw = drive.true(float(drive.scans[0].t[-1]) - 0.012)
    start = placed.survey(np.array([[x, y]]))[0]
    localiser = Localiser(chart, (*start.tolist(), yaw - placed.by.turn))
    by_map = np.diag(np.square(list_map_errors(chart.std)))
    rows = []
    k = 0
    for scan in drive.scans:
        while k < len(drive.t) and drive.t[k] <= scan.arrival:
            drive.tell(localiser, k)
            k += 1
        result = localiser.add(scan)
        if result is None or result.pose is None:
            continue
        true = drive.true(result.t)
        here = np.append(placed.survey(true[None, :2])[0], true[2] - placed.by.turn)
        off = np.array((result.pose.x, result.pose.y, result.pose.yaw)) - here
        off[2] = (off[2] + np.pi) % (2.0 * np.pi) - np.pi
        rows.append((np.hypot(off[0], off[1]), off[2],
                     off @ np.linalg.solve(result.pose.cov + by_map, off) / 3.0))
    return np.array(rows).reshape(-1, 3)


def report(name: str, first: int, seeds: int, noise: float, share: float) -> None:
    """Print one row: path of the map drive, second car on the map and on exact walls."""
    paths, own, exact, delays = [], [], [], []
    for seed in range(first, first + seeds):
        drive = make_drive(name, seed, share, noise, backwards=False)
        second = make_drive(name, seed + 500, share, noise, backwards=True)
        mapper, survey = mapped_with(drive)
        placed = placed_on(survey, drive, 0.012)
        paths.append(placed.off)
        delays.append(mapper.belief.mean[7])
        own.append(localise(map_of_grid(written(grid_of(survey))), second, placed))
        identity = replace(placed, by=replace(placed.by, turn=0.0, shift=np.zeros(2)))
        exact.append(localise(map_of_lines(drive.lines), second, identity))
    parts = [f"{name:8s} {100 * noise:.1f} cm + {100 * share:.1f} %: path "
             f"{100 * rms(np.concatenate(paths)):.2f} (worst "
             f"{100 * max(rms(p) for p in paths):.2f}) max "
             f"{100 * max(p.max() for p in paths):.1f} cm, delay "
             + " ".join(f"{1e3 * d:.1f}" for d in delays) + " ms"]
    for title, tables in (("on it", own), ("on exact walls", exact)):
        table = np.concatenate(tables)
        parts.append(f"{title} n {len(table)} {100 * rms(table[:, 0]):.2f} (worst "
                     f"{100 * max(rms(t[:, 0]) for t in tables):.2f}) max "
                     f"{100 * table[:, 0].max():.1f} cm, yaw {np.degrees(rms(table[:, 1])):.2f} "
                     f"deg, NEES {table[:, 2].mean():.2f}, wrong "
                     f"{(table[:, 0] > WRONG_POSE).sum()}")
    print("; ".join(parts), flush=True)


def mapped_with(drive: Drive):
    """Return the mapper and the survey of a drive."""
    from dart_hal.estimation.mapping.mapper import Mapper

    mapper = Mapper()
    k = 0
    for scan in drive.scans:
        while k < len(drive.t) and drive.t[k] <= scan.arrival:
            mapper.update_odometry(float(drive.t[k]), *drive.told[k].tolist())
            k += 1
        mapper.add(scan)
    return mapper, mapper.finish()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("halls", nargs="*", metavar="|".join(HALLS))
    parser.add_argument("--first", type=int, default=9000)
    parser.add_argument("--seeds", type=int, default=2)
    options = parser.parse_args()
    for name in options.halls or HALLS:
        for noise, share in ((0.015, 0.0), (0.01, 0.01)):
            report(name, options.first, options.seeds, noise, share)


if __name__ == "__main__":
    main()
