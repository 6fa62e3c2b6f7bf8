"""Fit mounting pose and scale of a lidar from one drive in a known map.

1. Match each scan to the map on its own. Wheels and gyro give the starting point only. The scale of
   the distances is matched too. Result: poses of the car as its lidar measures them, and scales.
2. If the lidar is not mounted as assumed, these poses are offset from dead reckoning, as a motion
   capture marker would be. ``mocap_fit`` finds the offset and the yaw.
3. Correct the mount and repeat, because the mount changes how a scan is undistorted.
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

from .mocap_fit import Marker, MarkerTrack, fit_marker

# Passes over the drive: after one, an error of 1.5 % and 1 deg is a hundredth of that.
MOUNT_ROUNDS = 2
# m and rad, one sigma of place and yaw of one matched scan.
SCAN_POSE_STD = (1.5e-3, 6e-4)
# m, rad, share: last step of the matcher. Its default would leave the scale 0.005 % short, in the
# same direction in every scan.
MATCH_TOLERANCE = 1e-5
# m, m, rad, share: one sigma of errors that repeat in each lap, so that blocks do not show them.
# The error of the marker fit is added.
#
# x, y: the raster of the map moves a scan without noise by 1.1 mm and 0.6 mrad (one sigma over 300
# places). Two circles of 3.3 m have some 130 places of two cells: 0.1 mm, 0.05 mrad. Four laps meet
# the same places, and blocks count them as four times as many: three quarters of that variance are
# missing, 0.087 mm.
# yaw: 0.067 mrad are missing: 32 hidden cars were off by 0.139 mrad where their blocks show 0.122.
# In a turn the slip of the rear axle is not linear in the lateral force, which moves the yaw; in a
# turn to the other side by as much the other way. Of 1.2 % of 0.035 rad remains the difference of
# the two circles, 0.04 mrad in simulated drives with such tyres.
# scale: in one room off by 0.004 % (32 emulated rooms), however many scans there are.
MOUNT_STD_FLOOR = {"x": 8.7e-5, "y": 8.7e-5, "yaw": hypot(6.7e-5, 4e-5), "scale": 3.5e-5}
# Relative, one sigma of the scale of a gyro that was not calibrated.
DEFAULT_GYRO_STD = OdometryNoise().gyro_scale
# m, rad, per relative error of the gyro scale, which undistorts a scan. Drives of five hidden cars,
# processed with a scale 0.5 % larger and smaller: yaw smaller and larger by 0.25 mrad, y by 0.02 to
# 0.05 mm.
GYRO_SCALE_EFFECT = {"y": 7e-3, "yaw": 0.05}
# m, edge of a cell of the jackknife: from one cell to the next the walls are measured again.
JACKKNIFE_CELL = 0.5
# Scans that are searched for in the whole map before the map is rejected.
MAX_SEARCHES = 20
# Share of the scans that have to match, and mean share of their beams that the map explains.
MIN_MATCHED_SCANS = 0.8


@dataclass(frozen=True, slots=True)
class LidarDrive:
    """States and scans (with the mount of the car's files) of one drive, in order."""

    states: Sequence[State]
    scans: Sequence[Scan]


@dataclass(frozen=True, slots=True)
class LidarFit:
    """Result of a fit.

    found: estimates of ``x``, ``y`` [m], ``yaw`` [rad], ``scale``. rms [m] between lidar and dead
    reckoning. scans: how many were used. agreement: mean share of beams that the map explains.
    marker: the last fit of the offset of the scans' poses from the rear axle.
    """

    found: dict[str, Estimate]
    rms: float
    scans: int
    agreement: float
    marker: Marker


def rotation_sense(drive: LidarDrive) -> float | None:
    """Turns of the scans over turns of the car: 1 correct, -1 mirrored; None: no turns."""
    monitor = LidarHealthMonitor()
    yaws = np.array([s.pose.yaw for s in drive.states])
    times = np.array([s.t for s in drive.states])
    for scan in drive.scans:
        monitor.add(scan, float(np.interp(scan.arrival, times, yaws)))
    return monitor.sense


def fit_lidar(drive: LidarDrive, chart: Map, gyro_std: float = DEFAULT_GYRO_STD) -> LidarFit:
    """Fit mount and scale. gyro_std: relative standard error of the gyro scale.

    Raises CalibrationFailed for scans that do not match this map or this drive.
    """
    mount = drive.scans[0].mount
    for _ in range(MOUNT_ROUNDS):
        matched = match_scans(drive, chart, mount)
        marker = _fit_offset(matched.track(drive), mount.yaw)
        scale = matched.scale()
        mount = _correct_mount(mount, marker, scale.value)
    std = {"x": marker.found["marker_x"].std, "y": marker.found["marker_y"].std,
           "yaw": marker.found["marker_yaw"].std, "scale": mount.scale * scale.std}
    found = {name: Estimate(float(getattr(mount, name)),
                            hypot(std[name], floor, GYRO_SCALE_EFFECT.get(name, 0.0) * gyro_std))
             for name, floor in MOUNT_STD_FLOOR.items()}
    return LidarFit(found, marker.rms, len(matched.t), float(np.mean(matched.agreement)), marker)


def _fit_offset(track: MarkerTrack, yaw: float) -> Marker:
    """Call ``fit_marker``; on failure describe the cause for a lidar with mount_yaw ``yaw``."""
    likely = "wheels or gyro are wrong, or two places of the room look the same in a scan"
    remedy = "dart-hal calibrate encoder and imu first"
    car = np.column_stack([np.interp(track.pose_t, track.t, column) for column in track.car.T])
    fault = find_fault(pose_check.PoseComparison(track.pose_t, car, track.poses))
    if fault is not None and fault.option.startswith("turn="):
        turn = int(fault.option.removeprefix("turn="))
        likely = "the lidar points in another direction than mount_yaw states"
        remedy = ("mount_yaw under [lidar] in car.toml: about "
                  f"{remainder(yaw - radians(turn), tau):.2f}")
    try:
        if fault is None:
            return fit_marker(track)
        found = fault.found
        expected = fault.expected
    except CalibrationFailed as error:
        found = error.found
        expected = error.expected
    raise CalibrationFailed("the poses of the scans do not fit the motion of the car", found=found,
                            expected=expected, likely=likely, remedy=remedy)


def _correct_mount(mount: Mount, marker: Marker, scale: float) -> Mount:
    """Return the mount with which the matched poses would be those of the rear axle."""
    x, y, turn = (marker.found[n].value for n in ("marker_x", "marker_y", "marker_yaw"))
    c = cos(-turn)
    s = sin(-turn)
    return replace(mount, x=x + c * mount.x - s * mount.y, y=y + s * mount.x + c * mount.y,
                   yaw=mount.yaw - turn, scale=mount.scale * (1.0 + scale))


@dataclass(frozen=True, slots=True)
class MatchedScans:
    """Scans that were matched to the map.

    t (n,) [s]: middles of the scans. pose (n, 3): x, y [m], yaw [rad, unwrapped] in the map.
    scales (n,): relative error of the distances. agreement (n,): share of explained beams.
    """

    t: FloatArray
    pose: FloatArray
    scales: FloatArray
    agreement: FloatArray

    def track(self, drive: LidarDrive) -> MarkerTrack:
        """Return matched poses and dead reckoning as input of ``fit_marker``."""
        car = np.array([(s.pose.x, s.pose.y, s.pose.yaw) for s in drive.states])
        return MarkerTrack(np.array([s.t for s in drive.states]), car,
                           np.array([s.speed for s in drive.states]), self.t, self.pose,
                           SCAN_POSE_STD)

    def scale(self) -> Estimate:
        """Median of the scales, with its standard error by a jackknife over places.

        Over places and not over scans, because each lap measures the same walls from there.
        """
        place = np.floor(self.pose[:, :2] / JACKKNIFE_CELL)
        cells, cell = np.unique(place, axis=0, return_inverse=True)
        whole = float(np.median(self.scales))
        without = np.array([np.median(self.scales[cell != c]) for c in range(len(cells))])
        n = len(cells)
        return Estimate(whole, float(np.sqrt((n - 1) / n * np.sum((without - without.mean())**2))))


def match_scans(drive: LidarDrive, chart: Map, mount: Mount) -> MatchedScans:
    """Match every scan to the map, for a lidar that is mounted as ``mount``.

    1. Undistort the scan by the odometry of its revolution.
    2. Start from the last match plus odometry, or search the whole map if there is none.
    3. Match pose and scale; skip the scan if the map explains too few beams.

    Raises CalibrationFailed if too few scans match.
    """
    steps = OdometrySteps()
    states = iter(drive.states)
    rows: list[tuple[float, ...]] = []
    last: tuple[float, FloatArray] | None = None
    searches = 0
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
        start = _predict_pose(last, steps, end)
        start = _search_map(chart, beams) if start is None else start
        if start is None:
            searches += 1
            if searches > MAX_SEARCHES:
                break
            continue
        found = match(chart, beams.points, beams.rays, start, SEARCH_INFORMATION,
                      MATCH_TOLERANCE).pose
        agreed = agreement(chart, found, beams.points, beams.rays, beams.origin).share
        if agreed < MIN_AGREEMENT:
            continue
        last = end, found
        rows.append((*_pose_at_middle(beams, found), found[3], agreed))
    table = np.array(rows).reshape(-1, 6)
    agreed = float(table[:, 5].mean()) if rows else 0.0
    if len(rows) < MIN_MATCHED_SCANS * len(drive.scans) or agreed < MIN_MAP_AGREEMENT:
        raise _not_of_the_map(len(rows), len(drive.scans), agreed)
    pose = table[:, 1:4]
    pose[:, 2] = np.unwrap(pose[:, 2])
    return MatchedScans(table[:, 0], pose, table[:, 4], table[:, 5])


def _predict_pose(last: tuple[float, FloatArray] | None, steps: OdometrySteps, end: float
                  ) -> FloatArray | None:
    """Pose at ``end`` [s] by the last match and odometry; None if one of them is missing."""
    if last is None or not steps.covers(last[0], end):
        return None
    t, pose = last
    dx, dy, turn = steps.stretch(t, end, DEFAULT_ERRORS).pose[-1].tolist()
    c = cos(pose[2])
    s = sin(pose[2])
    return np.array((pose[0] + c * dx - s * dy, pose[1] + s * dx + c * dy, pose[2] + turn, 0.0))


def _search_map(chart: Map, beams: Beams) -> FloatArray | None:
    """Search the whole map. If two places look the same, either of them will do."""
    found = search(chart, beams.points, beams.rays, beams.origin)
    return found.pose if found.is_known_room else None


def _pose_at_middle(beams: Beams, pose: FloatArray) -> tuple[float, float, float, float]:
    """(t, x, y, yaw) in the middle of a scan whose pose at the end is ``pose``.

    Errors of wheels and gyro within the scan move the middle least.
    """
    odometry = beams.stretch
    t = 0.5 * float(odometry.t[0] + odometry.t[-1])
    x, y, yaw = (odometry.interpolate(np.array((t,)))[0] - odometry.pose[-1]).tolist()
    turn = float(pose[2]) - float(odometry.pose[-1, 2])
    c = cos(turn)
    s = sin(turn)
    return t, float(pose[0]) + c * x - s * y, float(pose[1]) + s * x + c * y, float(pose[2]) + yaw


def _not_of_the_map(found: int, scans: int, agreed: float) -> CalibrationFailed:
    return CalibrationFailed(
        "the scans are not of this map",
        found=f"{found} of {scans} scans match it, with {100.0 * agreed:.0f} % of their beams",
        expected=f"at least {100.0 * MIN_MATCHED_SCANS:.0f} % of the scans, with "
                 f"{100.0 * MIN_MAP_AGREEMENT:.0f} % of their beams",
        likely="a map of another room, or furniture was moved since",
        remedy="dart-hal localize --map shows how much of a scan a map explains")
