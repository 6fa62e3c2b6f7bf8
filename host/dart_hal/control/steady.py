"""Steady cornering of a vehicle: the steering angle for a curvature at a speed, and the inverse.

    curvature k, speed v  ->  road-wheel angle, slip angle of the rear axle

The equations of motion (``vehicle.bicycle``) are solved for v_y' = omega' = v_x' = 0 with
omega = k v on a grid. At 2 m/s the lateral motion settles within 10 ms, so between two commands the
car is approximately in this state.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.bicycle import make_dynamic
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import Vehicle

# Grid of speeds [m/s].
SPEEDS = np.arange(0.25, 4.26, 0.25)
# Grid of curvatures [1/m]; cars of this class turn within 0.4 m.
CURVATURES = 3.0 * np.linspace(0.0, 1.0, 31) ** 1.5
# Largest angle of the tables [rad]; beyond it is beyond every stop.
MAX_TABLE_ANGLE = 0.7
# Newton steps from one curvature of the grid to the next, and the largest residual of a solution
# [m/s2, rad/s2].
NEWTON_STEPS = 4
MAX_RESIDUAL = 1e-4
# Largest change of a Newton step [m/s, rad, N]: a bend without solution must not diverge.
MAX_NEWTON_CHANGE = 2.0
# Differences of v_y [m/s], angle [rad], drive force [N] for the slopes.
DIFFERENCE_STEPS = (1e-5, 1e-6, 1e-4)


class SteadyTurn(NamedTuple):
    """Steering angle [rad] of a steady bend; slip [rad]: course minus heading of the rear axle,
    left positive.
    """

    angle: float
    slip: float


class Steady:
    """Tables over ``SPEEDS`` and curvature of both signs: angle and slip, shape (v, k).

    ``tyre_limits`` (2, v): largest curvature of the tyres to the right and to the left. Beyond it
    the angle continues to rise, so that it is monotone.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        right, left = _solve_tables(apply_parameter_effects(vehicle))
        self.curvatures: FloatArray = np.append(-CURVATURES[:0:-1], CURVATURES)
        self.angle, self.slip, is_solved = (
            np.hstack([r[:, :0:-1], x]) for r, x in zip(right, left, strict=True))
        self.tyre_limits: FloatArray = np.array([(self.curvatures * is_solved).min(axis=1),
                                                 (self.curvatures * is_solved).max(axis=1)])

    def turn(self, curvature: float, speed: float) -> SteadyTurn:
        """Return angle and slip for a curvature [1/m] of the path of the rear axle at a speed
        [m/s].
        """
        k, part = grid_position(speed)
        both = [[float(np.interp(curvature, self.curvatures, table[i])) for i in (k, k + 1)]
                for table in (self.angle, self.slip)]
        return SteadyTurn(*(low + part * (high - low) for low, high in both))

    def curvature(self, angle: float, speed: float) -> float:
        """Return the curvature [1/m] for a steering angle [rad]."""
        k, part = grid_position(speed)
        low, high = (float(np.interp(angle, self.angle[i], self.curvatures)) for i in (k, k + 1))
        return low + part * (high - low)

    def curvature_limits(self, lock: tuple[float, float]) -> FloatArray:
        """Return the curvature limits [1/m] to the right and to the left, (2, v), for angles within
        lock.

        A curvature that a slower car cannot drive is excluded for all higher speeds.
        """
        by_lock = np.array([[np.interp(angle, row, self.curvatures) for row in self.angle]
                            for angle in lock])
        return np.array([np.maximum.accumulate(np.maximum(by_lock[0], self.tyre_limits[0])),
                         np.minimum.accumulate(np.minimum(by_lock[1], self.tyre_limits[1]))])

    def max_speed(self, curvature: FloatArray, lock: tuple[float, float]) -> FloatArray:
        """Return the largest speed [m/s] for each curvature [1/m]; 0 if it is too tight for all."""
        right, left = self.curvature_limits(lock)
        by_left = np.interp(curvature, left[::-1], SPEEDS[::-1], right=0.0)
        by_right = np.interp(-curvature, -right[::-1], SPEEDS[::-1], right=0.0)
        return np.asarray(np.minimum(by_left, by_right), dtype=np.float64)


def grid_position(speed: float) -> tuple[int, float]:
    """Return the grid row below a speed [m/s] and the fraction to the next row."""
    position = (min(max(abs(speed), SPEEDS[0]), SPEEDS[-1]) - SPEEDS[0]) / (SPEEDS[1] - SPEEDS[0])
    k = min(int(position), len(SPEEDS) - 2)
    return k, float(position - k)


def _solve_tables(p: Vehicle) -> FloatArray:
    """Return (angle, slip, is_solved) of bends to the right and to the left, (2, 3, v, k).

    1. Start at k = 0 with the friction force, for all speeds and both signs together.
    2. Go to the next curvature, with v_y of the rolling rear axle as the guess.
    3. Newton steps on (v_y', omega', v_x') = 0 for (v_y, angle, drive force).
    4. A row is solved while the residuals are small and the angle rises monotonically. Beyond, the
       angle is extrapolated with slope 1 and the slip stays constant.
    """
    n = len(SPEEDS)
    l_r = p.body.l_r
    if p.kind == "kinematic":
        angle = np.tile(np.arctan(p.body.wheelbase * CURVATURES), (n, 1))
        return np.array([[sign * angle, 0.0 * angle, 1.0 + 0.0 * angle] for sign in (-1.0, 1.0)])
    v = np.tile(SPEEDS, 2)
    sign = np.repeat((-1.0, 1.0), n)
    rates = make_dynamic(p, ARRAY)

    def residuals(x: FloatArray, omega: FloatArray) -> FloatArray:
        vy, delta, force = x
        return np.array(rates(0.0 * v, v, vy, omega, force, 0.0, 0.0, np.cos(delta),
                              np.sin(delta))[3:])

    rows: list[tuple[FloatArray, ...]] = []
    x = np.array([0.0 * v, 0.0 * v, -make_friction(p.friction, ARRAY)(v)])
    is_solved = np.ones(2 * n, dtype=bool)
    last_k = 0.0
    for k in CURVATURES:
        omega = sign * k * v
        last = x
        x = x + np.outer((l_r, 0.0, 0.0), omega - sign * last_k * v)
        for _ in range(NEWTON_STEPS):
            x = x + _newton(x, omega, residuals)
        solved = np.abs(residuals(x, omega)).max(axis=0) < MAX_RESIDUAL
        solved &= np.abs(x[1]) < MAX_TABLE_ANGLE
        is_solved &= solved & ((sign * (x[1] - last[1]) > 0.0) | (k == 0.0))
        x = np.where(is_solved, x, last + np.outer((0.0, 1.0, 0.0), sign * (k - last_k)))
        slip = np.arctan2(x[0] - l_r * omega, v)
        last_slip = rows[-1][1] if rows else 0.0
        rows.append((x[1], np.where(is_solved, slip, last_slip), is_solved.copy()))
        last_k = k
    table: FloatArray = np.array(rows, dtype=float).transpose(1, 2, 0).reshape(3, 2, n, -1)
    return np.swapaxes(table, 0, 1)


def _newton(x: FloatArray, omega: FloatArray,
            residuals: Callable[[FloatArray, FloatArray], FloatArray]) -> FloatArray:
    """Return one Newton step for all bends at once; 0 where the Jacobian is singular."""
    start = residuals(x, omega)
    slope = np.array([(residuals(x + h * e[:, None], omega) - start) / h
                      for h, e in zip(DIFFERENCE_STEPS, np.eye(3), strict=True)]).transpose(2, 1, 0)
    is_regular = np.abs(np.linalg.det(slope)) > 1e-9
    slope[~is_regular] = np.eye(3)
    step = np.linalg.solve(slope, -start.T[:, :, None])[:, :, 0].T
    step = np.clip(step, -MAX_NEWTON_CHANGE, MAX_NEWTON_CHANGE)
    return np.asarray(np.where(is_regular, step, 0.0))
