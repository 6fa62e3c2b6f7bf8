"""Fit where the marker frame is on the car, and the delay of its poses, from one drive.

Dead reckoning measures the motion of the rear axle p, the source that of the marker p_m:

    p_m(t) = p(t) + R(yaw(t)) (l_x, l_y),   yaw_m(t) = yaw(t) - theta

A pose was measured ``latency`` before its stamp. The axle moves in the direction of the wheels,
except for its slip v_y, where c is the mass on the axle over its stiffness [s2/m]:

    v_y = -c v (v omega + (k - c v^2) domega/dt),   k = l_r - I / (m l_f)

Slow and fast turns to both sides separate l_x from the slip and l_y from the travel per edge. The
change from one turn to the next shows the latency. Dead reckoning drifts, so the drive is cut into
blocks: the start of each block is fitted too, and standard errors come from blocks, not samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import INTERVAL_90, Estimate, FloatArray, IntArray
from dart_hal.estimation.imu_clock import READ_STD, SLOT_WORK_STD
from dart_hal.vehicle.fitting.covariance import leverage_covariance
from dart_hal.vehicle.fitting.least_squares import least_squares

from .latency_fit import GYRO_FILTER_DELAY_STD
from .measured import FitGraph

# s. In 3 s a gyro bias of 0.001 rad/s moves the car 2 mm off its place.
BLOCK_DURATION = 3.0
# m and rad, one sigma of a pose of an optical system; only their ratio matters.
OPTICAL_POSE_STD = (1e-3, 2e-3)
# Standard deviations from which a residual counts linearly (soft L1).
ROBUST_STDS = 3.0
MARKER_KEYS = ("marker_x", "marker_y", "marker_yaw", "latency")
# s2/m, mean and one sigma of c: 0.77 kg on 22 N/rad in the published model of the car.
SLIP_PRIOR = (0.03, 0.03)
# m, mean and one sigma of k, the share of the yaw acceleration in the side force of the rear axle.
# About the front axle that force is F = (m l_f a - I domega/dt) / L. The centre of mass has
# a = dv_y/dt + v omega + l_r domega/dt to the side, and v_y = -v F / C of a tyre of stiffness C.
# With c = m l_f / (L C) and dv_y/dt = -c v^2 domega/dt, of a steady turn, this is the law above.
# The published model of the car has k = 0.0945 - 0.0065 / (1.67 x 0.0805) m; inertia and axle loads
# differ between cars. Without this term each change from left to right moves the place by
# c v k 2 omega = 2 mm. Blocks of 3 s show that as scatter, and l_x, l_y and yaw absorb it.
TURN_IN_PRIOR = (0.046, 0.02)
# rad/s, one sigma of the gyro bias that remains.
REMAINING_BIAS_STD = 2e-3
# Relative, one sigma of gyro scale and travel per edge of a car that was never calibrated.
UNCALIBRATED_SCALE_STD = 0.02
# m, m, rad, s: bounds of the search. A car is 0.4 m long; no motion capture has a larger delay.
MARKER_BOUNDS = {"marker_x": 0.4, "marker_y": 0.4, "marker_yaw": 0.5, "latency": 0.25}
# m rms between poses and dead reckoning after the fit; 1 to 3 mm are usual.
MAX_MARKER_RMS = 0.02
MIN_MARKER_BLOCKS = 5
# Priors: bias, both scales, slip and turn-in.
MARKER_PRIORS = 5
# m, m, rad, s: one sigma of errors that repeat in each circle, so that blocks do not show them.
#
# Latency: errors of the delay of the yaw rate (its filter, the read of the IMU and the age of its
# samples). The latency of the poses changes by 0.95 of it, marker_x by 0.08 m/s of it: 0.05 mm.
# Marker_x: a rear tyre whose side force ends at 0.9 of its load bends by 1.2 % at 1.3 m/s2 (0.8 to
# 1.9 % at 1.1 to 0.7), as F / sqrt(1 + (k F)^2) does, while the law is linear. Fits of three
# simulated cars with and without that bend moved by 0.057 mm and 0.017 mrad per per cent.
# Marker_y: not affected by either; nine cars were off by 0.013 mm where their blocks show 0.011.
REPEATED_ERROR_STD = {"marker_x": math.hypot(7e-5, 5e-5), "marker_y": 1e-5, "marker_yaw": 3e-5,
                      "latency": math.hypot(GYRO_FILTER_DELAY_STD, SLOT_WORK_STD, READ_STD)}


@dataclass(frozen=True, slots=True)
class MarkerTrack:
    """One drive as measured by the car and by the source of poses.

    t (n,) [s]; car (n, 3): x, y [m], yaw [rad] by dead reckoning; v (n,) [m/s] of the wheels.
    pose_t (m,) [s]: stamps of the source on the car's clock; poses (m, 3), yaw unwrapped.
    pose_std: one sigma of their places [m] and yaws [rad].
    """

    t: FloatArray
    car: FloatArray
    v: FloatArray
    pose_t: FloatArray
    poses: FloatArray
    pose_std: tuple[float, float] = OPTICAL_POSE_STD


@dataclass(frozen=True, slots=True)
class Marker:
    """found: estimates by ``MARKER_KEYS``; rms [m] of the residuals; blocks: how many were used.

    places (m, 2) [m]: of the marker by each pose, ahead of the rear axle and to its left.
    """

    found: dict[str, Estimate]
    rms: float
    blocks: int
    places: FloatArray


def fit_marker(track: MarkerTrack) -> Marker:
    """Fit marker frame and latency to a drive.

    1. Cut the poses into blocks of ``BLOCK_DURATION``; drop blocks with too few poses.
    2. Minimise the robust residuals over l_x, l_y, theta, latency and five nuisance parameters.
    3. Take the standard errors from blocks (leverage covariance), and add what repeats in each.

    Raises CalibrationFailed for too few poses, and for poses that this car cannot have had.
    """
    block = ((track.pose_t - track.pose_t[0]) / BLOCK_DURATION).astype(np.int64)
    usual_size = np.median(np.bincount(block))
    used = [b for b in np.unique(block) if np.sum(block == b) >= 0.3 * usual_size
            and np.sum(block == b) >= 10]
    use = np.isin(block, used)
    if len(used) < MIN_MARKER_BLOCKS:
        raise CalibrationFailed(
            "too few poses", found=f"poses in {len(used)} blocks of {BLOCK_DURATION:.0f} s",
            expected=f"at least {MIN_MARKER_BLOCKS} blocks",
            likely="the source has the car in view only some of the time",
            remedy="dart-hal top shows the poses")
    problem = _MarkerProblem(track, track.pose_t[use], track.poses[use],
                             np.unique(block[use], return_inverse=True)[1])
    high = np.array([*MARKER_BOUNDS.values(), 1.0, 0.2, 0.2, 0.5, 0.2])
    start = np.zeros(9)
    start[7] = SLIP_PRIOR[0]
    start[8] = TURN_IN_PRIOR[0]
    fit = least_squares(problem.residual, start.tolist(), ((-high).tolist(), high.tolist()),
                        robust=ROBUST_STDS)
    rms = problem.rms(fit.x)
    for name, at_bound in zip(MARKER_KEYS, fit.at_bound, strict=False):
        if at_bound or rms > MAX_MARKER_RMS:
            raise CalibrationFailed(
                "the poses do not fit the motion of the car",
                found=f"{1e3 * rms:.0f} mm rms, {name} {fit.x[MARKER_KEYS.index(name)]:+.3f}",
                expected=f"at most {1e3 * MAX_MARKER_RMS:.0f} mm rms",
                likely="poses that jump (more than 2 % of them), another body, a frame that is not "
                       "right-handed with z up, other units, or a clock of the source that jumps",
                remedy="options of the source's URL: units, angle, hand, turn, body")
    n = len(problem.index)
    groups = np.concatenate([np.tile(problem.index, 3), n + np.arange(MARKER_PRIORS)])
    std = np.sqrt(np.diag(leverage_covariance(fit, groups)))
    found = {name: Estimate(float(fit.x[i]),
                            float(np.hypot(std[i], REPEATED_ERROR_STD.get(name, 0.0))))
             for i, name in enumerate(MARKER_KEYS)}
    return Marker(found, rms, len(used), problem.places(fit.x))


def graph_places(title: str, marker: Marker, points_name: str, curve_name: str) -> FitGraph:
    """Return the places by each pose, and the estimate with the interval of its second one."""
    left = marker.found["marker_y"]
    return FitGraph(title, "ahead of the rear axle [mm]", "to its left [mm]",
                    1e3 * marker.places[:, 0], 1e3 * marker.places[:, 1],
                    np.array([1e3 * marker.found["marker_x"].value]),
                    np.array([1e3 * left.value]), np.array([1e3 * INTERVAL_90 * left.std]),
                    points_name, curve_name)


class _MarkerProblem:
    """Residuals of the poses in standard errors, with the best start of each block."""

    def __init__(self, track: MarkerTrack, t: FloatArray, poses: FloatArray, index: IntArray
                 ) -> None:
        self.track = track
        self.t = t
        self.poses = poses
        self.index = index
        self._dt = np.diff(track.t)
        self._step = np.hypot(np.diff(track.car[:, 0]), np.diff(track.car[:, 1]))
        self._turn = np.diff(track.car[:, 2])
        self._v = 0.5 * (track.v[1:] + track.v[:-1])
        self._change = np.gradient(self._turn / self._dt)  # of the yaw rate, in each step
        self._count = np.bincount(index).astype(float)

    def residual(self, x: FloatArray) -> FloatArray:
        """Residuals of x, y, yaw and of the priors, (3 m + MARKER_PRIORS,)."""
        place, yaw = self._difference(x)
        prior = np.array([x[4] / REMAINING_BIAS_STD, x[5] / UNCALIBRATED_SCALE_STD,
                          x[6] / UNCALIBRATED_SCALE_STD,
                          (x[7] - SLIP_PRIOR[0]) / SLIP_PRIOR[1],
                          (x[8] - TURN_IN_PRIOR[0]) / TURN_IN_PRIOR[1]])
        place_std, yaw_std = self.track.pose_std
        return np.concatenate([place.real / place_std, place.imag / place_std, yaw / yaw_std,
                               prior])

    def rms(self, x: FloatArray) -> float:
        """Return the rms of the places [m] without the largest two per cent."""
        size = np.abs(self._difference(x)[0])
        return float(np.sqrt(np.mean(size[size <= np.quantile(size, 0.98)]**2)))

    def places(self, x: FloatArray) -> FloatArray:
        """Places (m, 2) [m] of the marker on the car: its estimate plus what each pose is off."""
        # A pose is turned into the axes of the car by its own yaw, which is that of the marker.
        off = self._difference(x)[0] * np.exp(-1j * (self.poses[:, 2] + x[2]))
        return np.column_stack([x[0] + off.real, x[1] + off.imag])

    def _difference(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pose minus prediction: places (m,) complex [m], yaws (m,) [rad], each block aligned.

        1. Correct the turns of dead reckoning by gyro scale and bias, and integrate them.
        2. Integrate the steps of the wheels with the slip to the side.
        3. Add the lever arm of the marker, and interpolate at the stamps minus the latency.
        """
        lx, ly, theta, latency, bias, gyro, wheels, slip, turn_in = x
        turn = self._turn * (1.0 + gyro) + bias * self._dt
        yaw = np.concatenate([[0.0], np.cumsum(turn)])
        middle = 0.5 * (yaw[1:] + yaw[:-1])
        v = self._v
        sideways = -slip * v * (v * turn + (turn_in - slip * v**2) * self._change)
        moved = (1.0 + wheels) * self._step + 1j * sideways
        place = np.concatenate([[0.0], np.cumsum(moved * np.exp(1j * middle))])
        place = place + (lx + 1j * ly) * np.exp(1j * yaw)
        t = self.t - latency
        predicted = (np.interp(t, self.track.t, place.real)
                     + 1j * np.interp(t, self.track.t, place.imag))
        predicted_yaw = np.interp(t, self.track.t, yaw) - theta
        measured = self.poses[:, 0] + 1j * self.poses[:, 1]
        return self._align(predicted, predicted_yaw, measured)

    def _align(self, predicted: FloatArray, predicted_yaw: FloatArray, measured: FloatArray
               ) -> tuple[FloatArray, FloatArray]:
        """Remove from each block the rigid motion that fits its places and yaws best."""
        b = self.index
        n = self._count
        place_std, yaw_std = self.track.pose_std
        # First by the mean yaw and the mean place of the block ...
        yaw_offset = self._mean(self.poses[:, 2] - predicted_yaw)
        predicted = predicted * np.exp(1j * yaw_offset)[b]
        predicted = predicted - self._mean(predicted)[b]
        measured = measured - self._mean(measured)[b]
        # ... then by the small rotation that the places ask for, weighted with that of the yaws.
        across = np.bincount(b, (np.conj(predicted) * measured).imag)
        spread = np.bincount(b, np.abs(predicted)**2)
        more = across / place_std**2 / (spread / place_std**2 + n / yaw_std**2)
        place = measured - predicted * np.exp(1j * more)[b]
        return place, self.poses[:, 2] - predicted_yaw - (yaw_offset + more)[b]

    def _mean(self, values: FloatArray) -> FloatArray:
        """Return the mean of each block."""
        b = self.index
        n = self._count
        if np.iscomplexobj(values):
            both = np.bincount(b, values.real) + 1j * np.bincount(b, values.imag)
            return np.asarray(both / n)
        return np.asarray(np.bincount(b, values) / n)
