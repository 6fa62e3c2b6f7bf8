"""Numbers of the ESC out of wheels that spun: where the motor begins to pull, where it ends.

    v' = K (p - P) - E (p - P) v - A - C v          p the pulse, P where the pull begins

holds for every pulse on one side of neutral, with K = E = 0 at neutral. Integrated twice it is
linear in K, KP, E, EP, A, C and in place and speed at the beginning of each stretch, so one
linear least-squares problem over all of them gives P. A steady speed alone could not: dry
friction A and the dead band would be the same thing.

Where the motor follows its pulses by a lag T, p + (b - p) e^(-(t - d)/T) stands for p, b the pulse
before and d the delay: T and d by nonlinear least squares around the linear ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq, curve_fit, least_squares

from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import Estimate, FloatArray

from .spin import Spin

SETTLE = 0.08
"""s after a change of the pulse: two PWM frames, and what the ESC takes to believe it."""
ROLLS = 0.2
"""s after which a motor of any lag T has let go at neutral: a pull of twice the dead band has come
down to it after 0.7 T and the delay; once T is known SETTLE + T do."""
LAG_FROM = 0.025
"""s of lag from which it is fitted: of a shorter one SETTLE leaves a twentieth."""
LAGS, DELAYS = (0.005, 0.2), (-0.02, 0.1)
"""s, bounds; a delay counts from the State before the pulse, by which half a frame is known."""
LAG_GUESS = (0.05, 0.012)
"""s: lag, and a delay of half a PWM frame and a pulse."""
SLOW = 0.3
"""m/s below which dry friction is no constant and one edge takes 7 ms."""
LAW = 0.05
"""us, one sigma of what the law itself leaves: the friction of 20 us of pull to a quarter of a
per cent."""
LATE_LAW = 0.4
"""us, the same with a lag: two of ten simulated cars were off by 0.4 and 0.7 us at a jackknife of
0.2, in both directions alike, which it cannot see."""
FEW = 8
"""Points of a stretch that say something about its curvature."""
VAGUE = 2.5
"""us, half a count of the PCA9685: known less well, a neutral is no better than 1500."""
SHARP = 5.0
"""us, one sigma of a knee that counts as found."""
PLATEAU = 3
"""Pulses beyond the knee, at least."""


@dataclass(frozen=True, slots=True)
class Force:
    """Where the pull begins [us] of one direction; friction a [m/s2] and c [1/s] of the wheels.

    pull [m/s2 per us], against neutral negative; rms [m] of what is left; lag [s] of the motor,
    0 where there is none to speak of.
    """

    begin: Estimate
    pull: float
    a: float
    c: float
    rms: float
    lag: float = 0.0

    def coasting(self, fast: float, slow: float, drag: float = 0.0) -> float:
        """s from one speed [m/s] to another without a pull, and without a ``drag`` [m/s2] of a."""
        c, a = max(self.c, 1e-6), self.a - drag
        return math.log((a + c * fast) / (a + c * slow)) / c

    def drag(self, fast: float, slow: float, seconds: float) -> float:
        """How much of a [m/s2] is missing where that took so many s instead."""
        return float(brentq(lambda drag: self.coasting(fast, slow, drag) - seconds,
                            -3.0 * self.a, 0.95 * self.a))

    def without(self, drag: Estimate) -> Estimate:
        """Where the pull begins if ``drag`` of the friction was a brake at neutral."""
        return Estimate(self.begin.value + drag.value / self.pull,
                        math.hypot(self.begin.std, drag.std / self.pull), self.begin.unit)


@dataclass(frozen=True, slots=True)
class Stretch:
    """One pulse held: t [s] since the State before it; way x [m], its integral [m s] and its
    slope [m/s] over s = t - t[0] (n,); start (n, 2): place and speed at the beginning, orthonormal.

    p [100 us] beyond the reference, away from neutral as ``pulls`` is +-1 or at neutral 0; jump
    [100 us]: how much further the pulse before it was.
    """

    t: FloatArray
    x: FloatArray
    travelled: FloatArray
    speed: FloatArray
    start: FloatArray
    p: float
    jump: float
    pulls: float


@dataclass(frozen=True, slots=True)
class Law:
    """What one solution says: P from the reference [100 us, away from neutral], A, C, K [per
    100 us], rms [m], (lag, delay) [s] of the motor."""

    begin: float
    a: float
    c: float
    pull: float
    rms: float
    late: tuple[float, float]


def pull_begins(spins: Sequence[Spin], neutral: float) -> Force:
    """Fit the stretches of one direction, as they were driven one after the other.

    The standard error is a jackknife over stretches: friction differs from one to the next.
    Errors: CalibrationFailed where they say too little.
    """
    reference = min((s.pulse_us for s in spins if s.pulse_us != neutral),
                    key=lambda p: abs(p - neutral), default=neutral)
    parts, late = _stretches(spins, neutral, reference, SETTLE), (0.0, 0.0)
    if not _enough(parts):
        raise CalibrationFailed("the wheels turned too little to say where the motor begins",
                                found=f"{len(parts)} stretches above {SLOW} m/s",
                                expected=f"{len(spins)}",
                                likely="something brakes the wheels, or the encoder loses edges",
                                remedy="dart-hal doctor; run it again")
    after = _stretches(spins, neutral, reference, ROLLS)[1:]
    if _enough(after) and _follows_late(after):
        fitted = _lagging(after, LAG_GUESS).late
        if fitted[0] > LAG_FROM:
            parts, late = _stretches(spins, neutral, reference, SETTLE + fitted[0])[1:], fitted
    whole = _lagging(parts, late)
    left = np.array([_lagging(parts[:k] + parts[k + 1:], whole.late).begin
                     for k in range(len(parts))])
    n = len(parts)
    std = math.sqrt((n - 1) / n * float(np.sum((left - left.mean()) ** 2)))
    away = 100.0 if reference > neutral else -100.0
    if not (100.0 * std <= VAGUE and whole.a > 0.0):
        raise CalibrationFailed(
            "the wheels do not speed up and slow down alike from one time to the next",
            found=f"the motor begins to pull within {100.0 * std:.1f} us (one sigma), friction "
                  f"{whole.a:.1f} m/s2",
            expected=f"{VAGUE} us, and a friction that slows down",
            likely="the encoder loses edges, a wheel rubs, or the battery is nearly empty",
            remedy="dart-hal doctor; run it again")
    law = LATE_LAW if late[0] else LAW
    begin = Estimate(reference + away * whole.begin, math.hypot(100.0 * std, law), "us")
    return Force(begin, whole.pull / away, whole.a, whole.c, whole.rms, whole.late[0])


def _enough(parts: Sequence[Stretch]) -> bool:
    return len(parts) >= 6 and len({part.p for part in parts if part.pulls}) >= 2


def _follows_late(parts: Sequence[Stretch]) -> bool:
    """Whether a little lag explains the travel better than none."""
    little, none = (_solve(parts, (lag, LAG_GUESS[1]))[1] for lag in (LAG_FROM, 0.0))
    return bool(little @ little < none @ none)


def _stretches(spins: Sequence[Spin], neutral: float, reference: float, rolls: float
               ) -> list[Stretch]:
    """Those that say something; of a stretch at neutral the first ``rolls`` [s] are left out."""
    found = []
    for k, spin in enumerate(spins):
        on = 0.0 if spin.pulse_us == neutral else 1.0 if spin.pulse_us > neutral else -1.0
        turning = _turning(spin.after(SETTLE if on else rolls))
        if turning is None:
            continue
        t, x = turning
        way = CubicSpline(t - t[0], x - x[0])
        before = spins[k - 1].pulse_us if k else neutral
        found.append(Stretch(
            t, x - x[0], np.asarray(way.antiderivative()(t - t[0])),
            np.asarray(way.derivative()(t - t[0])),
            np.linalg.qr(np.stack([np.ones_like(t), t - t[0]], axis=1))[0],
            on * (spin.pulse_us - reference) / 100.0,
            on * (before - spin.pulse_us) / 100.0, abs(on)))
    return found


def _turning(spin: Spin) -> tuple[FloatArray, FloatArray] | None:
    """(t, x) from where the wheels turn until they no longer do."""
    t, x = spin.t, spin.x
    if len(t) < FEW:
        return None
    speed = np.gradient(x, t)
    slow = np.flatnonzero(speed < SLOW)
    begin = int(np.argmax(speed >= SLOW)) if slow.size and slow[0] == 0 else 0
    ends = slow[slow > begin]
    end = int(ends[0]) if ends.size else len(t)
    return (t[begin:end], x[begin:end]) if end - begin >= FEW else None


def _rows(part: Stretch, late: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """(columns of K, KP, E, EP, A, C; travel), freed from place and speed at the beginning."""
    s, pulls = part.t - part.t[0], part.pulls
    half = 0.5 * s**2
    force, loss = part.p * half, -part.p * part.travelled
    lag, delay = late
    if lag and part.jump:
        tail, e = part.jump * math.exp((delay - part.t[0]) / lag), np.exp(-s / lag)
        force = force + tail * lag * (s - lag * (1.0 - e))
        slower = cumulative_trapezoid(e * part.speed, s, initial=0.0)
        loss = loss - tail * cumulative_trapezoid(slower, s, initial=0.0)
    columns = np.stack([force, -pulls * half, loss, pulls * part.travelled, -half,
                        -part.travelled], axis=1)
    q = part.start
    return columns - q @ (q.T @ columns), part.x - q @ (q.T @ part.x)


def _lagging(parts: Sequence[Stretch], start: tuple[float, float]) -> Law:
    """The best law, lag and delay from ``start`` on; (0, 0): without."""
    late = start
    if start[0]:
        low, high = np.array([LAGS, DELAYS]).T
        best = least_squares(lambda p: 1e3 * _solve(parts, (p[0], p[1]))[1], start,
                             bounds=(low, high), x_scale=LAG_GUESS, diff_step=1e-3)
        late = float(best.x[0]), float(best.x[1])
    found, left = _solve(parts, late)
    return Law(float(found[1] / found[0]), float(found[4]), float(found[5]), float(found[0]),
               float(np.sqrt(np.mean(left**2))), late)


def _solve(parts: Sequence[Stretch], late: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """(K, KP, E, EP, A, C; what is left of the travel [m])."""
    rows = [_rows(part, late) for part in parts]
    columns = np.concatenate([c for c, _ in rows])
    travel = np.concatenate([x for _, x in rows])
    scale = np.linalg.norm(columns, axis=0)
    found = np.linalg.lstsq(columns / scale, travel, rcond=None)[0] / scale
    return np.asarray(found), np.asarray(travel - columns @ found)


def knee(pulses: FloatArray, speeds: FloatArray) -> Estimate | None:
    """The pulse [us] from which on the speed no longer rises; None if it rises to the end.

    Below it the speed is (a p + b) / (1 + c p), which is what motor and friction make of v' = 0.
    """
    middle, width = float(pulses.mean()), float(np.ptp(pulses))

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
    return Estimate(float(found[0]), std, "us") if std < SHARP and beyond >= PLATEAU else None
