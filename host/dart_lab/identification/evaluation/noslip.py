"""Validity of rolling without slip, from the measured motion alone.

The kinematic bicycle predicts that the rear axle does not move sideways, and that the path at a
held steering command has the same curvature at any speed. Motion capture measures both. Both fail
gradually, the first in proportion to the lateral acceleration, the second (delta - l kappa =
K v^2 kappa) with the square of the speed. So the limit is where a tolerance is exceeded.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.recording.dart import Grid
from dart_hal.recording.dart.grid import L_R
from dart_hal.vehicle.fitting.robust import scatter
from dart_lab.identification.prediction.windows import MIN_WINDOW_SPEED

from .cases import Case

# Edges of the bins by |v omega| [m/s2] and by v_x [m/s] of a car of 1:10.
CURVE_EDGES = {"lateral_acceleration": np.arange(0.0, 8.01, 0.5),
               "speed": np.arange(0.3, 4.01, 0.2)}
# Samples of 10 ms that a bin needs.
MIN_BIN_SAMPLES = 50
# Samples of 10 ms after a change of the steering that are excluded.
SETTLING_SAMPLES = 70
# [m/s] The path of a car of 1:10 below it is taken as that without slip.
MAX_NO_SLIP_SPEED = 0.8
# [1/m] Smaller curvatures of a car of 1:10 do not count as a turn.
MIN_TURN_CURVATURE = 0.4
# [rad] Rear slip of a car that spins or drifts, beyond any model fitted to driving.
MIN_SPIN_SLIP = math.radians(20.0)
# [m/s2] Slip is proportional to the lateral acceleration below it. The extrapolation to 0 is the
# mounting angle of the markers.
MAX_LINEAR_ACCEL = 2.5
# Tolerances: slip angle of the rear axle [rad], and lost share of the curvature.
SLIP_TOLERANCE = math.radians(2.0)
CURVATURE_TOLERANCE = 0.05


@dataclass(frozen=True, slots=True)
class EvidenceCurve:
    """Binned evidence of one recording: all turns to one side, or one steering level.

    by: variable of the bins; level: steering command, NaN = all; curvature [1/m] at low speed,
    NaN = unknown; accel, speed, value (bins,): means of |v omega| [m/s2] and v_x [m/s], and the
    evidence, NaN without data; zero: subtracted mounting angle; scatter: of single samples [unit
    of the evidence].
    """

    file: str
    by: str
    side: int
    level: float
    curvature: float
    accel: FloatArray
    speed: FloatArray
    value: FloatArray
    zero: float
    scatter: float

    @property
    def bin_values(self) -> FloatArray:
        """Means (bins,) of the variable of the bins."""
        return self.speed if self.by == "speed" else self.accel


def rear_slip(cases: Sequence[Case], l_r: float = L_R) -> list[EvidenceCurve]:
    """Measure the slip angle of the rear axle [rad], outwards positive, by recording and side.

    l_r [m]: that of the grids. The slip extrapolated to no lateral acceleration is subtracted: it
    contains mounting angle and place of the markers. Recordings that are never below 2.5 m/s2 are
    excluded.
    """
    out = []
    for case in cases:
        g = case.grid
        slip = rear_slip_angle(g, l_r)
        for side in (1, -1):
            use = _is_driving(g) & (np.sign(g.omega) == side)
            curve = _make_curve(case.file, "lateral_acceleration", side, np.nan, g, -side * slip,
                                use)
            zero = _extrapolate_zero(curve)
            if np.isfinite(zero):
                out.append(replace(curve, value=curve.value - zero, zero=zero))
    return out


def curvature_loss(cases: Sequence[Case], l_r: float = L_R) -> list[EvidenceCurve]:
    """Measure 1 - curvature / curvature at low speed, by recording and steering command.

    l_r [m]: that of the grids. Spinning samples are excluded.
    """
    out = []
    for case in cases:
        g = case.grid
        grips = np.abs(rear_slip_angle(g, l_r)) < MIN_SPIN_SLIP
        steady = _is_driving(g) & _is_constant(g.steering) & grips
        for level in np.unique(np.round(g.steering[steady], 3)):
            use = steady & (np.abs(g.steering - level) < 1e-3)
            slow = use & (g.v_x < MAX_NO_SLIP_SPEED * g.scale.speed)
            if slow.sum() < MIN_BIN_SAMPLES:
                continue
            kappa = g.omega / np.maximum(g.v_x, MIN_WINDOW_SPEED * g.scale.speed)
            usual = float(np.median(kappa[slow]))
            if abs(usual) < MIN_TURN_CURVATURE / g.scale.length:
                continue
            curve = _make_curve(case.file, "speed", 1 if usual > 0.0 else -1, float(level), g,
                                1.0 - kappa / usual, use, abs(usual))
            if np.isfinite(curve.value).sum() > 2:
                out.append(curve)
    return out


def rear_slip_angle(g: Grid, l_r: float) -> FloatArray:
    """Compute the slip angle (n,) [rad] of the rear axle, + = it moves to the left."""
    return np.asarray(np.arctan2(g.v_y - l_r * g.omega, g.v_x))


def crossing(accel: FloatArray, value: FloatArray, tolerance: float) -> float:
    """Return where ``value`` (bins,) stays above the tolerance, interpolated; NaN: nowhere."""
    known = np.isfinite(value)
    a = accel[known]
    v = value[known]
    if not len(v) or v[-1] <= tolerance:
        return np.nan
    below = np.flatnonzero(v <= tolerance)
    if not len(below):
        return float(a[0])
    i = int(below[-1])
    return float(a[i] + (tolerance - v[i]) / (v[i + 1] - v[i]) * (a[i + 1] - a[i]))


def _is_driving(g: Grid) -> BoolArray:
    return np.asarray(~g.bad & (g.v_x > MIN_WINDOW_SPEED * g.scale.speed))


def _is_constant(steering: FloatArray) -> BoolArray:
    index = np.arange(len(steering))
    change = np.abs(np.diff(steering, prepend=steering[0])) > 1e-9
    return np.asarray(index - np.maximum.accumulate(np.where(change, index, 0)) > SETTLING_SAMPLES)


def _make_curve(file: str, variable: str, side: int, level: float, g: Grid, value: FloatArray,
                use: BoolArray, curvature: float = np.nan) -> EvidenceCurve:
    accel = np.abs(g.v_x * g.omega)
    binned = g.v_x / g.scale.speed if variable == "speed" else accel
    index = np.digitize(binned, CURVE_EDGES[variable]) - 1
    rows = np.full((3, len(CURVE_EDGES[variable]) - 1), np.nan)
    spread: list[float] = []
    for k in range(rows.shape[1]):
        inside = use & (index == k)
        if inside.sum() >= MIN_BIN_SAMPLES:
            v = value[inside]
            rows[:, k] = accel[inside].mean(), g.v_x[inside].mean(), np.median(v)
            spread.append(scatter(v - rows[2, k]))
    return EvidenceCurve(file, variable, side, level, curvature, rows[0], rows[1], rows[2], 0.0,
                         float(np.median(spread)) if spread else np.nan)


def _extrapolate_zero(c: EvidenceCurve) -> float:
    """Extrapolate to no lateral acceleration, by a line through at least three slow bins."""
    use = np.isfinite(c.value) & (c.accel < MAX_LINEAR_ACCEL)
    if use.sum() < 3:
        return np.nan
    return float(np.polyfit(c.accel[use], c.value[use], 1)[1])
