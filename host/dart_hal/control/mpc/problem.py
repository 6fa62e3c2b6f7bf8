"""The quadratic programme of one iteration, in the changes of all inputs.

    minimise  sum_k  q_c e_c^2 + q_l e_l^2 + q_v (v_s - V)^2 + q_u (tau_c^2 + st_c^2)
                     + q_t (change of tau_c)^2 + q_s (change of st_c)^2
    hard      ranges of inputs, rates of inputs, |s - s of the last plan| <= MAX_PROGRESS_STEP
    soft      low <= e_c <= high,   v_x <= 1.05 V,   |v_x omega| <= a_lat,   s + e_l <= line

q_c: ``Weights.contour``, times ``ends`` at the last stage; q_l: ``lag``; q_v: ``progress``; q_u:
``input``; q_t, q_s: ``throttle_change``, ``steering_change``. A change is that from stage to stage,
of the first one from the command that was sent last. In the code tau and st are the commands.

e_c, e_l are linear in the input changes through the slopes of the stages (``condense``), so the
states are no variables: 3 x 20 variables remain. Without the limit of the progress the iteration
stalls.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import NamedTuple

import numpy as np

from dart_hal.control.mpc.admm import Constraints
from dart_hal.control.mpc.model import MIN_SLIPPING_SPEED, STAGE_PERIOD
from dart_hal.control.mpc.reference import PathErrors
from dart_hal.core.types import FloatArray

# Rows of the inputs (3, n).
TAU = 0
ST = 1
V_S = 2
# Columns of the states.
STATE_X = 0
STATE_Y = 1
STATE_VX = 3
STATE_OMEGA = 5
# Largest change of the progress relative to the last plan [m].
MAX_PROGRESS_STEP = 0.4
# Speed limit relative to the target speed.
MAX_SPEED_RATIO = 1.05
# ADMM penalties of the rows by their unit: with 0.1 for metres, 40 iterations do not enforce a
# lane.
RHO_INPUT = 0.1
RHO_METRE = 10.0
RHO_SPEED = 1.0
RHO_LATERAL = 0.1
# ``MpcLimits.lateral`` relative to the largest lateral acceleration of the tyres in the model.
TYRE_SHARE = 0.8


@dataclass(frozen=True, slots=True)
class Weights:
    """Weights of the cost, see the module.

    lag: of the longitudinal error e_l; ends: factor of q_c at the last stage; lane, speed, lateral,
    line: prices per m, m/s, m/s2, m of the soft limits (``MpcLimits.lane`` is the limit itself).
    """

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
class MpcLimits:
    """Limits of the inputs and of the motion.

    tau, st: ranges of the inputs; rates [1/s]: of both; fastest [m/s]: of the progress;
    lateral [m/s2]: acceleration; lane [m]: half width.

    tau begins at the motor's dead band: below it the force does not depend on tau, and the
    optimiser would find no slope that starts a car at rest. brake: how far the throttle of a moving
    car may go below it, where it brakes (``model``).
    """

    tau: tuple[float, float]
    st: tuple[float, float] = (-1.0, 1.0)
    rates: tuple[float, float] = (5.0, 8.0)
    fastest: float = 5.0
    lateral: float = 6.5
    lane: float = 0.3
    brake: float = 0.0


class Condensed(NamedTuple):
    """State changes as a linear function of the input changes.

    free (n, states): without input changes. forced (n, states, inputs n): slopes to each change of
    the first input (tau), then of the next (st).
    """

    free: FloatArray
    forced: FloatArray


def condense(first: FloatArray, a: FloatArray, b: FloatArray, gaps: FloatArray) -> Condensed:
    """Eliminate the states of the linearised stages x_k+1 = A_k x_k + B_k u_k + gap_k.

    first (states,): change of the first state; a (n, states, states), b (n, states, inputs):
    slopes; gaps (n, states): prediction minus plan.
    """
    n, states, inputs = b.shape
    free = np.empty((n, states))
    forced = np.empty((n, states, inputs * n))
    offset = first
    slopes = np.zeros((states, inputs * n))
    for k in range(n):
        offset = a[k] @ offset + gaps[k]
        slopes = a[k] @ slopes
        slopes[:, k::n] = b[k]
        free[k] = offset
        forced[k] = slopes
    return Condensed(free, forced)


class ContouringProblem:
    """Matrices that are the same for all samples, for n stages."""

    def __init__(self, n: int, weights: Weights, limits: MpcLimits) -> None:
        self.n = n
        self.weights = weights
        self.limits = limits
        w = weights
        identity = np.eye(n)
        zeros = np.zeros((n, n))
        self._progress: FloatArray = STAGE_PERIOD * np.tril(np.ones((n, n)))
        # Difference of each input to that of the stage before.
        difference = identity - np.eye(n, k=-1)
        self._difference = np.block([[difference, zeros, zeros], [zeros, difference, zeros]])
        change = difference.T @ difference
        self._h = 2.0 * np.block(
            [
                [w.input * identity + w.throttle_change * change, zeros, zeros],
                [zeros, w.input * identity + w.steering_change * change, zeros],
                [zeros, zeros, w.progress * identity],
            ]
        )
        self._contour_weights = np.full(n, w.contour)
        self._contour_weights[-1] *= w.ends
        progress = np.hstack([zeros, zeros, self._progress])
        self._fixed = np.vstack([np.eye(3 * n), self._difference, progress])
        self._prices = np.concatenate(
            [np.full(6 * n, inf), np.full(n, w.lane), np.full(n, w.speed), np.full(n, w.lateral)]
        )
        self._rho = np.concatenate(
            [
                np.full(5 * n, RHO_INPUT),
                np.full(2 * n, RHO_METRE),
                np.full(n, RHO_SPEED),
                np.full(n, RHO_LATERAL),
            ]
        )
        lim = limits
        self._low = np.repeat((lim.tau[0], lim.st[0], 0.0), n)
        self._high = np.repeat((lim.tau[1], lim.st[1], lim.fastest), n)
        self._max_change = STAGE_PERIOD * np.repeat(lim.rates, n)

    def set_steering_range(self, low: float, high: float) -> None:
        """Set the range of the steering command, which the disturbance estimate shifts."""
        n = self.n
        self._low[n * ST : n * (ST + 1)] = low
        self._high[n * ST : n * (ST + 1)] = high

    def build(
        self,
        states: FloatArray,
        inputs: FloatArray,
        last_inputs: tuple[float, float],
        condensed: Condensed,
        errors: PathErrors,
        target_speed: FloatArray,
        end_speed: FloatArray,
        lane: tuple[FloatArray, FloatArray],
        stop_distance: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray, Constraints]:
        """Return (H, g, constraints) for states (n, 8) at the ends of the stages and inputs (3, n).

        last_inputs: tau, st that were sent last; target_speed, end_speed (n,) [m/s]: in the middle
        and at the end of each stage; lane: low, high (n,) [m];
        stop_distance (n,) [m]: from the progress to the stop line, None without one.
        """
        n = self.n
        w = self.weights
        u = inputs.ravel()
        across, e_c = self._error(errors.across, errors.across_slopes, condensed)
        along, e_l = self._error(errors.along, errors.along_slopes, condensed)
        # Gauss-Newton: H = constant part + 2 J' Q J, g = 2 J' Q e.
        h = self._h + 2.0 * (
            across.T @ (self._contour_weights[:, None] * across) + w.lag * (along.T @ along)
        )
        g = self._h @ u + 2.0 * (across.T @ (self._contour_weights * e_c) + w.lag * (along.T @ e_l))
        g[2 * n :] -= 2.0 * w.progress * target_speed
        g[0] -= 2.0 * w.throttle_change * last_inputs[TAU]
        g[n] -= 2.0 * w.steering_change * last_inputs[ST]
        input_change = self._difference @ u
        input_change[0] -= last_inputs[TAU]
        input_change[n] -= last_inputs[ST]
        speed = states[:, STATE_VX] + condensed.free[:, STATE_VX]
        omega = states[:, STATE_OMEGA] + condensed.free[:, STATE_OMEGA]
        speed_slopes = condensed.forced[:, STATE_VX]
        # v_x omega is linearised by the product rule.
        lateral = omega[:, None] * speed_slopes + speed[:, None] * condensed.forced[:, STATE_OMEGA]
        zeros = np.zeros((n, n))
        max_progress = np.full(n, MAX_PROGRESS_STEP)
        a_lat = self.limits.lateral
        low = self._low.copy()
        low[:n] -= self.limits.brake * np.clip(
            (states[:, STATE_VX] - MIN_SLIPPING_SPEED) / MIN_SLIPPING_SPEED, 0.0, 1.0)
        constraints = Constraints(
            np.vstack([self._fixed, across, np.hstack([speed_slopes, zeros]),
                       np.hstack([lateral, zeros])]),
            np.concatenate(
                [
                    low - u,
                    -self._max_change - input_change,
                    -max_progress,
                    lane[0] - e_c,
                    np.full(n, -inf),
                    -a_lat - speed * omega,
                ]
            ),
            np.concatenate(
                [
                    self._high - u,
                    self._max_change - input_change,
                    max_progress,
                    lane[1] - e_c,
                    MAX_SPEED_RATIO * end_speed - speed,
                    a_lat - speed * omega,
                ]
            ),
            self._prices,
            self._rho,
        )
        if stop_distance is not None:
            constraints = self._add_stop_line(constraints, along, stop_distance - e_l)
        return h, g, constraints

    def _add_stop_line(
        self, constraints: Constraints, e_l_slopes: FloatArray, high: FloatArray
    ) -> Constraints:
        """Add rows that keep the rear axle, not its progress variable, before the stop line."""
        n = self.n
        position_slopes = e_l_slopes.copy()
        position_slopes[:, 2 * n :] += self._progress
        return Constraints(
            np.vstack([constraints.c, position_slopes]),
            np.append(constraints.low, np.full(n, -inf)),
            np.append(constraints.high, high),
            np.append(constraints.price, np.full(n, self.weights.line)),
            np.append(constraints.rho, np.full(n, RHO_METRE)),
        )

    def progress(self, s: float, v_s: FloatArray) -> FloatArray:
        """Return s [m] at the end of each stage."""
        return s + self._progress @ v_s

    def _error(
        self, error: FloatArray, slopes: FloatArray, condensed: Condensed
    ) -> tuple[FloatArray, FloatArray]:
        """Return (slopes to all inputs (n, 3 n), error without input changes (n,))."""
        forced = condensed.forced
        by_pose = slopes[:, :1] * forced[:, STATE_X] + slopes[:, 1:2] * forced[:, STATE_Y]
        free = slopes[:, 0] * condensed.free[:, STATE_X] + slopes[:, 1] * condensed.free[:, STATE_Y]
        return np.hstack([by_pose, slopes[:, 2:] * self._progress]), error + free
