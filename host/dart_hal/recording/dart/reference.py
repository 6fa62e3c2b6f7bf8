"""Marker frame of the motion capture: known from a table, or fitted to the motion.

The frame is L_x, L_y [m] from the rear axle and theta [rad], which is added to the measured yaw.
The table holds the frames of the published recordings of DART, whose markers were mounted again
for each campaign. It applies to those files only, recognised by their content: any other
recording may be of another car.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.vehicle.fitting.robust import scatter
from dart_hal.vehicle.scale import Scale

from .marker import marker_grid, savgol_derivative
from .model import Recording, Reference

FEB_24 = Reference(0.0900, -0.0164, 0.0, "February 2024")
JUL_24 = Reference(0.0862, 0.0270, 0.0, "July 2024")
SEP_24 = Reference(0.1150, 0.0100, -0.010, "September 2024")
Y_2025 = Reference(0.0930, 0.0100, 0.0, "2025, already at the centre of mass")
UNTIL = ((datetime(2024, 7, 1, tzinfo=timezone.utc), FEB_24),
         (datetime(2024, 8, 16, tzinfo=timezone.utc), JUL_24),
         (datetime(2025, 1, 1, tzinfo=timezone.utc), SEP_24))

# Samples that the fit uses: smallest speed [m/s] of a car of 1:10, largest lateral acceleration
# [m/s2].
MIN_FIT_SPEED = 0.3
MAX_FIT_LATERAL = 2.0
# The car turns above this yaw rate [rad/s] of 1:10, or lateral acceleration [m/s2].
TURNING_RATE = 0.3
TURNING_LATERAL = 0.3
MIN_TURNING_SAMPLES = 200  # of 0.01 s to each side
DERIVATIVE_POINTS = 15  # of the derivative of the yaw rate
# Intervals of the jackknife. Steering levels last for seconds: shorter intervals would count one
# level several times, and the standard error would be too small.
JACKKNIFE_GROUPS = 10
# Error of the equation of the fit, as side slip at the rear axle [rad], from smoothing and from
# nonlinear tyres. On simulated cars L_x is 2 mm too small in turns with a radius of 1 m; recordings
# of one day in September 2024 differ by as much.
SLIP_ERROR = 0.002
# L_x is not identified if its standard error is above all three: an error [m], a share of L_x, and
# a side slip [rad] at the median radius of the turns. A fast car in wide curves needs a less
# accurate L_x than a slow one. Lengths are those of a car of 1:10.
MAX_ERROR = 0.05
MAX_SHARE = 0.25
MAX_SLIP = 0.005
# Ratio of encoder speed to mocap speed below which L_y is not identified.
MIN_RATIO = 0.3
MAX_ACROSS_ERROR = 0.02  # m
MIN_ENCODER_MESSAGES = 60
ENCODER_COUNT_SAMPLES = 10  # samples over which the encoder of a message counted
# Iterations that turn the frame by the fitted theta; the third changes it by less than 1e-6 rad.
FRAME_ROUNDS = 4
REWEIGHTING_ROUNDS = 8
# Residual with half the weight, in robust standard deviations.
HALF_WEIGHT_RESIDUAL = 2.0
# Difference of two marker frames, in standard errors, above which they are two mountings.
MIN_DIFFERENT_STDS = 3.0
NEEDED = "2 s of turns to each side, at more than 0.3 m/s and less than 2 m/s2"
# What identifies a frame, and the option that states it.
OPTION = "--reference LX,THETA,LY (m, rad, m) gives the frame"


@dataclass(frozen=True, slots=True)
class _Turns:
    """Motion of the marker frame of one recording, (n,) each.

    yaw [rad]; rates of x, y [m/s] and yaw [rad/s]; good: samples that may be used; driven: samples
    with a positive throttle; scale: of the car.
    """

    yaw: FloatArray
    dx: FloatArray
    dy: FloatArray
    omega: FloatArray
    good: BoolArray
    driven: BoolArray
    scale: Scale


def reference_for(recording: Recording) -> Reference | None:
    """Return the marker frame that is known without a fit, None if there is none.

    It is that in the recording, else for a published file that of the table, by the UTC date.
    """
    if recording.marker is not None:
        return recording.marker
    if not recording.published:
        return None
    return find_tabulated(recording)


def find_tabulated(recording: Recording) -> Reference | None:
    """Return the frame of DART's markers on the date of a recording; None outside the table."""
    if recording.schema == "C":
        return Y_2025
    when = recording.when
    if when is None or when.year < 2024:
        return None
    return next((ref for limit, ref in UNTIL if when < limit), None)


def fit_reference(recordings: Sequence[Recording]) -> Reference | None:
    """Fit the marker frame to the motion; return None if the recordings do not identify it.

    Pool the recordings of one mounting. With v and v_lat the velocity of the markers along and
    across the car (the measured yaw turned by theta) and a linear rear tyre:

        v_lat = L_x omega + K v^2 omega + J v d(omega)/dt       |v omega| < 2 m/s2, v > 0.3 m/s

    1. Start with theta from the mean course of the markers against the measured yaw.
    2. Fit L_x, K, J and a correction of theta (a term in v) by robust least squares.
       Turn the frame by the correction and repeat.
    3. Standard errors by a jackknife over ten stretches, plus the error of the equation
       itself, SLIP_ERROR, at the typical radius of the turns.
    4. If an encoder counted, fit L_y by ``_fit_lateral_offset``.

    The frame is identified by 2 s of turns to each side; one circle is collinear with theta.
    """
    parts = [_turns(recording) for recording in recordings]
    theta = _course(parts)
    if theta is None:
        return None
    scale = parts[0].scale
    for _ in range(FRAME_ROUNDS):
        design, lateral = _equation(parts, theta)
        if not _turns_to_both_sides(design, scale):
            return None
        solution = _solve_robust(design, lateral)
        theta += float(np.arctan(solution[1]))
    std = _jackknife(design, lateral)
    turning = _is_turning(design, scale)
    radius = float(np.median(design[turning, 1] / np.abs(design[turning, 0])))
    lx = float(solution[0])
    lx_std = float(np.hypot(std[0], SLIP_ERROR * radius))
    if lx_std > max(MAX_ERROR * scale.length, MAX_SHARE * abs(lx), MAX_SLIP * radius):
        return None
    theta = float((theta + np.pi) % (2.0 * np.pi) - np.pi)
    ly, ly_std = _fit_lateral_offset(recordings, theta)
    return Reference(lx, theta, ly, "fitted to these recordings",
                     (lx_std, float(np.hypot(std[1], SLIP_ERROR)), ly_std))


def rolling_reference(recording: Recording) -> Reference:
    """Return a frame for speed and yaw rate, which do not depend on L_x.

    It is known or fitted, else turned to the mean course with L_x = 0: v_y and the position of the
    centre of mass are then not those of the car.
    """
    known = reference_for(recording) or fit_reference([recording])
    if known is not None:
        return known
    theta = _course([_turns(recording)])
    return Reference(0.0, theta or 0.0, 0.0, "only turned to the course; its position is unknown")


def difference(given: Reference, fitted: Reference) -> str:
    """Describe the entries in which two frames differ by more than 3 standard errors.

    Returns "" if they agree. given: exact if it has no standard errors.
    """
    if fitted.std is None:
        return ""
    found = []
    other = given.std or (0.0, 0.0, 0.0)
    angle = float((given.theta - fitted.theta + np.pi) % (2.0 * np.pi) - np.pi)
    for name, unit, change, i in (("L_x", "m", given.lx - fitted.lx, 0), ("theta", "rad", angle, 1),
                              ("L_y", "m", given.ly - fitted.ly, 2)):
        error = float(np.hypot(fitted.std[i], np.nan_to_num(other[i])))
        if np.isfinite(error) and abs(change) > MIN_DIFFERENT_STDS * error:
            found.append(f"{name} by {change:+.4f} {unit} "
                         f"({abs(change) / error:.1f} standard errors)")
    return ", ".join(found)


def _turns(recording: Recording) -> _Turns:
    g = marker_grid(recording)
    m = recording.messages
    driven = m.throttle[g.message] > 0.0
    return _Turns(g.yaw, g.dx, g.dy, g.omega, ~g.bad, driven, recording.scale)


def _course(parts: Sequence[_Turns]) -> float | None:
    """Return the mean angle [rad] from the measured yaw to the course; None without motion.

    Only samples with throttle are used if there are any: the course of a car that rolls backwards
    is opposite to its yaw.
    """
    east = 0.0
    north = 0.0
    for forward in (True, False):
        for part in parts:
            speed = np.hypot(part.dx, part.dy)
            use = (part.good & (speed > MIN_FIT_SPEED * part.scale.speed)
                   & (np.abs(speed * part.omega) < MAX_FIT_LATERAL)
                   & (part.driven | (not forward)))
            angle = np.arctan2(part.dy[use], part.dx[use]) - part.yaw[use]
            east += float(np.cos(angle).sum())
            north += float(np.sin(angle).sum())
        if east or north:
            return float(np.arctan2(north, east))
    return None


def _equation(parts: Sequence[_Turns], theta: float) -> tuple[FloatArray, FloatArray]:
    """Return the regressors (n, 4), omega, v, v^2 omega, v d(omega)/dt, and v_lat (n,)."""
    design = []
    lateral = []
    for part in parts:
        yaw = part.yaw + theta
        v = np.cos(yaw) * part.dx + np.sin(yaw) * part.dy
        across = -np.sin(yaw) * part.dx + np.cos(yaw) * part.dy
        rate = savgol_derivative(part.omega, DERIVATIVE_POINTS)
        use = (part.good & (v > MIN_FIT_SPEED * part.scale.speed)
               & (np.abs(v * part.omega) < MAX_FIT_LATERAL))
        terms = [part.omega, v, v * v * part.omega, v * rate]
        design.append(np.column_stack(terms)[use])
        lateral.append(across[use])
    return np.concatenate(design), np.concatenate(lateral)


def _is_turning(design: FloatArray, scale: Scale) -> BoolArray:
    omega = design[:, 0]
    v = design[:, 1]
    return np.asarray((np.abs(omega) > TURNING_RATE * scale.yaw_rate)
                      | (np.abs(v * omega) > TURNING_LATERAL))


def _turns_to_both_sides(design: FloatArray, scale: Scale) -> bool:
    turning = _is_turning(design, scale)
    left = turning & (design[:, 0] > 0.0)
    right = turning & (design[:, 0] < 0.0)
    return min(int(left.sum()), int(right.sum())) >= MIN_TURNING_SAMPLES


def _solve_robust(design: FloatArray, y: FloatArray) -> FloatArray:
    """Solve least squares with a Cauchy loss, so that errors of the tracker have little weight.

    Iteratively reweighted: weight 1 / (1 + (residual / limit)^2), limit 2 robust standard
    deviations.
    """
    solution = np.linalg.lstsq(design, y, rcond=None)[0]
    for _ in range(REWEIGHTING_ROUNDS):
        residual = y - design @ solution
        limit = HALF_WEIGHT_RESIDUAL * scatter(residual) + 1e-9
        weight = 1.0 / np.sqrt(1.0 + (residual / limit)**2)
        solution = np.linalg.lstsq(design * weight[:, None], y * weight, rcond=None)[0]
    return np.asarray(solution)


def _jackknife(design: FloatArray, y: FloatArray) -> FloatArray:
    """Return standard errors of ``_solve_robust`` by a jackknife over ten intervals.

    With the solutions s_i without interval i: std^2 = (n - 1) / n sum (s_i - mean)^2.
    """
    group = np.arange(len(y)) * JACKKNIFE_GROUPS // len(y)
    parts = np.array([_solve_robust(design[group != i], y[group != i])
                      for i in range(JACKKNIFE_GROUPS)])
    spread = ((parts - parts.mean(axis=0))**2).sum(axis=0)
    return np.asarray(np.sqrt((JACKKNIFE_GROUPS - 1) / JACKKNIFE_GROUPS * spread))


def _fit_lateral_offset(recordings: Sequence[Recording], theta: float) -> tuple[float, float]:
    """Fit L_y; return it and its standard error [m], or (0, NaN) if it is not identified.

        v_long = s v_wheel - L_y omega      v_wheel > 0.3 m/s, |v_long omega| < 2 m/s2

    All three are means over the 0.1 s in which the encoder counted; s: its scale.
    """
    design = []
    along = []
    for recording in recordings:
        if recording.encoder != "ok":
            continue
        g = marker_grid(recording)
        m = recording.messages
        yaw = g.yaw + theta
        end = m.arrival / SAMPLE
        forward = np.cos(yaw) * g.dx + np.sin(yaw) * g.dy
        bad: FloatArray = g.bad.astype(np.float64)
        v_long = _average(forward, end)
        omega = _average(g.omega, end)
        bad = _average(bad, end)
        use = ((bad == 0.0) & (m.speed > MIN_FIT_SPEED * recording.scale.speed)
               & (np.abs(v_long * omega) < MAX_FIT_LATERAL)
               & (end > ENCODER_COUNT_SAMPLES) & (end < len(g.t) - 1))
        design.append(np.column_stack([m.speed, -omega])[use])
        along.append(v_long[use])
    if sum(map(len, along)) < MIN_ENCODER_MESSAGES:
        return 0.0, float("nan")
    rows = np.concatenate(design)
    y = np.concatenate(along)
    ratio, ly = _solve_robust(rows, y).tolist()
    std = float(_jackknife(rows, y)[1])
    if ratio < MIN_RATIO or std > MAX_ACROSS_ERROR * recordings[0].scale.length:
        return 0.0, float("nan")
    return float(ly), float(np.hypot(std, SLIP_ERROR))


def _average(series: FloatArray, end: FloatArray) -> FloatArray:
    """Average a series (n,) over the ENCODER_COUNT_SAMPLES before each end (m,)."""
    total = np.concatenate([[0.0], np.cumsum(0.5 * (series[1:] + series[:-1]))])
    sample = np.arange(len(total))
    here = np.interp(end, sample, total)
    before = np.interp(end - ENCODER_COUNT_SAMPLES, sample, total)
    return np.asarray((here - before) / ENCODER_COUNT_SAMPLES)
