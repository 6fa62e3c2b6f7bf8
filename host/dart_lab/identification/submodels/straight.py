"""Friction, motor and throttle timing, by simulating the speed of straight driving.

    m dv/dt = F_m(tau, v) + F_f(v)
    F_m = (d - e v) T(tau + g),  T: smooth max(0, .)
    F_f = -(a tanh(b v) + (c + q |v|) v)

tau is delayed and lagged. The residual compares what the sensor reads (the encoder: the mean of
the last 0.1 s; the mocap: its derivative's window), not a derivative of a quantised speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle import Vehicle, make_friction, make_motor_gains
from dart_hal.vehicle.fitting.batches import student_factor
from dart_hal.vehicle.fitting.covariance import (
    collinearity,
    enclosing_covariance,
    leverage_covariance,
    plain_covariance,
)
from dart_hal.vehicle.fitting.free_starts import FreeStarts, fit_free_starts
from dart_hal.vehicle.scale import find_scale
from dart_lab.identification.submodels.speeds import Speeds
from dart_lab.identification.submodels.stretches import Stretches

STRAIGHT_NAMES = ("a", "b", "c", "d", "e", "g", "throttle_s", "throttle_lag_s")
# Units by which the parameters scale with the car; times and dead band do not.
SCALING_UNITS = ("N", "s/m", "N s/m", "N", "N s/m", "-", "-", "-")
# Bounds for a car of 1:10.
LOWER_BOUNDS = np.array([0.05, 1.0, 0.0, 1.0, 0.0, -0.5, -0.15, 0.0])
UPPER_BOUNDS = np.array([10.0, 40.0, 5.0, 150.0, 50.0, 0.0, 0.4, 0.5])
# Steps of the numerical derivatives.
SLOPE_STEPS = np.array([1e-4, 1e-3, 1e-4, 1e-3, 1e-3, 1e-5, 0.002, 0.002])
# 1 for the parameters that scale with the mass.
SCALES_WITH_MASS = np.array([1.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class StraightFit:
    """Parameters of straight driving: ``free`` were fitted, the others are fixed.

    x (8,) in the order of STRAIGHT_NAMES; covariance (8, 8), 0 where fixed; independent (8,) as
    ``collinearity``, 1 where fixed; residual (n,) [m/s]; stopped: parameters at a bound;
    sessions: number of sessions that were fitted.
    """

    free: tuple[str, ...]
    x: FloatArray
    covariance: FloatArray
    independent: FloatArray
    residual: FloatArray
    converged: bool
    stopped: tuple[str, ...]
    sessions: int = 1

    @property
    def rmse(self) -> float:
        """Root mean square of the residuals [m/s]."""
        return float(np.sqrt(np.mean(self.residual**2)))

    def value(self, name: str) -> float:
        """Return the value of a parameter."""
        return float(self.x[STRAIGHT_NAMES.index(name)])

    def std(self, name: str) -> float:
        """Return the standard error of a parameter; 0 if it was fixed."""
        i = STRAIGHT_NAMES.index(name)
        return float(np.sqrt(max(self.covariance[i, i], 0.0)))

    def at_bound(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return which of ``names`` stopped at a bound."""
        return tuple(n for n in names if n in self.stopped)

    def with_mass(self, mass: float, std: float) -> StraightFit:
        """Add the error of the mass [kg] to the covariance of all fitted forces."""
        fitted = np.isin(STRAIGHT_NAMES, self.free)
        scaling = np.where(fitted, SCALES_WITH_MASS * self.x, 0.0) * std / mass
        return replace(self, covariance=self.covariance + np.outer(scaling, scaling))


def solve_straight(series: Sequence[Speeds], s: Stretches, base: Vehicle, x0: FloatArray,
                   free: Sequence[str], mass: float, session: IntArray | None = None
                   ) -> StraightFit:
    """Fit the ``free`` parameters from x0 (8,); mass [kg] scales the forces.

    q and the reverse gain are those of ``base``. session (n,) of each sample:
    the errors are no smaller than what leaving out whole sessions changes.
    """
    rows = [STRAIGHT_NAMES.index(n) for n in free]
    solution, _ = fit_free_starts(make_problem(series, s, base, x0, free, mass), x0[rows],
                                  first_speeds(s))
    x = x0.copy()
    x[rows] = solution.x
    covariance = np.zeros((len(STRAIGHT_NAMES), len(STRAIGHT_NAMES)))
    own = enclosing_covariance(leverage_covariance(solution, s.block), plain_covariance(solution))
    if session is not None:
        own = enclosing_covariance(own, leverage_covariance(solution, session))
    covariance[np.ix_(rows, rows)] = own * student_factor(len(np.unique(s.block)))**2
    independent = np.ones(len(STRAIGHT_NAMES))
    independent[rows] = collinearity(solution)
    stopped = tuple(n for n, edge in zip(free, solution.at_bound, strict=True) if edge)
    return StraightFit(tuple(free), x, covariance, independent, solution.residual,
                       solution.converged, stopped)


def first_speeds(s: Stretches) -> FloatArray:
    """Return the measured speed (S,) [m/s] at the start of every stretch."""
    return s.v[np.searchsorted(s.stretch, np.arange(len(s)))]


def make_problem(series: Sequence[Speeds], s: Stretches, base: Vehicle, x0: FloatArray,
                 free: Sequence[str], mass: float, group: IntArray | None = None) -> FreeStarts:
    """Make the least-squares problem of the ``free`` parameters, the others as in x0 (8,).

    group (S,) 0..G-1 of each stretch: parameters are then ``free`` and G dead bands g.
    """
    rows = [STRAIGHT_NAMES.index(n) for n in free]
    known = None if set(free) & set(STRAIGHT_NAMES[6:]) else throttle_at(series, s, x0[6:7], x0[7:])

    def predict(p: FloatArray, starts: FloatArray) -> FloatArray:
        full = np.tile(x0, (len(p), 1))
        full[:, rows] = p[:, :len(rows)]
        g = None if group is None else p[:, len(rows) + group]
        with np.errstate(over="ignore", invalid="ignore"):
            # Trial steps that overflow become large residuals, not NaN.
            return np.nan_to_num(simulate(series, s, base, full, starts, mass, g, known),
                                 nan=1e3, posinf=1e3, neginf=-1e3)

    bands = 0 if group is None else int(group.max()) + 1
    rows_all = rows + [STRAIGHT_NAMES.index("g")] * bands
    scale = find_scale(base.body)
    size = np.array([scale.factor(unit) for unit in SCALING_UNITS])
    low, high, step = ((size * limit)[rows_all]
                       for limit in (LOWER_BOUNDS, UPPER_BOUNDS, SLOPE_STEPS))
    return FreeStarts(predict, s.v, s.stretch, low, high, step,
                      None if group is None else group[s.stretch])


def simulate(series: Sequence[Speeds], s: Stretches, base: Vehicle, p: FloatArray,
             starts: FloatArray, mass: float, g: FloatArray | None = None,
             throttle: FloatArray | None = None) -> FloatArray:
    """Simulate the readings (P, n) [m/s] for parameters p (P, 8), start speeds (P, S) [m/s].

    g: dead band (P, S) of every stretch instead of that in p; throttle (1, S,
    steps) at the motor, if it is known.
    """
    columns = {n: p[:, i, None] for i, n in enumerate(STRAIGHT_NAMES)}
    friction = make_friction(_bundle(columns, "abc", q=base.friction.q), np)
    if g is not None:
        columns["g"] = g
    gains = make_motor_gains(_bundle({n: v[..., None] for n, v in columns.items()}, "deg",
                                     reverse=base.duty_motor.reverse), np)
    push, drag = gains(throttle_at(series, s, p[:, 6], p[:, 7]) if throttle is None else throttle)
    push = np.moveaxis(push / mass, -1, 0)
    drag = np.moveaxis(drag / mass, -1, 0)
    # Midpoint rule: v' at v gives the speed in the middle, whose v' advances the step. The distance
    # is that of the middle speed, so that readings are differences of exact distances.
    v = np.array(np.broadcast_to(starts, (len(p), len(s))))
    distance = np.zeros((*v.shape, s.steps + 1))
    for i in range(s.steps):
        rate = push[i] - drag[i] * v + friction(v) / mass
        middle = v + 0.5 * SAMPLE * rate
        v = v + SAMPLE * (push[i] - drag[i] * middle + friction(middle) / mass)
        distance[..., i + 1] = distance[..., i] + SAMPLE * middle
    return s.reading(distance)


def _bundle(columns: dict[str, FloatArray], names: str, **more: float) -> Any:
    """Bundle arrays of parameters with the attributes of the vehicle's dataclasses."""
    return SimpleNamespace(**{n: columns[n] for n in names}, **more)


def throttle_at(series: Sequence[Speeds], s: Stretches, delay: FloatArray, lag: FloatArray
                ) -> FloatArray:
    """Return the throttle (P, S, steps) at the motor for delays and lags (P,) [s]."""
    # Variants that differ in other parameters share delay and lag: compute each pair once.
    pairs, index = np.unique(np.stack([delay, lag], axis=1), axis=0, return_inverse=True)
    out = np.empty((len(pairs), len(s), s.steps))
    for j, (one_delay, one_lag) in enumerate(pairs):
        for r, recording in enumerate(series):
            mine = np.flatnonzero(s.series == r)
            if not len(mine):
                continue
            stairs = recording.throttle
            begin = float(stairs.t[0])
            n = int(np.ceil((float(s.start[mine].max()) - begin) / SAMPLE)) + s.steps + 1
            grid = stairs.on_grid(begin, max(n, 1), float(one_delay), float(one_lag))
            out[j, mine] = _resample(grid, (s.start[mine] - begin) / SAMPLE, s.steps)
    return np.asarray(out[np.reshape(index, -1)])


def _resample(grid: FloatArray, place: FloatArray, steps: int) -> FloatArray:
    """Interpolate the means (S, steps) of steps that begin at positions ``place`` (S,)."""
    whole = np.floor(place).astype(np.int64)
    part = (place - whole)[:, None]
    at = whole[:, None] + np.arange(steps + 1)
    cells = grid[np.clip(at, 0, len(grid) - 1)]
    return np.asarray((1.0 - part) * cells[:, :-1] + part * cells[:, 1:])
