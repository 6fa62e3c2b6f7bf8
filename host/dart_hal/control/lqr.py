"""Gains of the LQR tracker, by speed: feedback of the offset and preview of the path's curvature.

About a steady bend the car moves as

    e'     = v (psi + slip(delta))          e: offset of the rear axle [m]
    psi'   = v curvature(delta) - v k(s)    psi: heading relative to the path [rad]
    delta' = (u - delta) / T                delta: road wheels, u: command [rad]

with slip and curvature linear in delta, by the identified model, and T its steering lag. The gain
minimises the sum of e^2 + (delta' / WHEEL_RATE_WEIGHT)^2, which is zero in a steady bend of any
curvature. The curvatures ahead k_0, k_1, ... enter linearly, by the same Riccati matrix P:

    u = -K x - sum_j (R + B'PB)^-1 B' (A - BK)'^j P E k_j

(M. Tomizuka, "Optimal continuous finite preview problem", IEEE TAC 20, 1975). Their weighted mean
is the curvature about which the tracker corrects.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dart_hal.control.steady import SPEEDS, Steady, grid_position
from dart_hal.core.timing import PWM_FRAME
from dart_hal.core.types import FloatArray

# Wheel rate that costs as much as an offset of 1 m [rad/s].
WHEEL_RATE_WEIGHT = 40.0
# Period of the commands that act, one PWM frame [s]; number of preview steps, 1 s.
COMMAND_PERIOD = PWM_FRAME
PREVIEW_STEPS = 50
# Smallest lag [s]: the slew rate of a servo takes as long for 0.1 rad.
MIN_LAG = 0.03
# Curvatures of the linearisation [1/m].
CURVATURE_STEP = 0.02


class LqrGains(NamedTuple):
    """feedback (v, 3) of e, psi, delta; preview (v, n), which sums to 1, at multiples of
    COMMAND_PERIOD.
    """

    feedback: FloatArray
    preview: FloatArray

    def interpolate(self, speed: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return (feedback (3,), preview (n,), distances of its curvatures (n,) [m]) at a speed
        [m/s].
        """
        k, part = grid_position(speed)
        gain, preview = ((1.0 - part) * rows[k] + part * rows[k + 1]
                         for rows in (self.feedback, self.preview))
        grid_speed = SPEEDS[k] + part * (SPEEDS[k + 1] - SPEEDS[k])
        return gain, preview, grid_speed * COMMAND_PERIOD * (np.arange(len(preview)) + 0.5)


def compute_gains(steady: Steady, lag: float) -> LqrGains:
    """Compute the gains for a car with this steady cornering and steering lag [s]."""
    from scipy.linalg import expm, solve_discrete_are

    lag = max(lag, MIN_LAG)
    rows = []
    for v in SPEEDS:
        left_turn = steady.turn(CURVATURE_STEP, v)
        right_turn = steady.turn(-CURVATURE_STEP, v)
        per = 1.0 / (left_turn.angle - right_turn.angle)
        curvature_slope = 2.0 * CURVATURE_STEP * per
        slip_slope = (left_turn.slip - right_turn.slip) * per
        dynamics = np.zeros((5, 5))  # of e, psi, delta, and the constant inputs u and k
        dynamics[0, 1:3] = v, v * slip_slope
        dynamics[1, 2:] = v * curvature_slope, 0.0, -v
        dynamics[2, 2:4] = -1.0 / lag, 1.0 / lag
        # Discretise with constant u and k over a command period.
        step = expm(dynamics * COMMAND_PERIOD)
        a = step[:3, :3]
        b = step[:3, 3:4]
        e = step[:3, 4:]
        # delta' = (u - delta) / T, so its cost has terms in delta, u and delta * u (cross).
        r = (1.0 / (WHEEL_RATE_WEIGHT * lag)) ** 2
        q = np.diag((1.0, 0.0, r))
        cross = np.array([[0.0], [0.0], [-r]])
        p = solve_discrete_are(a, b, q, np.array([[r]]), s=cross)
        per = 1.0 / (r + float((b.T @ p @ b)[0, 0]))
        gain = per * (b.T @ p @ a + cross.T)
        rows.append((gain[0], _preview(a - b @ gain, b, p @ e)))
    feedback, preview = zip(*rows, strict=True)
    return LqrGains(np.array(feedback), np.array(preview))


def _preview(closed_loop: FloatArray, b: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the weights (n,) of the curvatures ahead, normalised to the sum 1."""
    weights = []
    for _ in range(PREVIEW_STEPS):
        weights.append(float((b.T @ weight)[0, 0]))
        weight = closed_loop.T @ weight
    return np.array(weights) / sum(weights)
