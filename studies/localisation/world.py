"""Hidden drives in random rooms: what a car's State and lidar would say, without the car.

Rooms are those of the simulator (6 x 5 m, inner walls, boxes, a metre of glass). The car wanders
where there is space; its body turns in by the slip of the rear axle. Wheels, gyro and stamps get
wrong what no localiser is told, another car drives about, and boxes stand that no map shows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite

import numpy as np

from dart_hal.car.lidar import list_map_errors
from dart_hal.core.types import FloatArray, Mount, Scan
from dart_hal.estimation.localisation.field import Map, map_of_lines
from dart_hal.estimation.localisation.grid import Grid
from dart_hal.estimation.localisation.localiser import Localiser, Located
from dart_hal.estimation.localisation.rays import LineIndex, fastest_cast
from dart_lab.sim.lidar.maps import RoomMap, box, clearance, room_of

DT = 0.01
CAR = (0.4, 0.2)


@dataclass(frozen=True)
class Hidden:
    """speed [m/s]; travel, gyro: relative; bias [rad/s]; late [s] of stamps; slip [rad per m/s2];
    noise [m] + noise_share of the distance; stale: share of the walls' length that is new, gone:
    boxes of the map that are not there any more, of four; scale of distances; gap [s] of the lidar
    every 10 s; spin: share by which a wheel is too quick for 0.4 s every 10 s."""

    speed: float = 1.0
    seconds: float = 60.0
    travel: float = 0.0
    gyro: float = 0.0
    bias: float = 0.0
    late: float = 0.010
    slip: float = 0.02
    noise: float = 0.015
    noise_share: float = 0.0
    dropout: float = 0.03
    stale: float = 0.07
    gone: int = 0
    other: bool = True
    scale: float = 1.0
    gap: float = 0.0
    spin: float = 0.0
    rate: float = 8.25
    sense: float = 1.0


def hidden(seed: int, **fixed: float) -> Hidden:
    """Travel +-3 %, gyro +-0.01 rad/s and +-2 %, from the seed."""
    travel, gyro, bias = np.random.default_rng([seed, 7]).uniform(-1.0, 1.0, 3).tolist()
    return replace(Hidden(travel=0.03 * travel, gyro=0.02 * gyro, bias=0.01 * bias), **fixed)


@dataclass(frozen=True)
class Drive:
    """truth (n, 3) at t (n,); told (n, 3), accel (n,): dead reckoning and acceleration (NaN: none);
    scans with the times that they tell; lines: what stands there, in the map or not."""

    chart: Map
    room: RoomMap
    t: FloatArray
    truth: FloatArray
    told: FloatArray
    scans: list[Scan]
    accel: FloatArray
    lines: FloatArray

    def tell(self, local: Localiser, k: int) -> None:
        """What the State k says."""
        accel = float(self.accel[k])
        local.update_odometry(float(self.t[k]), *self.told[k].tolist(),
                              accel if isfinite(accel) else None)

    def true(self, t: float) -> FloatArray:
        return np.array([np.interp(t, self.t, column) for column in self.truth.T])


def wander(room: RoomMap, speed: float, seconds: float, rng: np.random.Generator) -> FloatArray:
    """x, y, course, bend (n, 4) every DT, nowhere nearer than 0.15 m to a wall or the glass."""
    chart = map_of_lines(np.vstack((room.lines, room.glass)), 0.05)
    for _ in range(200):
        start = tuple(rng.uniform((0.6, 0.6, -np.pi), (5.4, 4.4, np.pi)).tolist())
        way = _wander(chart, start, speed, seconds, rng)
        if way is not None:
            return way
    raise AssertionError(f"no way at {speed} m/s")


def _wander(chart: Map, start: tuple[float, float, float], speed: float, seconds: float,
            rng: np.random.Generator) -> FloatArray | None:
    """The bend of least trouble over the next 1.4 m, anew every 5 cm or 50 ms; None: a crash."""
    most, rate = 2.0, 10.0 * DT
    bends = np.linspace(-most, most, 17)
    x, y, course = start
    bend, wish, out = 0.0, 0.0, []
    way = 0.07 * np.arange(1, 21)
    while len(out) < seconds / DT + 2:
        if rng.uniform() < 0.05:
            wish = float(rng.uniform(-most, most))
        turned = course + bends[:, None] * way
        px = x + 0.07 * np.cumsum(np.cos(turned), axis=1)
        py = y + 0.07 * np.cumsum(np.sin(turned), axis=1)
        d = chart.look(px.ravel(), py.ravel())[0].reshape(px.shape)
        if d[:, 0].min() < 0.15:
            return None
        crashed = np.cumsum(d < 0.2, axis=1) > 0
        trouble = 20.0 * crashed.sum(axis=1) + 15.0 * (np.maximum(0.4 - d, 0.0)**2).sum(axis=1)
        chosen = float(bends[np.argmin(trouble + 0.2 * (bends - wish)**2
                                       + 0.05 * (bends - bend)**2)])
        for _ in range(5):
            bend += float(np.clip(chosen - bend, -rate, rate))
            x, y = x + speed * DT * np.cos(course), y + speed * DT * np.sin(course)
            out.append((x, y, course, bend))
            course += bend * speed * DT
    return np.array(out)


def drive(seed: int, hid: Hidden) -> Drive:
    """About the room of a seed."""
    rng = np.random.default_rng([seed, 8])
    room = room_of("room", seed)
    return drive_along(room, wander(room, hid.speed, hid.seconds, rng), hid, rng, seed)


def drive_along(room: RoomMap, way: FloatArray, hid: Hidden, rng: np.random.Generator,
                seed: int) -> Drive:
    """Along a way as that of ``wander``, from rest; seed: of the accelerometer."""
    n = len(way)
    t = 1.0 + DT * np.arange(n)
    speed = np.minimum(hid.speed, 2.0 * (t - t[0]))
    way = _resampled(way, np.concatenate(((0.0,), np.cumsum(speed[1:] * DT))) / (hid.speed * DT))
    lateral = speed**2 * way[:, 3]
    truth = np.column_stack((way[:, :2], way[:, 2] + hid.slip * lateral))
    told = _told(t, truth, np.cos(hid.slip * lateral), hid, rng)
    there = room.lines[:len(room.lines) - 4 * hid.gone]
    lines = np.vstack((there, _stale(room, way, hid, rng)))
    return Drive(map_of_lines(room.lines), room, t, truth, told,
                 list(_scans(lines, room.glass, t, truth, hid, rng, n)),
                 _felt(speed, truth[:, 2], seed), lines)


def _felt(speed: FloatArray, yaw: FloatArray, seed: int) -> FloatArray:
    """Acceleration [m/s2] of a BNO055 up to 0.1 m before or behind the axle: noise, and a bias
    that its tilt on the floor makes."""
    rng = np.random.default_rng([seed, 10])
    true = np.gradient(speed, DT)
    felt = true + rng.uniform(-0.1, 0.1) + 0.1 * rng.normal(size=len(speed))
    swing: FloatArray = rng.uniform(-0.1, 0.1) * (np.gradient(yaw) / DT)**2
    return felt - swing


def _resampled(way: FloatArray, at: FloatArray) -> FloatArray:
    """Rows of a way at fractional indices: the car starts from rest, with 2 m/s2."""
    index = np.arange(len(way))
    return np.column_stack([np.interp(at, index, column) for column in way.T])


def _told(t: FloatArray, truth: FloatArray, ahead: FloatArray, hid: Hidden,
          rng: np.random.Generator) -> FloatArray:
    """Dead reckoning from wheels and gyro: what goes ``ahead``, along the nose, is seen."""
    step = np.hypot(*np.diff(truth[:, :2], axis=0).T) * ahead[1:]
    turn = np.diff(truth[:, 2])
    spins = (np.mod(t[1:], 10.0) > 5.0) & (np.mod(t[1:], 10.0) < 5.4)
    step = step * (1.0 + hid.spin * spins) / (1.0 + hid.travel)
    step += 0.003 * np.sqrt(step) * rng.normal(size=len(step))
    turn = turn / (1.0 + hid.gyro) + DT * hid.bias + 4e-4 * np.sqrt(DT) * rng.normal(size=len(turn))
    yaw = np.concatenate(((0.0,), np.cumsum(turn)))
    middle = yaw[:-1] + 0.5 * turn
    x, y = np.cumsum(step * np.cos(middle)), np.cumsum(step * np.sin(middle))
    return np.column_stack((np.append(0.0, x), np.append(0.0, y), yaw))


def _stale(room: RoomMap, way: FloatArray, hid: Hidden, rng: np.random.Generator) -> FloatArray:
    """Boxes beside the way until they are ``stale`` of the walls."""
    length = np.hypot(*(room.lines[:, 2:] - room.lines[:, :2]).T).sum()
    boxes, tries = np.empty((0, 4)), 0
    while np.hypot(*(boxes[:, 2:] - boxes[:, :2]).T).sum() < hid.stale * length and tries < 400:
        tries += 1
        x, y, yaw = rng.uniform((0.3, 0.3, 0.0), (5.7, 4.7, np.pi))
        a, b = rng.uniform(0.2, 0.5, 2)
        if np.hypot(*(way[:, :2] - (x, y)).T).min() > 0.5 * np.hypot(a, b) + 0.2 \
                and clearance(room.lines, x, y) > 0.2:
            boxes = np.vstack((boxes, box(x, y, yaw, a, b)))
    return boxes


def _scans(lines, glass, t, truth, hid, rng, n):
    """Whole revolutions; the other car drives a circle about the middle of the room."""
    beams = round(5000.0 / hid.rate)
    turn = np.arange(beams) * (2.0 * np.pi / beams)
    cast, mount = fastest_cast(), Mount(x=0.13)
    there, panes = LineIndex(lines), LineIndex(glass)
    first = t[0] + 0.05
    while first + beams * 2e-4 + 0.02 < t[-1]:
        when = first + 2e-4 * np.arange(beams)
        first = when[-1] + 2e-4
        if hid.gap and np.mod(when[-1], 10.0) < hid.gap:
            continue
        x, y, yaw = (np.interp(when, t, column) for column in truth.T)
        ahead = yaw - hid.sense * turn
        origin = np.column_stack((x + 0.13 * np.cos(yaw), y + 0.13 * np.sin(yaw)))
        way = np.column_stack((np.cos(ahead), np.sin(ahead)))
        r = there.cast(origin, way)
        if hid.other:
            phase = 0.8 * when[-1] * hid.speed
            cx, cy = 3.0 + 1.3 * np.cos(phase), 2.5 + 1.0 * np.sin(phase)
            if np.hypot(cx - x[-1], cy - y[-1]) > 0.45:
                r = np.minimum(r, cast(box(cx, cy, phase + 1.57, *CAR), origin, way))
        r[panes.cast(origin, way) < r] = np.nan
        r[(r > 10.0) | (r < 0.12)] = np.nan
        r = (r + rng.normal(size=beams) * (hid.noise + hid.noise_share * r)) / hid.scale
        r[rng.uniform(size=beams) < hid.dropout] = np.nan
        told = when + hid.late
        yield Scan(float(told[-1]) + 0.01, float(told[0]), hid.rate, told - told[0], turn, r,
                   0.0, mount)


@dataclass(frozen=True)
class Result:
    """Errors at each pose told: way [m] and yaw [rad] (m,), nees (m,) of three; status of every
    scan; agreement."""

    t: FloatArray
    off: FloatArray
    yaw: FloatArray
    nees: FloatArray
    told: list[Located | None]
    localiser: Localiser


def draw_in_cells(lines: FloatArray, cell: float, rng: np.random.Generator) -> Grid:
    """Return a grid whose cells [m] are occupied where lines (m, 4) [m] pass.

    Its origin is at any place of a cell.
    """
    ends = lines.reshape(-1, 2)
    low = ends.min(axis=0) - 0.2 - rng.uniform(0.0, cell, 2)
    columns, rows = np.ceil((ends.max(axis=0) + 0.2 - low) / cell).astype(int)
    occupied = np.zeros((rows, columns), bool)
    for line in lines:
        steps = int(np.hypot(*(line[2:] - line[:2])) / (0.2 * cell)) + 2
        column, row = ((np.linspace(line[:2], line[2:], steps) - low) / cell).astype(int).T
        occupied[row, column] = True
    return Grid(occupied, ~occupied, cell, low)


def run(found: Drive, *, known: bool = True, deskew: bool = True, late: float = 0.010,
        localiser: Localiser | None = None, until_lost: bool = False) -> Result:
    """Let a localiser follow a drive; poses are compared at their own times.

    The covariance contains the errors of the map.
    """
    start = tuple(found.true(float(found.scans[0].t[-1]) - late).tolist())
    local = localiser or Localiser(found.chart, start if known else None, deskew=deskew)
    by_map = np.diag(np.square(list_map_errors(local.chart.std)))
    rows, told, k = [], [], 0
    for scan in found.scans:
        while k < len(found.t) and found.t[k] <= scan.arrival:
            found.tell(local, k)
            k += 1
        told.append(seen := local.add(scan))
        if seen is None or seen.pose is None:
            if until_lost and local.belief is None:
                break
            continue
        true = found.true(seen.t)
        off = np.array((seen.pose.x, seen.pose.y, seen.pose.yaw)) - true
        off[2] = (off[2] + np.pi) % (2 * np.pi) - np.pi
        rows.append((seen.t, np.hypot(off[0], off[1]), off[2],
                     off @ np.linalg.solve(seen.pose.cov + by_map, off) / 3.0))
    table = np.array(rows).reshape(-1, 4)
    return Result(*table.T, told, local)
