"""Numbers of the ESC out of wheels that spun: where the motor begins to pull, where it ends.

    v' = K (p - P) - E (p - P) v - A - C v          p the pulse, P where the pull begins

holds for every pulse on one side of neutral, with K = E = 0 at neutral. Integrated twice it is
linear in K, KP, E, EP, A, C and in place and speed at the beginning of each stretch, so one
linear least-squares problem over all of them gives P. A steady speed alone could not: dry
friction A and the dead band would be the same thing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq, curve_fit

from dart_hal.errors import CalibrationFailed
from dart_hal.types import Estimate, FloatArray

from .spin import Spin

SETTLE = 0.08
"""s after a change of the pulse: two PWM frames, and what the ESC takes to believe it."""
SLOW = 0.3
"""m/s below which dry friction is no constant and one edge takes 7 ms."""
LAW = 0.05
"""us, one sigma of what the law itself leaves: the friction of 20 us of pull to a quarter of a
per cent."""
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

    pull [m/s2 per us], against neutral negative; rms [m] of what is left.
    """

    begin: Estimate
    pull: float
    a: float
    c: float
    rms: float

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


def pull_begins(spins: Sequence[Spin], neutral: float) -> Force:
    """Fit the stretches of one direction. Errors: CalibrationFailed where they say too little.

    The standard error is a jackknife over stretches: friction differs from one to the next.
    """
    reference = min((s.pulse_us for s in spins if s.pulse_us != neutral),
                    key=lambda p: abs(p - neutral), default=neutral)
    parts = [rows for s in spins if (rows := _rows(s, neutral, reference)) is not None]
    pulses = {s.pulse_us for s in spins if s.pulse_us != neutral}
    if len(parts) < 6 or len(pulses) < 2:
        raise CalibrationFailed("the wheels turned too little to say where the motor begins",
                                found=f"{len(parts)} stretches above {SLOW} m/s",
                                expected=f"{len(spins)}",
                                likely="something brakes the wheels, or the encoder loses edges",
                                remedy="dart-hal doctor; run it again")
    whole, rms = _solve(parts)
    left = np.array([_solve(parts[:k] + parts[k + 1:])[0][0] for k in range(len(parts))])
    n = len(parts)
    std = math.sqrt((n - 1) / n * float(np.sum((left - left.mean()) ** 2)))
    away = 100.0 if reference > neutral else -100.0
    if 100.0 * std > VAGUE or whole[1] <= 0.0:
        raise CalibrationFailed(
            "the wheels do not speed up and slow down alike from one time to the next",
            found=f"the motor begins to pull within {100.0 * std:.1f} us (one sigma), friction "
                  f"{whole[1]:.1f} m/s2",
            expected=f"{VAGUE} us, and a friction that slows down",
            likely="the encoder loses edges, a wheel rubs, the battery is nearly empty, or the "
                   "motor follows its pulses by more than 0.05 s late",
            remedy="dart-hal doctor; run it again")
    begin = Estimate(reference + away * whole[0], math.hypot(100.0 * std, LAW), "us")
    return Force(begin, whole[3] / away, whole[1], whole[2], rms)


def _rows(spin: Spin, neutral: float, reference: float) -> tuple[FloatArray, FloatArray] | None:
    """(columns of K, KP, E, EP, A, C; travel), freed from place and speed at the beginning."""
    late = spin.after(SETTLE)
    t, x = late.t, late.x
    if len(t) < FEW:
        return None
    speed = np.gradient(x, t)
    slow = np.flatnonzero(speed < SLOW)
    begin = int(np.argmax(speed >= SLOW)) if slow.size and slow[0] == 0 else 0
    ends = slow[slow > begin]
    end = int(ends[0]) if ends.size else len(t)
    t, x = t[begin:end], x[begin:end]
    if len(t) < FEW:
        return None
    t, x = t - t[0], x - x[0]
    travelled = np.asarray(CubicSpline(t, x).antiderivative()(t))
    on = 0.0 if spin.pulse_us == neutral else 1.0 if spin.pulse_us > neutral else -1.0
    p, half = on * (spin.pulse_us - reference) / 100.0, 0.5 * t**2
    pulls = abs(on)
    columns = np.stack([p * half, -pulls * half, -p * travelled, pulls * travelled, -half,
                        -travelled], axis=1)
    start = np.stack([np.ones_like(t), t], axis=1)
    q = np.linalg.qr(start)[0]
    return columns - q @ (q.T @ columns), x - q @ (q.T @ x)


def _solve(parts: Sequence[tuple[FloatArray, FloatArray]]
           ) -> tuple[tuple[float, float, float, float], float]:
    """((P from the reference [100 us, away from neutral], A, C, K [per 100 us]), rms [m])."""
    columns = np.concatenate([c for c, _ in parts])
    travel = np.concatenate([x for _, x in parts])
    scale = np.linalg.norm(columns, axis=0)
    found = np.linalg.lstsq(columns / scale, travel, rcond=None)[0] / scale
    rms = float(np.sqrt(np.mean((travel - columns @ found) ** 2)))
    return (float(found[1] / found[0]), float(found[4]), float(found[5]), float(found[0])), rms


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
