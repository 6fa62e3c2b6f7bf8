"""Gains of the LQR tracker, by speed: feedback of the offset, and preview of the path's bends.

About a steady bend the car moves as

    e'     = v (psi + slip(delta))          e: offset of the rear axle [m]
    psi'   = v bend(delta) - v k(s)         psi: heading to the path's [rad]
    delta' = (u - delta) / T                delta: road wheels, u: command [rad]

with slip and bend linear in delta, by the identified model, and T its steering lag. The gain
minimises the sum of e^2 + (delta' / RATE)^2, which costs nothing in a steady bend of any curvature.
The bends ahead k_0, k_1, ... enter linearly, with weights by the same Riccati matrix P:

    u = -K x - sum_j (R + B'PB)^-1 B' (A - BK)'^j P E k_j

(M. Tomizuka, "Optimal continuous finite preview problem", IEEE TAC 20, 1975). Their weighted mean
is the bend about which the tracker corrects.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dart_hal.control.steady import SPEEDS, Steady, row_of
from dart_hal.core.timing import PWM_FRAME
from dart_hal.core.types import FloatArray

# rad/s of the wheels for 1 m of offset.
RATE = 40.0
# s between two commands that act, one PWM frame; steps ahead, 1 s.
PERIOD = PWM_FRAME
PREVIEW = 50
# s: no servo is quicker, for its slew takes as long for 0.1 rad.
LEAST_LAG = 0.03
# 1/m from straight, for the slopes.
SMALL = 0.02


class Gains(NamedTuple):
    """feedback (v, 3) of e, psi, delta; preview (v, n), which sums to 1, at multiples of PERIOD."""

    feedback: FloatArray
    preview: FloatArray

    def at(self, speed: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(feedback (3,), preview (n,), metres ahead of its bends (n,)) at a speed [m/s]."""
        k, part = row_of(speed)
        gain, ahead = ((1.0 - part) * rows[k] + part * rows[k + 1]
                       for rows in (self.feedback, self.preview))
        way = SPEEDS[k] + part * (SPEEDS[k + 1] - SPEEDS[k])
        return gain, ahead, way * PERIOD * (np.arange(len(ahead)) + 0.5)


def gains_of(steady: Steady, lag: float) -> Gains:
    """For a car with this steady cornering and steering lag [s]."""
    from scipy.linalg import expm, solve_discrete_are

    lag = max(lag, LEAST_LAG)
    rows = []
    for v in SPEEDS:
        one = steady.turn(SMALL, v)
        two = steady.turn(-SMALL, v)
        per = 1.0 / (one.angle - two.angle)
        bend = 2.0 * SMALL * per
        slip = (one.slip - two.slip) * per
        flow = np.zeros((5, 5))  # of e, psi, delta, and the held u and k
        flow[0, 1:3] = v, v * slip
        flow[1, 2:] = v * bend, 0.0, -v
        flow[2, 2:4] = -1.0 / lag, 1.0 / lag
        step = expm(flow * PERIOD)
        a = step[:3, :3]
        b = step[:3, 3:4]
        e = step[:3, 4:]
        r = (1.0 / (RATE * lag)) ** 2
        q = np.diag((1.0, 0.0, r))
        cross = np.array([[0.0], [0.0], [-r]])
        p = solve_discrete_are(a, b, q, np.array([[r]]), s=cross)
        per = 1.0 / (r + float((b.T @ p @ b)[0, 0]))
        gain = per * (b.T @ p @ a + cross.T)
        rows.append((gain[0], _preview(a - b @ gain, b, p @ e)))
    feedback, preview = zip(*rows, strict=True)
    return Gains(np.array(feedback), np.array(preview))


def _preview(closed: FloatArray, b: FloatArray, pull: FloatArray) -> FloatArray:
    """Weights (n,) of the bends ahead, to the sum of 1."""
    weights = []
    for _ in range(PREVIEW):
        weights.append(float((b.T @ pull)[0, 0]))
        pull = closed.T @ pull
    return np.array(weights) / sum(weights)
