"""From a pulse of the ESC to the force of the wheels: pure delay and first-order lag.

The car is pulled in steps of the throttle x. Its motion is

    v' = A T(y) + B T(y) v + C + D v + E v^2 + F v^4        y' = (x(t - delay) - y) / lag

T is the motor's dead band, which ends at g; E and F are what the tyres take in a bend:
slip angles go with v^2, and the yaw rate times v_y with v^4 by them. Integrated twice it is
linear in everything but delay, lag and g, so these are all that is searched (variable projection;
G. Golub and V. Pereyra, 1973). Each step has a start and a speed of its own. The data are where the
ring's edges were, and the ring's own unevenness is fitted with them, one number for each edge of a
revolution.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.motor import make_dead_band

from .latency_fit import Problem, fit_lag
from .latency_log import Traffic, not_following
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


def fit_wheel(grid: Grid, traffic: Traffic, starts: FloatArray, throttle: tuple[float, float],
              metres: float, edges_per_rev: int) -> Pull:
    """throttle: neutral and span [us]; starts (k,) [s]: when each repetition was begun; metres [m]
    per edge.

    Errors: CalibrationFailed where the speed does not follow the throttle.
    """
    steps = _steps(grid, traffic, starts, metres, edges_per_rev)
    t = np.arange(steps.t[0] - 1.0, steps.t[-1] + DT, DT)
    x = (held(grid, traffic, t) - throttle[0]) / throttle[1]
    motion = Motion.of(steps, t, x, edges_per_rev)
    _check_follows(steps, motion.speed, t)
    found, shows = fit_lag(Problem(
        motion.residual, start=np.array([0.01, 0.03, DEAD_BAND[0]]),
        low=np.array([-0.05, 0.0, -0.3]), high=np.array([LONGEST_DELAY, LONGEST_LAG, -0.02]),
        steps=np.full(3, 1e-3), known=np.array([np.inf, np.inf, DEAD_BAND[1]]), noise=NOISE,
        cluster=steps.cluster), lag=1, least=HIDDEN_LAG)
    delay, lag = ((float(found.x[k]), float(np.hypot(found.std[k], MODEL))) for k in range(2))
    return Pull(delay, lag if shows else (0.0, 0.5 * HIDDEN_LAG), found.left)


@dataclass(frozen=True, slots=True)
class Motion:
    """Steps on a grid t (n,) [s]: throttle x (n,), speed (n,) [m/s]; where each step begins on it.

    fixed (m, k): orthonormal, what the places of the edges owe to everything but the motor;
    left (m,): what that leaves of them.
    """

    steps: Steps
    t: FloatArray
    x: FloatArray
    speed: FloatArray
    begin: IntArray
    fixed: FloatArray
    left: FloatArray

    @classmethod
    def of(cls, steps: Steps, t: FloatArray, x: FloatArray, edges_per_rev: int) -> Motion:
        speed = np.gradient(np.interp(t, *_smooth(steps, edges_per_rev)), DT)
        bare = cls(steps, t, x, speed, np.searchsorted(t, steps.starts), np.zeros((0, 0)),
                   np.zeros(0))
        fixed, _ = np.linalg.qr(bare._owed(edges_per_rev))
        return replace(bare, fixed=fixed, left=steps.place - fixed @ (fixed.T @ steps.place))

    def residual(self, p: FloatArray) -> FloatArray:
        """What delay, lag [s] and dead band p (3,) leave of the places [m]."""
        z = make_dead_band(float(p[2]), np)(self._pulled(float(p[0]), abs(float(p[1]))))
        moved = np.column_stack([self._twice(z), self._twice(z * self.speed)])
        moved -= self.fixed @ (self.fixed.T @ moved)
        best, *_ = np.linalg.lstsq(moved, self.left, rcond=None)
        return np.asarray(self.left - moved @ best)

    def _owed(self, edges_per_rev: int) -> FloatArray:
        """Columns: start and speed of each step, each mark of the ring, C, D v, E v^2, F v^4."""
        s, since = self.steps, self._since
        own = np.zeros((len(s.t), 2 * len(self.begin)))
        own[np.arange(len(s.t)), 2 * s.cluster] = 1.0
        own[np.arange(len(s.t)), 2 * s.cluster + 1] = since
        ring = np.eye(edges_per_rev)[s.ring][:, 1:]
        place, b = np.interp(self.t, s.t, s.place), self.begin[s.cluster]
        path = _integral(place)
        along = np.interp(s.t, self.t, path) - path[b] - place[b] * since
        bend = [self._twice(self.speed**power) for power in (2, 4)]
        return np.column_stack([own, ring, 0.5 * since**2, along, *bend])

    @property
    def _since(self) -> FloatArray:
        return np.asarray(self.steps.t - self.t[self.begin][self.steps.cluster])

    def _pulled(self, delay: float, lag: float) -> FloatArray:
        """y of the grid."""
        from scipy.signal import lfilter

        share = -np.expm1(-DT / lag) if lag > 1e-4 else 1.0
        y = lfilter([share], [1.0, share - 1.0], self.x, zi=[(1.0 - share) * self.x[0]])[0]
        return np.asarray(np.interp(self.t - delay, self.t, y))

    def _twice(self, f: FloatArray) -> FloatArray:
        """Integral of the integral at the edges, from each repetition's start."""
        once, b = _integral(f), self.begin[self.steps.cluster]
        both = _integral(once)
        return np.asarray(np.interp(self.steps.t, self.t, both) - both[b] - once[b] * self._since)


def held(grid: Grid, traffic: Traffic, t: FloatArray) -> FloatArray:
    """The pulse [us] that the ESC knew, on the mean of the ``DT`` around each t (n,) [s].

    A pulse that ends between two points of the grid counts for its share.
    """
    ends, widths = grid.pulses(traffic.written[:, 0], traffic.written[:, 2])
    past = np.concatenate([[0.0], np.cumsum(widths[:-1] * np.diff(ends))])
    borders = np.append(t - 0.5 * DT, t[-1] + 0.5 * DT)
    last = np.maximum(np.searchsorted(ends, borders, side="right") - 1, 0)
    return np.asarray(np.diff(past[last] + widths[last] * (borders - ends[last])) / DT)


def _integral(f: FloatArray) -> FloatArray:
    """Of f on the grid, from its first point."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (f[1:] + f[:-1])) * DT])


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
    edge_t, ticks = traffic.edges
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
        raise not_following(
            "speed", "throttle", float(np.median(spans)), WEAK, "m/s",
            "the wheels are held, the battery is empty, or the ESC limits its power",
            "free the wheels, charge the battery, run it again")
