"""Fit the ESC to the motion of lifted wheels: where the motor begins to drive, and where it ends.

    v' = K (p - P) - E (p - P) v - A - C v          p: pulse, P: pulse at which the drive begins

holds for every pulse on one side of neutral, with K = E = 0 at neutral. Integrated twice it is
linear in K, KP, E, EP, A, C and in place and speed at the start of each segment. So one linear
least-squares problem over all segments gives P. Steady speeds alone could not: they cannot separate
dry friction A from the dead band.

If the motor follows its pulses with a lag T, p is replaced by p + (b - p) e^(-(t - d)/T), where b
is the previous pulse and d the delay. T and d are found by nonlinear least squares, with the linear
problem solved inside.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import INTERVAL_90, Estimate, FloatArray

from .measured import FitGraph
from .spin import PulseSpan

# s after a change of the pulse: two PWM frames, and the delay of the ESC.
PULSE_SETTLING = 0.08
# s after which a motor of any lag T has ended its drive at neutral. A drive of twice the dead band
# has decreased to it after 0.7 T and the delay. Once T is known, PULSE_SETTLING + T are enough.
COAST_SETTLING = 0.2
# s of lag from which it is fitted: of a shorter one PULSE_SETTLING leaves a twentieth.
MIN_FITTED_LAG = 0.025
# s, bounds. The delay counts from the State before the pulse, which is known to half a frame.
LAG_BOUNDS = (0.005, 0.2)
DELAY_BOUNDS = (-0.02, 0.1)
# s: lag, and a delay of half a PWM frame and a pulse.
LAG_GUESS = (0.05, 0.012)
# m/s below which dry friction is not constant and one edge takes 7 ms.
MIN_WHEEL_SPEED = 0.3
# us, one sigma of P by the model: the friction of 20 us of drive to a quarter of a per cent.
MODEL_STD_US = 0.05
# us, the same with a lag. Two of ten simulated cars were off by 0.4 and 0.7 us at a jackknife of
# 0.2, in both directions alike, which the jackknife cannot show.
LAG_MODEL_STD_US = 0.4
# Points from which a segment shows its curvature.
MIN_SEGMENT_POINTS = 8
# us, half a count of the PCA9685: with a larger error, neutral is no better known than 1500 us.
MAX_BEGIN_STD_US = 2.5
# us, one sigma below which the end of the throttle counts as found; pulses beyond it, at least.
MAX_KNEE_STD_US = 5.0
MIN_PLATEAU_PULSES = 3


@dataclass(frozen=True, slots=True)
class DriveForce:
    """Force of the motor in one direction and friction of the wheels.

    begin [us]: pulse at which the drive begins. slope [m/s2 per us]: negative below neutral.
    a [m/s2], c [1/s]: friction. rms [m] of the residuals. lag [s] of the motor, 0 if negligible.
    pulses [us], forces [m/s2] (n,): of each driven segment alone, at standstill.
    """

    begin: Estimate
    slope: float
    a: float
    c: float
    rms: float
    lag: float = 0.0
    pulses: FloatArray = field(default_factory=lambda: np.empty(0), repr=False, compare=False)
    forces: FloatArray = field(default_factory=lambda: np.empty(0), repr=False, compare=False)

    def coasting_time(self, fast: float, slow: float, drag: float = 0.0) -> float:
        """Time [s] from one speed [m/s] to another without drive; ``drag`` [m/s2] less friction."""
        c = max(self.c, 1e-6)
        a = self.a - drag
        return math.log((a + c * fast) / (a + c * slow)) / c

    def missing_friction(self, fast: float, slow: float, seconds: float) -> float:
        """Part of ``a`` [m/s2] that is missing if coasting took ``seconds`` instead."""
        from scipy.optimize import brentq  # these modules of scipy take a second

        return float(brentq(lambda drag: self.coasting_time(fast, slow, drag) - seconds,
                            -3.0 * self.a, 0.95 * self.a))

    def begin_without_brake(self, drag: Estimate) -> Estimate:
        """Begin of the drive if ``drag`` of the friction was a brake at neutral."""
        return Estimate(self.begin.value + drag.value / self.slope,
                        math.hypot(self.begin.std, drag.std / self.slope), self.begin.unit)


@dataclass(frozen=True, slots=True)
class SpinSegment:
    """Motion during one constant pulse.

    t (n,) [s]: since the State before it. Over s = t - t[0]: distance x [m], its integral
    ``travelled`` [m s], its derivative ``speed`` [m/s]. start (n, 2): columns of place and speed at
    the start, orthonormal. p [100 us]: pulse minus reference, away from neutral; drives: 1, or 0 at
    neutral. jump [100 us]: the previous pulse minus this one.
    """

    t: FloatArray
    x: FloatArray
    travelled: FloatArray
    speed: FloatArray
    start: FloatArray
    p: float
    jump: float
    drives: float


@dataclass(frozen=True, slots=True)
class ForceLaw:
    """Solution of the problem: P from the reference [100 us, away from neutral], A, C, K [per
    100 us], rms [m], (lag, delay) [s] of the motor."""

    begin: float
    a: float
    c: float
    slope: float
    rms: float
    lag_delay: tuple[float, float]


def fit_force(spans: Sequence[PulseSpan], neutral: float) -> DriveForce:
    """Fit the spans of one direction, given in the order in which they were driven.

    1. Fit without lag. If a small lag fits better, fit lag and delay.
    2. If the lag is large enough, omit more of the start of each segment and fit again.
    3. The standard error is a jackknife over segments, because friction differs between them.

    Raises CalibrationFailed if the wheels turned too little or did not repeat.
    """
    reference = min((s.pulse_us for s in spans if s.pulse_us != neutral),
                    key=lambda p: abs(p - neutral), default=neutral)
    parts = _make_segments(spans, neutral, reference, PULSE_SETTLING)
    lag_delay = (0.0, 0.0)
    if not _are_enough(parts):
        raise CalibrationFailed(
            "the wheels turned too little to find where the motor begins to drive",
            found=f"{len(parts)} segments above {MIN_WHEEL_SPEED} m/s", expected=f"{len(spans)}",
            likely="something brakes the wheels, or the encoder loses edges",
            remedy="dart-hal doctor; run it again")
    coasting = _make_segments(spans, neutral, reference, COAST_SETTLING)[1:]
    if _are_enough(coasting) and _have_lag(coasting):
        fitted = _fit_law(coasting, LAG_GUESS).lag_delay
        if fitted[0] > MIN_FITTED_LAG:
            parts = _make_segments(spans, neutral, reference, PULSE_SETTLING + fitted[0])[1:]
            lag_delay = fitted
    whole = _fit_law(parts, lag_delay)
    without = np.array([_fit_law(parts[:k] + parts[k + 1:], whole.lag_delay).begin
                        for k in range(len(parts))])
    n = len(parts)
    std = math.sqrt((n - 1) / n * float(np.sum((without - without.mean()) ** 2)))
    away = 100.0 if reference > neutral else -100.0
    if not (100.0 * std <= MAX_BEGIN_STD_US and whole.a > 0.0):
        raise CalibrationFailed(
            "the wheels do not accelerate and coast in the same way each time",
            found=f"pulse at which the motor begins to drive +- {100.0 * std:.1f} us (one sigma), "
                  f"friction {whole.a:.1f} m/s2",
            expected=f"at most {MAX_BEGIN_STD_US} us, and friction above 0",
            likely="the encoder loses edges, a wheel rubs, or the battery is nearly empty",
            remedy="dart-hal doctor; run it again")
    model_std = LAG_MODEL_STD_US if lag_delay[0] else MODEL_STD_US
    begin = Estimate(reference + away * whole.begin, math.hypot(100.0 * std, model_std), "us")
    driven = [part for part in parts if part.drives]
    return DriveForce(begin, whole.slope / away, whole.a, whole.c, whole.rms, whole.lag_delay[0],
                      np.array([reference + away * part.p for part in driven]),
                      _forces_alone(driven, whole.begin, _solve(parts, whole.lag_delay)[0],
                                    whole.lag_delay))


def _forces_alone(driven: Sequence[SpinSegment], begin: float, found: FloatArray,
                  lag_delay: tuple[float, float]) -> FloatArray:
    """Return the force (n,) [m/s2] of each segment that explains its own travel best.

    The friction is that of all; found: of ``_solve``.
    """
    forces = []
    for part in driven:
        columns, travel = _rows(part, lag_delay)
        # Travel without friction, over that by the force of the law.
        law = columns[:, :4] @ found[:4]
        share = float(law @ (travel - columns[:, 4:] @ found[4:])) / float(law @ law)
        forces.append(share * float(found[0]) * (part.p - begin))
    return np.array(forces)


def graph_forces(directions: Sequence[DriveForce]) -> FitGraph:
    """Return the force of each driven segment and the law, ahead positive."""
    points = []
    lines = []
    for one in directions:
        sign = math.copysign(1.0, one.slope)
        points.append((one.pulses, sign * one.forces))
        begin = one.begin.value
        far = one.pulses[np.argmax(np.abs(one.pulses - begin))]
        # A gap between the lines of two directions.
        ends = np.array([begin, far, math.nan])
        lines.append((ends, sign * one.slope * (ends - begin),
                      np.full(3, INTERVAL_90 * abs(one.slope) * one.begin.std)))
    measured = np.concatenate(points, axis=1)
    fit = np.concatenate(lines, axis=1)
    return FitGraph("The motor at each pulse, wheels lifted: no drive in the dead band",
                    "pulse [us]", "acceleration at standstill [m/s2]", measured[0], measured[1],
                    fit[0], fit[1], fit[2], "each pulse alone")


def _are_enough(parts: Sequence[SpinSegment]) -> bool:
    return len(parts) >= 6 and len({part.p for part in parts if part.drives}) >= 2


def _have_lag(parts: Sequence[SpinSegment]) -> bool:
    """Return whether a small lag explains the travel better than none."""
    small, none = (_solve(parts, (lag, LAG_GUESS[1]))[1] for lag in (MIN_FITTED_LAG, 0.0))
    return bool(small @ small < none @ none)


def _make_segments(spans: Sequence[PulseSpan], neutral: float, reference: float, settling: float
                   ) -> list[SpinSegment]:
    """Make the segments with enough motion; at neutral the first ``settling`` [s] are omitted."""
    from scipy.interpolate import CubicSpline

    found = []
    for k, span in enumerate(spans):
        sign = 0.0 if span.pulse_us == neutral else 1.0 if span.pulse_us > neutral else -1.0
        turning = _select_turning(span.without_start(PULSE_SETTLING if sign else settling))
        if turning is None:
            continue
        t, x = turning
        distance = CubicSpline(t - t[0], x - x[0])
        before = spans[k - 1].pulse_us if k else neutral
        found.append(SpinSegment(
            t, x - x[0], np.asarray(distance.antiderivative()(t - t[0])),
            np.asarray(distance.derivative()(t - t[0])),
            np.linalg.qr(np.stack([np.ones_like(t), t - t[0]], axis=1))[0],
            sign * (span.pulse_us - reference) / 100.0,
            sign * (before - span.pulse_us) / 100.0, abs(sign)))
    return found


def _select_turning(span: PulseSpan) -> tuple[FloatArray, FloatArray] | None:
    """(t, x) from where the wheels turn until they stop; None for too few points."""
    t = span.t
    x = span.x
    if len(t) < MIN_SEGMENT_POINTS:
        return None
    speed = np.gradient(x, t)
    slow = np.flatnonzero(speed < MIN_WHEEL_SPEED)
    begin = int(np.argmax(speed >= MIN_WHEEL_SPEED)) if slow.size and slow[0] == 0 else 0
    ends = slow[slow > begin]
    end = int(ends[0]) if ends.size else len(t)
    return (t[begin:end], x[begin:end]) if end - begin >= MIN_SEGMENT_POINTS else None


def _rows(part: SpinSegment, lag_delay: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """(columns of K, KP, E, EP, A, C; travel), without place and speed at the start."""
    from scipy.integrate import cumulative_trapezoid

    s = part.t - part.t[0]
    drives = part.drives
    half = 0.5 * s**2
    force = part.p * half
    loss = -part.p * part.travelled
    lag, delay = lag_delay
    if lag and part.jump:
        # The part of the previous pulse, jump e^(-(t - d)/T), integrated twice.
        tail = part.jump * math.exp((delay - part.t[0]) / lag)
        e = np.exp(-s / lag)
        force = force + tail * lag * (s - lag * (1.0 - e))
        slower = cumulative_trapezoid(e * part.speed, s, initial=0.0)
        loss = loss - tail * cumulative_trapezoid(slower, s, initial=0.0)
    columns = np.stack([force, -drives * half, loss, drives * part.travelled, -half,
                        -part.travelled], axis=1)
    q = part.start
    return columns - q @ (q.T @ columns), part.x - q @ (q.T @ part.x)


def _fit_law(parts: Sequence[SpinSegment], start: tuple[float, float]) -> ForceLaw:
    """Fit lag and delay from ``start`` on, and the law; (0, 0): without lag."""
    from scipy.optimize import least_squares

    lag_delay = start
    if start[0]:
        low, high = np.array([LAG_BOUNDS, DELAY_BOUNDS]).T
        best = least_squares(lambda p: 1e3 * _solve(parts, (p[0], p[1]))[1], start,
                             bounds=(low, high), x_scale=LAG_GUESS, diff_step=1e-3)
        lag_delay = float(best.x[0]), float(best.x[1])
    found, residual = _solve(parts, lag_delay)
    return ForceLaw(float(found[1] / found[0]), float(found[4]), float(found[5]),
                    float(found[0]), float(np.sqrt(np.mean(residual**2))), lag_delay)


def _solve(parts: Sequence[SpinSegment], lag_delay: tuple[float, float]
           ) -> tuple[FloatArray, FloatArray]:
    """Solve for (K, KP, E, EP, A, C); the second result are the residuals of the travel [m]."""
    rows = [_rows(part, lag_delay) for part in parts]
    columns = np.concatenate([c for c, _ in rows])
    travel = np.concatenate([x for _, x in rows])
    scale = np.linalg.norm(columns, axis=0)
    found = np.linalg.lstsq(columns / scale, travel, rcond=None)[0] / scale
    return np.asarray(found), np.asarray(travel - columns @ found)


def find_knee(pulses: FloatArray, speeds: FloatArray) -> Estimate | None:
    """Fit the pulse [us] beyond which the speed no longer increases; None if it always does.

    Below it the speed is (a p + b) / (1 + c p), the solution of v' = 0 for motor and friction.
    """
    from scipy.optimize import curve_fit

    middle = float(pulses.mean())
    width = float(np.ptp(pulses))

    def law(p: FloatArray, s: float, a: float, b: float, c: float) -> FloatArray:
        q = (np.minimum(p, s) - middle) / width
        return np.asarray((a * q + b) / (1.0 + c * q))

    guess = (float(pulses[-1]) - 0.2 * width, float(np.ptp(speeds)), float(speeds.mean()), 0.3)
    try:
        found, covariance = curve_fit(law, pulses, speeds, guess, bounds=(
            [float(pulses[3]), 0.0, 0.0, -0.9], [float(pulses[-1]), np.inf, np.inf, 1.9]))
    except RuntimeError:
        return None
    std = math.sqrt(covariance[0, 0])
    beyond = int(np.sum(pulses > found[0]))
    clear = std < MAX_KNEE_STD_US and beyond >= MIN_PLATEAU_PULSES
    return Estimate(float(found[0]), std, "us") if clear else None
