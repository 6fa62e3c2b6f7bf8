"""Where rolling without slip ends, read off the measured motion, with no model in it.

The kinematic bicycle says two things: the rear axle does not move sideways,
and at a held steering command the path has one curvature, however fast. Both
are in the motion capture. Both fail gradually, the first in proportion to the
lateral acceleration, the second (delta - l kappa = K v^2 kappa) with the square
of the speed, so there is no edge to find; the limit is where a stated tolerance
is passed.
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
from dart_lab.identification.prediction.windows import MIN_SPEED

from .cases import Case

EDGES = {"lateral_acceleration": np.arange(0.0, 8.01, 0.5), "speed": np.arange(0.3, 4.01, 0.2)}
"""Bins by |v omega| [m/s2] and by v_x [m/s]."""
MIN_SAMPLES, SETTLING = 50, 70
"""Samples of 10 ms: fewest in a bin; time after a steering change that is left out."""
SLOW, TURNING = 0.8, 0.4
"""m/s below which the path is taken as that of no slip; 1/m, curvature that counts as a turn."""
SPUN = math.radians(20.0)
"""Rear slip of a car that spins or drifts, beyond any model fitted to driving."""
LINEAR = 2.5
"""m/s2; up to here slip grows in proportion, and gives the zero that the mounting hides."""
SLIP_TOLERANCE, CURVATURE_TOLERANCE = math.radians(2.0), 0.05


@dataclass(frozen=True, slots=True)
class Curve:
    """One kind of evidence in one recording: all turns to one side, or one steering level.

    by: what the bins are of; level: steering command, NaN = all of them;
    curvature [1/m] when slow, NaN = unknown; accel, speed, value (bins,): means
    of |v omega| [m/s2] and v_x [m/s], and the evidence, NaN where the recording
    says nothing; zero: what was taken off as mounting, scatter: of single
    samples [unit of the evidence].
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
    def at(self) -> FloatArray:
        """(bins,): what the bins are of."""
        return self.speed if self.by == "speed" else self.accel


def rear_slip(cases: Sequence[Case], l_r: float = L_R) -> list[Curve]:
    """Slip angle of the rear axle [rad], outwards positive, by recording and side.

    l_r [m]: that of the grids. The zero is the slip extrapolated to no lateral
    acceleration: mounting angle and place of the markers are in it, so
    recordings that never drive below 2.5 m/s2 are left out.
    """
    out = []
    for case in cases:
        g = case.grid
        slip = slip_of(g, l_r)
        for side in (1, -1):
            use = _drives(g) & (np.sign(g.omega) == side)
            curve = _bins(case.file, "lateral_acceleration", side, np.nan, g, -side * slip, use)
            zero = _zero(curve)
            if np.isfinite(zero):
                out.append(replace(curve, value=curve.value - zero, zero=zero))
    return out


def curvature_loss(cases: Sequence[Case], l_r: float = L_R) -> list[Curve]:
    """1 - curvature / curvature when slow, by recording and held steering command.

    l_r [m]: that of the grids. Spinning samples are left out.
    """
    out = []
    for case in cases:
        g = case.grid
        steady = _drives(g) & _held(g.steering) & (np.abs(slip_of(g, l_r)) < SPUN)
        for level in np.unique(np.round(g.steering[steady], 3)):
            use = steady & (np.abs(g.steering - level) < 1e-3)
            slow = use & (g.v_x < SLOW)
            if slow.sum() < MIN_SAMPLES:
                continue
            kappa = g.omega / np.maximum(g.v_x, MIN_SPEED)
            usual = float(np.median(kappa[slow]))
            if abs(usual) < TURNING:
                continue
            curve = _bins(case.file, "speed", 1 if usual > 0.0 else -1, float(level), g,
                          1.0 - kappa / usual, use, abs(usual))
            if np.isfinite(curve.value).sum() > 2:
                out.append(curve)
    return out


def slip_of(g: Grid, l_r: float) -> FloatArray:
    """Direction (n,) [rad] in which the rear axle moves, 0 without slip, + = to the left."""
    return np.asarray(np.arctan2(g.v_y - l_r * g.omega, g.v_x))


def crossing(accel: FloatArray, value: FloatArray, tolerance: float) -> float:
    """Where value (bins,) passes the tolerance for good, interpolated; NaN: nowhere."""
    known = np.isfinite(value)
    a, v = accel[known], value[known]
    if not len(v) or v[-1] <= tolerance:
        return np.nan
    below = np.flatnonzero(v <= tolerance)
    if not len(below):
        return float(a[0])
    i = int(below[-1])
    return float(a[i] + (tolerance - v[i]) / (v[i + 1] - v[i]) * (a[i + 1] - a[i]))


def _drives(g: Grid) -> BoolArray:
    return np.asarray(~g.bad & (g.v_x > MIN_SPEED))


def _held(steering: FloatArray) -> BoolArray:
    index = np.arange(len(steering))
    change = np.abs(np.diff(steering, prepend=steering[0])) > 1e-9
    return np.asarray(index - np.maximum.accumulate(np.where(change, index, 0)) > SETTLING)


def _bins(file: str, by: str, side: int, level: float, g: Grid, value: FloatArray, use: BoolArray,
          curvature: float = np.nan) -> Curve:
    accel = np.abs(g.v_x * g.omega)
    index = np.digitize(g.v_x if by == "speed" else accel, EDGES[by]) - 1
    rows = np.full((3, len(EDGES[by]) - 1), np.nan)
    spread: list[float] = []
    for k in range(rows.shape[1]):
        inside = use & (index == k)
        if inside.sum() >= MIN_SAMPLES:
            v = value[inside]
            rows[:, k] = accel[inside].mean(), g.v_x[inside].mean(), np.median(v)
            spread.append(scatter(v - rows[2, k]))
    return Curve(file, by, side, level, curvature, rows[0], rows[1], rows[2], 0.0,
                 float(np.median(spread)) if spread else np.nan)


def _zero(c: Curve) -> float:
    """Value at no lateral acceleration, by a line through at least three slow bins."""
    use = np.isfinite(c.value) & (c.accel < LINEAR)
    if use.sum() < 3:
        return np.nan
    return float(np.polyfit(c.accel[use], c.value[use], 1)[1])
