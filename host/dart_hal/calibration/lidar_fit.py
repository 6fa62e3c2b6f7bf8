"""How the lidar sits on the car, and how true its distances are, from one drive in a known map.

Each scan is laid on the map by itself, from a place that wheels and gyro only point to, and its
distances may be wrong by a share: that gives the scale, and a pose of the car as its lidar sees it.
Where the lidar does not sit as it was told, that pose is beside the car's as the marker of a motion
capture is, and ``mocap_fit`` finds offset and yaw in the same way. What is found is put on the
lidar, and the drive read again, for a scan is bent by where the lidar sits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, hypot, radians, remainder, sin, tau

import numpy as np

from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import Estimate, FloatArray, Mount, Scan, State
from dart_hal.devices.lidar.health import LidarHealthMonitor
from dart_hal.estimation import pose_check
from dart_hal.estimation.localisation.beams import Beams, place_beams
from dart_hal.estimation.localisation.belief import DEFAULT_ERRORS, MEAN_LATENCY
from dart_hal.estimation.localisation.field import Map
from dart_hal.estimation.localisation.health import MIN_AGREEMENT, MIN_MAP_AGREEMENT, agreement
from dart_hal.estimation.localisation.matcher import match
from dart_hal.estimation.localisation.path import OdometrySteps
from dart_hal.estimation.localisation.search import SEARCH_INFORMATION, search
from dart_hal.estimation.odometry import OdometryNoise
from dart_hal.estimation.pose_check import find_fault

from .mocap_fit import Marker, Track, fit_marker

ROUNDS = 2
"""Readings of the drive: what is off by 1.5 % and 1 deg is off by a hundredth of it after one."""
NOISE = (1.5e-3, 6e-4)
"""m and rad, one sigma of the place and the yaw of one scan."""
SMALL = 1e-5
"""m, rad, share: the matcher's own last step would leave the scale 0.005 % short, the same way in
every scan."""
FLOOR = {"x": 8.7e-5, "y": 8.7e-5, "yaw": hypot(6.7e-5, 4e-5), "scale": 3.5e-5}
"""m, m, rad, share: one sigma of what the stretches do not show, for each lap meets it again. That
of the marker's own fit comes on top.

The raster of the map puts a scan without noise off by 1.1 mm and 0.6 mrad (one sigma over 300
places), and two circles of 3.3 m have some 130 places of two cells: 0.1 mm, 0.05 mrad. Four laps of
a circle meet the same places, which stretches count as four times as many: three quarters of that
variance are missing, 0.087 mm. Of the yaw 0.067 mrad are missing: 32 hidden cars were off by 0.139
mrad where their stretches show 0.122. In a turn to one side the yaw is wrong by what the slip of
the rear axle is no line of the lateral force, in a turn to the other by as much the other way. What
is left of 1.2 % of 0.035 rad is what the two circles differ by, 0.04 mrad by drives made up with
such tyres. The scale of one room is off by 0.004 % (32 emulated ones), however many scans there
are."""
ANY_GYRO = OdometryNoise().gyro_scale
"""Relative, one sigma of the scale of a gyro that was not calibrated."""
BY_GYRO = {"y": 7e-3, "yaw": 0.05}
"""m, rad, by the relative error of the gyro's scale, by which the points of a scan are turned into
one pose. Drives of five hidden cars, read with a scale 0.5 % larger and smaller, had a yaw smaller
and larger by 0.25 mrad, and a y by 0.02 to 0.05 mm."""
PLACE = 0.5
"""m, edge of a place: from one to the next the walls are seen anew."""
TRIES = 20
"""Scans that are searched for in the whole map, before it is said that they are not of it."""
SHARE, EXPLAINED = 0.8, MIN_MAP_AGREEMENT
"""Of the scans that have to be found, and mean share of their beams that the map explains."""


@dataclass(frozen=True, slots=True)
class Drive:
    """States and scans (with the mount of the car's files) of one drive, in order."""

    states: Sequence[State]
    scans: Sequence[Scan]


@dataclass(frozen=True, slots=True)
class Sits:
    """By ``x``, ``y`` [m], ``yaw`` [rad], ``scale``; rms [m] between lidar and dead reckoning;
    scans that told it; agreement: mean share of beams that the map explains."""

    found: dict[str, Estimate]
    rms: float
    scans: int
    agreement: float


def sense_of(drive: Drive) -> float | None:
    """How the scans turn over how the car turned: 1 right, -1 mirrored; None: it did not turn."""
    watch, yaws = LidarHealthMonitor(), np.array([s.pose.yaw for s in drive.states])
    times = np.array([s.t for s in drive.states])
    for scan in drive.scans:
        watch.add(scan, float(np.interp(scan.arrival, times, yaws)))
    return watch.sense


def fit_lidar(drive: Drive, chart: Map, gyro_std: float = ANY_GYRO) -> Sits:
    """Fit mount and scale; ``gyro_std``: relative, one sigma of the scale of the gyro.

    Errors: CalibrationFailed for scans that are not of this map, and of another car.
    """
    mount = drive.scans[0].mount
    for _ in range(ROUNDS):
        seen = _laid(drive, chart, mount)
        marker = _marker(seen.track(drive), mount.yaw)
        scale = seen.scale()
        mount = _mounted(mount, marker, scale.value)
    std = {"x": marker.found["marker_x"].std, "y": marker.found["marker_y"].std,
           "yaw": marker.found["marker_yaw"].std, "scale": mount.scale * scale.std}
    found = {name: Estimate(float(getattr(mount, name)),
                            hypot(std[name], floor, BY_GYRO.get(name, 0.0) * gyro_std))
             for name, floor in FLOOR.items()}
    return Sits(found, marker.rms, len(seen.t), float(np.mean(seen.agreed)))


def _marker(track: Track, yaw: float) -> Marker:
    """As ``fit_marker``, in words of a lidar whose zero is said to be at ``yaw`` [rad]."""
    likely, remedy = ("wheels or gyro tell something else, or two places of the room look alike",
                      "dart-hal calibrate encoder and imu first")
    car = np.column_stack([np.interp(track.t_seen, track.t, column) for column in track.car.T])
    wrong = find_fault(pose_check.PoseComparison(track.t_seen, car, track.seen))
    if wrong is not None and wrong.option.startswith("turn="):
        aside = int(wrong.option.removeprefix("turn="))
        likely, remedy = ("the lidar looks another way than mount_yaw says",
                          "mount_yaw under [lidar] in car.toml: about "
                          f"{remainder(yaw - radians(aside), tau):.2f}")
    try:
        if wrong is None:
            return fit_marker(track)
        found, expected = wrong.found, wrong.expected
    except CalibrationFailed as why:
        found, expected = why.found, why.expected
    raise CalibrationFailed("where the scans see the car is not where it drove", found=found,
                            expected=expected, likely=likely, remedy=remedy)


def _mounted(mount: Mount, marker: Marker, scale: float) -> Mount:
    """Of which the poses would have been those of the rear axle."""
    x, y, turn = (marker.found[n].value for n in ("marker_x", "marker_y", "marker_yaw"))
    c, s = cos(-turn), sin(-turn)
    return replace(mount, x=x + c * mount.x - s * mount.y, y=y + s * mount.x + c * mount.y,
                   yaw=mount.yaw - turn, scale=mount.scale * (1.0 + scale))


@dataclass(frozen=True, slots=True)
class Seen:
    """t (n,) [s]: middles of the scans; pose (n, 3): x, y [m], yaw [rad, unwrapped] in the map;
    scales (n,), relative; agreed (n,)."""

    t: FloatArray
    pose: FloatArray
    scales: FloatArray
    agreed: FloatArray

    def track(self, drive: Drive) -> Track:
        """As ``fit_marker`` wants it."""
        car = np.array([(s.pose.x, s.pose.y, s.pose.yaw) for s in drive.states])
        return Track(np.array([s.t for s in drive.states]), car,
                     np.array([s.speed for s in drive.states]), self.t, self.pose, NOISE)

    def scale(self) -> Estimate:
        """Their median, its standard error by places: each lap sees the same walls from there."""
        place = np.floor(self.pose[:, :2] / PLACE)
        names, block = np.unique(place, axis=0, return_inverse=True)
        whole = float(np.median(self.scales))
        without = np.array([np.median(self.scales[block != b]) for b in range(len(names))])
        n = len(names)
        return Estimate(whole, float(np.sqrt((n - 1) / n * np.sum((without - without.mean())**2))))


def _laid(drive: Drive, chart: Map, mount: Mount) -> Seen:
    """Every scan that the map explains, of a lidar that sits as ``mount``."""
    steps, states = OdometrySteps(), iter(drive.states)
    rows: list[tuple[float, ...]] = []
    last: tuple[float, FloatArray] | None = None
    tries = 0
    state = next(states)
    for scan in drive.scans:
        while state.t <= scan.arrival:
            steps.add(state.t, state.pose.x, state.pose.y, state.pose.yaw)
            if (following := next(states, None)) is None:
                break
            state = following
        beams = place_beams(scan.mounted(mount), steps, DEFAULT_ERRORS, MEAN_LATENCY)
        if beams is None:
            continue
        end = float(beams.stretch.t[-1])
        start = _from(last, steps, end)
        start = _searched(chart, beams) if start is None else start
        if start is None:
            tries += 1
            if tries > TRIES:
                break
            continue
        found = match(chart, beams.points, beams.rays, start, SEARCH_INFORMATION, SMALL).pose
        agreed = agreement(chart, found, beams.points, beams.rays, beams.origin).share
        if agreed < MIN_AGREEMENT:
            continue
        last = end, found
        rows.append((*_middle(beams, found), found[3], agreed))
    table = np.array(rows).reshape(-1, 6)
    agreed = float(table[:, 5].mean()) if rows else 0.0
    if len(rows) < SHARE * len(drive.scans) or agreed < EXPLAINED:
        raise _not_of_the_map(len(rows), len(drive.scans), agreed)
    pose = table[:, 1:4]
    pose[:, 2] = np.unwrap(pose[:, 2])
    return Seen(table[:, 0], pose, table[:, 4], table[:, 5])


def _from(last: tuple[float, FloatArray] | None, steps: OdometrySteps, end: float
          ) -> FloatArray | None:
    """Where the car is at ``end`` by wheels and gyro; None where nothing is known."""
    if last is None or not steps.covers(last[0], end):
        return None
    t, pose = last
    dx, dy, turn = steps.stretch(t, end, DEFAULT_ERRORS).pose[-1].tolist()
    c, s = cos(pose[2]), sin(pose[2])
    return np.array((pose[0] + c * dx - s * dy, pose[1] + s * dx + c * dy, pose[2] + turn, 0.0))


def _searched(chart: Map, beams: Beams) -> FloatArray | None:
    """Of the whole map. One of two places that are alike does as well as the other."""
    found = search(chart, beams.points, beams.rays, beams.origin)
    return found.pose if found.is_known_room else None


def _middle(beams: Beams, pose: FloatArray) -> tuple[float, float, float, float]:
    """t, x, y, yaw in the middle of a scan of which ``pose`` is that at the end: what wheels and
    gyro are wrong by within a scan moves it least."""
    way = beams.stretch
    t = 0.5 * float(way.t[0] + way.t[-1])
    x, y, yaw = (way.at(np.array((t,)))[0] - way.pose[-1]).tolist()
    turn = float(pose[2]) - float(way.pose[-1, 2])
    c, s = cos(turn), sin(turn)
    return t, float(pose[0]) + c * x - s * y, float(pose[1]) + s * x + c * y, float(pose[2]) + yaw


def _not_of_the_map(found: int, scans: int, agreed: float) -> CalibrationFailed:
    return CalibrationFailed(
        "the scans are not of this map",
        found=f"{found} of {scans} scans lie in it, {100.0 * agreed:.0f} % of their beams agree",
        expected=f"{100.0 * SHARE:.0f} % of them, {100.0 * EXPLAINED:.0f} % of their beams",
        likely="a map of another room, or much of the room was moved since",
        remedy="dart-hal localize --map shows how much of a scan a map explains")
