"""From a pulse of the ESC to the force of the wheels: pure delay and first-order lag.

The car is pulled in steps of the throttle x. Its motion is

    v' = A T(y) + B T(y) v + C + D v + E v^2        y' = (x(t - delay) - y) / lag

T is the motor's dead band, which ends at g; E is what the tyres take in a bend. Integrated twice
it is linear in everything but delay, lag and g, so these are all that is searched (variable
projection; G. Golub and V. Pereyra, 1973). Each step has a start and a speed of its own. The data
are where the ring's edges were, and the ring's own unevenness is fitted with them, one number for
each edge of a revolution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.errors import CalibrationFailed
from dart_hal.types import FloatArray, IntArray
from dart_hal.vehicle.motor import make_dead_band

from .latency_fit import fit_clusters
from .latency_log import Traffic
from .latency_pulse import Grid

DT = 1e-3
"""s of the grid on which a step is integrated."""
BEFORE = 0.15
"""s of the step before that belong to a repetition."""
LONGEST_DELAY, LONGEST_LAG = 0.4, 0.5
"""s; cars answer within 0.2."""
DEAD_BAND = (-0.15, 0.03)
"""g of published cars and one sigma of it, with a neutral that nobody has measured."""
NOISE = 3e-5
"""m, of an edge's place, once the ring's unevenness is known."""
JUMP_US, FEWEST = 15.0, 6
"""us that are a step and no rounding; repetitions from which a spread can be told."""
HIDDEN_LAG, MODEL = 0.010, 0.001
"""s: a shorter lag cannot be told from a delay, and is counted as such; and one sigma of what the
car does in a bend beyond the model."""
WEAK = 0.05
"""m/s by which each step must change the speed."""


@dataclass(frozen=True, slots=True)
class Pull:
    """delay and lag [s] of the force, each with one sigma; rms left of the edges' places [m]."""

    delay: tuple[float, float]
    lag: tuple[float, float]
    left: float


@dataclass(frozen=True, slots=True)
class Steps:
    """t (m,) [s] and place (m,) [m] of edges, their place in the ring, and their repetition."""

    t: FloatArray
    place: FloatArray
    ring: IntArray
    cluster: IntArray
    starts: FloatArray
    ends: FloatArray


def held(grid: Grid, traffic: Traffic, column: int, t: FloatArray) -> FloatArray:
    """The pulse [us] that servo (1) or ESC (2) knew at t (n,) [s]."""
    ends, widths = grid.pulses(traffic.written[:, 0], traffic.written[:, column])
    return np.asarray(widths[np.maximum(np.searchsorted(ends, t, side="right") - 1, 0)])


def fit_wheel(grid: Grid, traffic: Traffic, starts: FloatArray, throttle: tuple[float, float],
              metres: float, edges_per_rev: int) -> Pull:
    """throttle: neutral and span [us]; starts (k,) [s]: when each repetition was begun; metres [m]
    per edge.

    Errors: CalibrationFailed where the speed does not follow the throttle.
    """
    from scipy.signal import lfilter

    steps = _steps(grid, traffic, starts, metres, edges_per_rev)
    t = np.arange(steps.t[0] - 1.0, steps.t[-1] + DT, DT)
    pulse = held(grid, traffic, 2, t)
    x = (pulse - throttle[0]) / throttle[1]
    place = np.interp(t, steps.t, steps.place)
    speed = np.gradient(np.interp(t, *_smooth(steps, edges_per_rev)), DT)
    _check_follows(steps, speed, t)
    begin = np.searchsorted(t, steps.starts)

    def pulled(delay: float, lag: float) -> FloatArray:
        share = -np.expm1(-DT / lag) if lag > 1e-4 else 1.0
        y = lfilter([share], [1.0, share - 1.0], x, zi=[(1.0 - share) * x[0]])[0]
        return np.asarray(np.interp(t - delay, t, y))

    def twice(f: FloatArray) -> FloatArray:
        """Integral of the integral at the edges, from each repetition's start."""
        once = np.concatenate([[0.0], np.cumsum(0.5 * (f[1:] + f[:-1])) * DT])
        both = np.concatenate([[0.0], np.cumsum(0.5 * (once[1:] + once[:-1])) * DT])
        since = steps.t - t[begin][steps.cluster]
        b = begin[steps.cluster]
        return np.asarray(np.interp(steps.t, t, both) - both[b] - once[b] * since)

    since = steps.t - t[begin][steps.cluster]
    own = np.zeros((len(steps.t), 2 * len(begin)))
    own[np.arange(len(steps.t)), 2 * steps.cluster] = 1.0
    own[np.arange(len(steps.t)), 2 * steps.cluster + 1] = since
    ring = np.eye(edges_per_rev)[steps.ring][:, 1:]
    path = np.concatenate([[0.0], np.cumsum(0.5 * (place[1:] + place[:-1])) * DT])
    b = begin[steps.cluster]
    along = np.interp(steps.t, t, path) - path[b] - place[b] * since
    fixed, _ = np.linalg.qr(np.column_stack([own, ring, 0.5 * since**2, along, twice(speed**2)]))
    left = steps.place - fixed @ (fixed.T @ steps.place)

    def residual(p: FloatArray) -> FloatArray:
        z = make_dead_band(float(p[2]), np)(pulled(float(p[0]), abs(float(p[1]))))
        moved = np.column_stack([twice(z), twice(z * speed)])
        moved -= fixed @ (fixed.T @ moved)
        best, *_ = np.linalg.lstsq(moved, left, rcond=None)
        known = (p[2] - DEAD_BAND[0]) / DEAD_BAND[1]
        return np.append(left - moved @ best, known * NOISE)

    low, high = np.array([-0.05, 0.0, -0.3]), np.array([LONGEST_DELAY, LONGEST_LAG, -0.02])
    start, by = np.array([0.01, 0.03, DEAD_BAND[0]]), np.full(3, 1e-3)
    found = fit_clusters(residual, start, low, high, steps.cluster, by, 1, NOISE)
    hidden = found.x[1] < HIDDEN_LAG
    if hidden:
        high[1], start[1], by[1] = 2e-5, 1e-5, 1e-5
        found = fit_clusters(residual, start, low, high, steps.cluster, by, 1, NOISE)
    delay = float(found.x[0]), float(np.hypot(found.std[0], MODEL))
    lag = float(found.x[1]), float(np.hypot(found.std[1], MODEL))
    return Pull(delay, (0.0, 0.5 * HIDDEN_LAG) if hidden else lag, found.left)


def sure_steps(grid: Grid, traffic: Traffic, column: int, begin: FloatArray) -> IntArray:
    """Those repetitions in which it is known which PWM frame carried each step.

    Errors: CalibrationFailed if there are too few.
    """
    t, width = traffic.written[:, 0], traffic.written[:, column]
    jumps = np.abs(np.diff(width, prepend=width[0])) > JUMP_US
    near = t[np.logical_and(jumps, grid.doubtful(t))]
    unsure = np.unique(np.searchsorted(begin, near, side="right") - 1)
    sure = np.setdiff1d(np.arange(len(begin) - 1), unsure)
    if len(sure) < FEWEST:
        raise CalibrationFailed(
            "the commands came together with the PWM frames", found=f"{len(sure)} clear steps",
            expected=f"at least {FEWEST} of {len(begin) - 1}",
            likely="frames of the Nano and of the PCA9685 run in step at the moment",
            remedy="run it again")
    return sure


def _steps(grid: Grid, traffic: Traffic, starts: FloatArray, metres: float, edges_per_rev: int
           ) -> Steps:
    """Edges of whole repetitions, each seen once."""
    edge_t, ticks = traffic.column("edge_t"), traffic.column("ticks")
    fresh = np.flatnonzero(np.diff(ticks, prepend=ticks[0] - 1) > 0)
    edge_t, ticks = edge_t[fresh], ticks[fresh]
    begin = starts - BEFORE
    of = np.searchsorted(begin, edge_t, side="right") - 1
    kept = (of >= 0) & (of < len(starts) - 1) & np.isin(of, sure_steps(grid, traffic, 2, begin))
    cluster = np.unique(of[kept], return_inverse=True)
    return Steps(edge_t[kept], (ticks[kept] - ticks[kept][0]) * metres,
                 ticks[kept].astype(np.int64) % edges_per_rev, cluster[1], begin[cluster[0]],
                 begin[cluster[0] + 1])


def _smooth(steps: Steps, edges_per_rev: int) -> tuple[FloatArray, FloatArray]:
    """Places (t, s) half a revolution apart: a speed without the ring, good enough for B y v."""
    places = np.arange(0.0, steps.place[-1], 0.5 * edges_per_rev * float(
        np.min(np.diff(np.unique(steps.place)))))
    return np.interp(places, steps.place, steps.t), places


def _check_follows(steps: Steps, speed: FloatArray, t: FloatArray) -> None:
    spans = [np.ptp(speed[(t > a) & (t < b)]) for a, b in zip(
        steps.starts, steps.ends, strict=True)]
    if np.median(spans) < WEAK:
        raise CalibrationFailed(
            "the speed does not follow the throttle", found=f"{np.median(spans):.3f} m/s each step",
            expected=f"more than {WEAK} m/s",
            likely="the wheels are held, the battery is empty, or the ESC limits its power",
            remedy="free the wheels, charge the battery, run it again")
