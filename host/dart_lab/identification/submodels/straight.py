"""Friction, motor and throttle timing, by simulating the speed of straight driving.

m dv/dt = F_m(tau, v) + F_f(v), tau delayed and lagged; what is compared is
what the sensor reads (the encoder the mean of the last 0.1 s, the mocap its
derivative's window), not a derivative of a quantised speed.
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
from dart_hal.vehicle.fitting.covariance import (
    collinearity,
    enclosing_covariance,
    leverage_covariance,
    plain_covariance,
)
from dart_hal.vehicle.fitting.free_starts import FreeStarts, fit_free_starts
from dart_lab.identification.submodels.speeds import Speeds
from dart_lab.identification.submodels.stretches import Stretches

NAMES = ("a", "b", "c", "d", "e", "g", "throttle_s", "throttle_lag_s")
LOW = np.array([0.05, 1.0, 0.0, 1.0, 0.0, -0.5, -0.15, 0.0])
HIGH = np.array([10.0, 40.0, 5.0, 150.0, 50.0, 0.0, 0.4, 0.5])
STEP = np.array([1e-4, 1e-3, 1e-4, 1e-3, 1e-3, 1e-5, 0.002, 0.002])
FORCE = np.array([1.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
"""Which parameters scale with the mass."""


@dataclass(frozen=True, slots=True)
class Straight:
    """x (8,) in the order of NAMES; ``free`` were fitted, the others held.

    covariance (8, 8), zero where held; independent (8,) as ``collinearity``, 1
    where held; residual (n,) m/s; ``stopped``: at the edge of their interval;
    sessions: how many it is the fit of.
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
        """Value of a parameter."""
        return float(self.x[NAMES.index(name)])

    def std(self, name: str) -> float:
        """One standard error; 0 where held."""
        i = NAMES.index(name)
        return float(np.sqrt(max(self.covariance[i, i], 0.0)))

    def at_bound(self, names: Sequence[str]) -> tuple[str, ...]:
        """Which of ``names`` stopped at the edge of their interval."""
        return tuple(n for n in names if n in self.stopped)

    def with_mass(self, mass: float, std: float) -> Straight:
        """The same with the error of the mass [kg] in all forces."""
        fitted = np.isin(NAMES, self.free)
        scaling = np.where(fitted, FORCE * self.x, 0.0) * std / mass
        return replace(self, covariance=self.covariance + np.outer(scaling, scaling))


def solve_straight(series: Sequence[Speeds], s: Stretches, base: Vehicle, x0: FloatArray,
                   free: Sequence[str], mass: float, session: IntArray | None = None
                   ) -> Straight:
    """Fit the ``free`` parameters from x0 (8,); mass [kg] scales the forces.

    q and the reverse gain are those of ``base``. session (n,) of each sample:
    the errors are no smaller than what leaving out whole sessions changes.
    """
    rows = [NAMES.index(n) for n in free]
    solution, _ = fit_free_starts(problem_of(series, s, base, x0, free, mass), x0[rows],
                                  first_speeds(s))
    x = x0.copy()
    x[rows] = solution.x
    covariance = np.zeros((len(NAMES), len(NAMES)))
    own = enclosing_covariance(leverage_covariance(solution, s.block), plain_covariance(solution))
    if session is not None:
        own = enclosing_covariance(own, leverage_covariance(solution, session))
    covariance[np.ix_(rows, rows)] = own
    independent = np.ones(len(NAMES))
    independent[rows] = collinearity(solution)
    stopped = tuple(n for n, edge in zip(free, solution.at_bound, strict=True) if edge)
    return Straight(tuple(free), x, covariance, independent, solution.residual,
                    solution.converged, stopped)


def first_speeds(s: Stretches) -> FloatArray:
    """Measured speed (S,) [m/s] at the start of every stretch."""
    return s.v[np.searchsorted(s.stretch, np.arange(len(s)))]


def problem_of(series: Sequence[Speeds], s: Stretches, base: Vehicle, x0: FloatArray,
               free: Sequence[str], mass: float, group: IntArray | None = None) -> FreeStarts:
    """The stretches as a problem in the ``free`` parameters, the others as in x0 (8,).

    group (S,) 0..G-1 of each stretch: parameters are then ``free`` and G dead bands g.
    """
    rows = [NAMES.index(n) for n in free]
    known = None if set(free) & set(NAMES[6:]) else throttle_at(series, s, x0[6:7], x0[7:])

    def predict(p: FloatArray, starts: FloatArray) -> FloatArray:
        full = np.tile(x0, (len(p), 1))
        full[:, rows] = p[:, :len(rows)]
        g = None if group is None else p[:, len(rows) + group]
        with np.errstate(over="ignore", invalid="ignore"):
            # overflowing trial steps become large residuals, not NaN
            return np.nan_to_num(simulate(series, s, base, full, starts, mass, g, known),
                                 nan=1e3, posinf=1e3, neginf=-1e3)

    rows_all = rows if group is None else rows + [NAMES.index("g")] * (int(group.max()) + 1)
    return FreeStarts(predict, s.v, s.stretch, LOW[rows_all], HIGH[rows_all], STEP[rows_all],
                      None if group is None else group[s.stretch])


def simulate(series: Sequence[Speeds], s: Stretches, base: Vehicle, p: FloatArray,
             starts: FloatArray, mass: float, g: FloatArray | None = None,
             throttle: FloatArray | None = None) -> FloatArray:
    """Readings (P, n) [m/s] for parameters p (P, 8) and start speeds (P, S) [m/s].

    g: dead band (P, S) of every stretch instead of that in p; throttle (1, S,
    steps) at the motor, if it is known.
    """
    columns = {n: p[:, i, None] for i, n in enumerate(NAMES)}
    friction = make_friction(_group(columns, "abc", q=base.friction.q), np)
    if g is not None:
        columns["g"] = g
    gains = make_motor_gains(_group({n: v[..., None] for n, v in columns.items()}, "deg",
                                    reverse=base.motor.reverse), np)
    push, drag = gains(throttle_at(series, s, p[:, 6], p[:, 7]) if throttle is None else throttle)
    push, drag = np.moveaxis(push / mass, -1, 0), np.moveaxis(drag / mass, -1, 0)
    v = np.array(np.broadcast_to(starts, (len(p), len(s))))
    distance = np.zeros((*v.shape, s.steps + 1))
    for i in range(s.steps):
        rate = push[i] - drag[i] * v + friction(v) / mass
        middle = v + 0.5 * SAMPLE * rate
        v = v + SAMPLE * (push[i] - drag[i] * middle + friction(middle) / mass)
        distance[..., i + 1] = distance[..., i] + SAMPLE * middle
    return s.reading(distance)


def _group(columns: dict[str, FloatArray], names: str, **more: float) -> Any:
    """Parameters as arrays of variants in the shape of the vehicle's dataclasses."""
    return SimpleNamespace(**{n: columns[n] for n in names}, **more)


def throttle_at(series: Sequence[Speeds], s: Stretches, delay: FloatArray, lag: FloatArray
                ) -> FloatArray:
    """Throttle (P, S, steps) at the motor for delays and lags (P,) [s]."""
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
            out[j, mine] = _resampled(grid, (s.start[mine] - begin) / SAMPLE, s.steps)
    return np.asarray(out[np.reshape(index, -1)])


def _resampled(grid: FloatArray, place: FloatArray, steps: int) -> FloatArray:
    """Means (S, steps) of steps that begin at fractional grid positions ``place`` (S,)."""
    whole = np.floor(place).astype(np.int64)
    part = (place - whole)[:, None]
    at = whole[:, None] + np.arange(steps + 1)
    cells = grid[np.clip(at, 0, len(grid) - 1)]
    return np.asarray((1.0 - part) * cells[:, :-1] + part * cells[:, 1:])
