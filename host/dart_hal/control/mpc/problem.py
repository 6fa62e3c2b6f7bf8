"""The quadratic programme of one iteration, in the changes of all inputs.

    minimise  sum_k  q_c e_c^2 + q_l e_l^2 + q_v (v_s - V)^2 + q_u (tau^2 + st^2)
                     + q_t (tau - tau_before)^2 + q_s (st - st_before)^2
    hard      inputs within their ends, their changes within their rates, |s - s_last| <= TRUST
    soft      low <= e_c <= high,   v_x <= 1.05 V,   |v_x omega| <= a_lat,   s + e_l <= line

e_c, e_l are linear in the changes through the stages' slopes (``condensed``), so that the states
are no variables: 3 x 20 of them remain. Without TRUST the iteration stalls.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import NamedTuple

import numpy as np

from dart_hal.control.mpc.admm import Rows
from dart_hal.control.mpc.model import STAGE
from dart_hal.control.mpc.reference import Errors
from dart_hal.core.types import FloatArray

TAU = 0
ST = 1
V_S = 2
X = 0
Y = 1
V_X = 3
OMEGA = 5
# m of progress beside the last plan's.
TRUST = 0.4
# Of the wanted speed.
OVER = 1.05
# Of the rows by their unit: with 0.1 for metres 40 iterations do not enforce a lane.
RHO_INPUT = 0.1
RHO_METRE = 10.0
RHO_SPEED = 1.0
RHO_ACROSS = 0.1
# ``Limits.lateral``, of the most that the tyres hold across, by the model.
GRIP = 0.8


@dataclass(frozen=True, slots=True)
class Weights:
    """See the module; ends: of q_c at the last stage; lane, speed, lateral, line: prices per m,
    m/s, m/s2, m of the soft limits."""

    contour: float = 20.0
    lag: float = 100.0
    progress: float = 0.3
    input: float = 0.01
    throttle_change: float = 0.05
    steering_change: float = 0.1
    ends: float = 5.0
    lane: float = 50.0
    speed: float = 5.0
    lateral: float = 1.0
    line: float = 300.0


@dataclass(frozen=True, slots=True)
class Limits:
    """tau, st: ends of the inputs; rates [1/s] of both; fastest [m/s] of the progress;
    lateral [m/s2]; lane [m] to either side.

    tau ends at the motor's dead band: below it the force does not change with it, and a standing
    car would have no reason to start.
    """

    tau: tuple[float, float]
    st: tuple[float, float] = (-1.0, 1.0)
    rates: tuple[float, float] = (5.0, 8.0)
    fastest: float = 5.0
    lateral: float = 6.5
    lane: float = 0.3


class Condensed(NamedTuple):
    """Changes of the states behind each stage: free (n, states), and (n, states, inputs n) for each
    change of the first input (tau), then of the next (st)."""

    free: FloatArray
    forced: FloatArray


def condensed(first: FloatArray, a: FloatArray, b: FloatArray, gaps: FloatArray) -> Condensed:
    """From the change of the first state (states,), slopes (n, states, states), (n, states, inputs)
    and gaps (n, states)."""
    n, states, inputs = b.shape
    free = np.empty((n, states))
    forced = np.empty((n, states, inputs * n))
    at = first
    by = np.zeros((states, inputs * n))
    for k in range(n):
        at = a[k] @ at + gaps[k]
        by = a[k] @ by
        by[:, k::n] = b[k]
        free[k] = at
        forced[k] = by
    return Condensed(free, forced)


class Problem:
    """Everything that stays the same from sample to sample, for n stages."""

    def __init__(self, n: int, weights: Weights, limits: Limits) -> None:
        self.n = n
        self.weights = weights
        self.limits = limits
        w = weights
        one = np.eye(n)
        none = np.zeros((n, n))
        self._way: FloatArray = STAGE * np.tril(np.ones((n, n)))
        step = one - np.eye(n, k=-1)
        self._step = np.block([[step, none, none], [none, step, none]])
        change = step.T @ step
        self._h = 2.0 * np.block(
            [
                [w.input * one + w.throttle_change * change, none, none],
                [none, w.input * one + w.steering_change * change, none],
                [none, none, w.progress * one],
            ]
        )
        self._across = np.full(n, w.contour)
        self._across[-1] *= w.ends
        self._fixed = np.vstack([np.eye(3 * n), self._step, np.hstack([none, none, self._way])])
        self._price = np.concatenate(
            [np.full(6 * n, inf), np.full(n, w.lane), np.full(n, w.speed), np.full(n, w.lateral)]
        )
        self._rho = np.concatenate(
            [
                np.full(5 * n, RHO_INPUT),
                np.full(2 * n, RHO_METRE),
                np.full(n, RHO_SPEED),
                np.full(n, RHO_ACROSS),
            ]
        )
        lim = limits
        self._low = np.repeat((lim.tau[0], lim.st[0], 0.0), n)
        self._high = np.repeat((lim.tau[1], lim.st[1], lim.fastest), n)
        self._most = STAGE * np.repeat(lim.rates, n)

    def turn_within(self, low: float, high: float) -> None:
        """Ends of the steering from now on: what is learnt of it moves them."""
        n = self.n
        self._low[n * ST : n * (ST + 1)] = low
        self._high[n * ST : n * (ST + 1)] = high

    def build(
        self,
        states: FloatArray,
        inputs: FloatArray,
        before: tuple[float, float],
        moved: Condensed,
        errors: Errors,
        wanted: FloatArray,
        lane: tuple[FloatArray, FloatArray],
        room: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray, Rows]:
        """(H, g, rows) about states (n, 8) behind the stages and inputs (3, n).

        before: tau, st that were sent last; wanted (n,) [m/s]; lane: low, high (n,) [m];
        room (n,) [m]: from the progress to a line at which to stand, None = there is none.
        """
        n = self.n
        w = self.weights
        u = inputs.ravel()
        across, e_c = self._error(errors.across, errors.across_slopes, moved)
        along, e_l = self._error(errors.along, errors.along_slopes, moved)
        h = self._h + 2.0 * (
            across.T @ (self._across[:, None] * across) + w.lag * (along.T @ along)
        )
        g = self._h @ u + 2.0 * (across.T @ (self._across * e_c) + w.lag * (along.T @ e_l))
        g[2 * n :] -= 2.0 * w.progress * wanted
        g[0] -= 2.0 * w.throttle_change * before[TAU]
        g[n] -= 2.0 * w.steering_change * before[ST]
        change = self._step @ u
        change[0] -= before[TAU]
        change[n] -= before[ST]
        speed = states[:, V_X] + moved.free[:, V_X]
        turn = states[:, OMEGA] + moved.free[:, OMEGA]
        faster = moved.forced[:, V_X]
        lateral = turn[:, None] * faster + speed[:, None] * moved.forced[:, OMEGA]
        pad = np.zeros((n, n))
        most = np.full(n, TRUST)
        a_lat = self.limits.lateral
        rows = Rows(
            np.vstack([self._fixed, across, np.hstack([faster, pad]), np.hstack([lateral, pad])]),
            np.concatenate(
                [
                    self._low - u,
                    -self._most - change,
                    -most,
                    lane[0] - e_c,
                    np.full(n, -inf),
                    -a_lat - speed * turn,
                ]
            ),
            np.concatenate(
                [
                    self._high - u,
                    self._most - change,
                    most,
                    lane[1] - e_c,
                    OVER * wanted - speed,
                    a_lat - speed * turn,
                ]
            ),
            self._price,
            self._rho,
        )
        if room is not None:
            rows = self._standing(rows, along, room - e_l)
        return h, g, rows

    def _standing(self, rows: Rows, along: FloatArray, high: FloatArray) -> Rows:
        """Rows for the line as well: where the car is along the path, whatever its progress."""
        n = self.n
        ahead = along.copy()
        ahead[:, 2 * n :] += self._way
        return Rows(
            np.vstack([rows.c, ahead]),
            np.append(rows.low, np.full(n, -inf)),
            np.append(rows.high, high),
            np.append(rows.price, np.full(n, self.weights.line)),
            np.append(rows.rho, np.full(n, RHO_METRE)),
        )

    def progress(self, s: float, v_s: FloatArray) -> FloatArray:
        """s [m] behind each stage."""
        return s + self._way @ v_s

    def _error(
        self, error: FloatArray, slopes: FloatArray, moved: Condensed
    ) -> tuple[FloatArray, FloatArray]:
        """(slopes to all inputs (n, 3 n), error with the free change (n,))."""
        by_pose = slopes[:, :1] * moved.forced[:, X] + slopes[:, 1:2] * moved.forced[:, Y]
        free = slopes[:, 0] * moved.free[:, X] + slopes[:, 1] * moved.free[:, Y]
        return np.hstack([by_pose, slopes[:, 2:] * self._way]), error + free
