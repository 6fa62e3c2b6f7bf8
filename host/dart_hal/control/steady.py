"""Steady cornering of a vehicle: the steering angle that a bend needs at a speed, and back.

    curvature k, speed v  ->  road-wheel angle, course of the rear axle beside the heading

The equations of motion (``vehicle.bicycle``) are solved for v_y' = omega' = v_x' = 0 with
omega = k v on a grid. At 2 m/s the motion across settles within 10 ms, so that between two
commands the car is about in this state.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.bicycle import make_dynamic
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import Vehicle

SPEEDS = np.arange(0.25, 4.26, 0.25)
# m/s and 1/m of the grid; cars of this class turn within 0.4 m.
CURVATURES = 3.0 * np.linspace(0.0, 1.0, 31) ** 1.5
# rad; what needs more is behind every stop, and what the tyres do there is not asked.
STEERED = 0.7
# Newton steps from one curvature of the grid to the next, and m/s2 or rad/s2 that may be left.
ROUNDS = 4
SOLVED = 1e-4
# m/s, rad or N of one Newton step: a bend that has no solution must not run away.
MOST = 2.0
# Of v_y [m/s], angle [rad], drive force [N] for the slopes.
STEPS = (1e-5, 1e-6, 1e-4)


class Turn(NamedTuple):
    """What a bend needs: steering angle [rad], slip [rad] of the rear axle's course to the left of
    its heading."""

    angle: float
    slip: float


class Steady:
    """Tables over ``SPEEDS`` and curvature of both signs: angle and slip, shape (v, k).

    Beyond the tyres' end, of which ``ends`` (2, v) tells the curvature to the right and to the
    left, the angle goes on rising, so that it is monotone.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        right, left = _solved(settled(vehicle))
        self.curvature: FloatArray = np.append(-CURVATURES[:0:-1], CURVATURES)
        self.angle, self.slip, held = (
            np.hstack([r[:, :0:-1], x]) for r, x in zip(right, left, strict=True))
        self.ends: FloatArray = np.array([(self.curvature * held).min(axis=1),
                                          (self.curvature * held).max(axis=1)])

    def turn(self, curvature: float, speed: float) -> Turn:
        """For a curvature [1/m] of the rear axle's way at a speed [m/s]."""
        k, part = row_of(speed)
        both = [[float(np.interp(curvature, self.curvature, table[i])) for i in (k, k + 1)]
                for table in (self.angle, self.slip)]
        return Turn(*(low + part * (high - low) for low, high in both))

    def bend(self, angle: float, speed: float) -> float:
        """Curvature [1/m] that a steering angle [rad] gives."""
        k, part = row_of(speed)
        low, high = (float(np.interp(angle, self.angle[i], self.curvature)) for i in (k, k + 1))
        return low + part * (high - low)

    def tightest(self, lock: tuple[float, float]) -> FloatArray:
        """Curvature [1/m] to the right and to the left, (2, v), that the tyres hold with an angle
        within ``lock`` [rad]; what a slower car cannot, a faster one cannot either."""
        by_lock = np.array([[np.interp(angle, row, self.curvature) for row in self.angle]
                            for angle in lock])
        return np.array([np.maximum.accumulate(np.maximum(by_lock[0], self.ends[0])),
                         np.minimum.accumulate(np.minimum(by_lock[1], self.ends[1]))])

    def fastest(self, curvature: FloatArray, lock: tuple[float, float]) -> FloatArray:
        """Largest speed [m/s] for each curvature [1/m]; 0 where it is too tight for every speed."""
        right, left = self.tightest(lock)
        by_left = np.interp(curvature, left[::-1], SPEEDS[::-1], right=0.0)
        by_right = np.interp(-curvature, -right[::-1], SPEEDS[::-1], right=0.0)
        return np.asarray(np.minimum(by_left, by_right), dtype=np.float64)


def row_of(speed: float) -> tuple[int, float]:
    """Grid row below a speed [m/s] and the share of the way to the next."""
    at = (min(max(abs(speed), SPEEDS[0]), SPEEDS[-1]) - SPEEDS[0]) / (SPEEDS[1] - SPEEDS[0])
    k = min(int(at), len(SPEEDS) - 2)
    return k, float(at - k)


def _solved(p: Vehicle) -> FloatArray:
    """(angle, slip, held) of bends to the right and to the left, (2, 3, v, k)."""
    n = len(SPEEDS)
    l_r = p.body.l_r
    if p.kind == "kinematic":
        angle = np.tile(np.arctan(p.body.wheelbase * CURVATURES), (n, 1))
        return np.array([[sign * angle, 0.0 * angle, 1.0 + 0.0 * angle] for sign in (-1.0, 1.0)])
    v = np.tile(SPEEDS, 2)
    sign = np.repeat((-1.0, 1.0), n)
    rates = make_dynamic(p, ARRAY)

    def unbalanced(x: FloatArray, omega: FloatArray) -> FloatArray:
        vy, delta, force = x
        return np.array(rates(0.0 * v, v, vy, omega, force, 0.0, 0.0, np.cos(delta),
                              np.sin(delta))[3:])

    rows: list[tuple[FloatArray, ...]] = []
    x = np.array([0.0 * v, 0.0 * v, -make_friction(p.friction, ARRAY)(v)])
    held = np.ones(2 * n, dtype=bool)
    before = 0.0
    for k in CURVATURES:
        omega = sign * k * v
        last = x
        x = x + np.outer((l_r, 0.0, 0.0), omega - sign * before * v)
        for _ in range(ROUNDS):
            x = x + _newton(x, omega, unbalanced)
        solved = (np.abs(unbalanced(x, omega)).max(axis=0) < SOLVED) & (np.abs(x[1]) < STEERED)
        held &= solved & ((sign * (x[1] - last[1]) > 0.0) | (k == 0.0))
        x = np.where(held, x, last + np.outer((0.0, 1.0, 0.0), sign * (k - before)))
        slip = np.arctan2(x[0] - l_r * omega, v)
        rows.append((x[1], np.where(held, slip, rows[-1][1] if rows else 0.0), held.copy()))
        before = k
    table: FloatArray = np.array(rows, dtype=float).transpose(1, 2, 0).reshape(3, 2, n, -1)
    return np.swapaxes(table, 0, 1)


def _newton(x: FloatArray, omega: FloatArray,
            unbalanced: Callable[[FloatArray, FloatArray], FloatArray]) -> FloatArray:
    """One step towards balance for all bends at once; none where there is no slope."""
    rest = unbalanced(x, omega)
    slope = np.array([(unbalanced(x + h * e[:, None], omega) - rest) / h
                      for h, e in zip(STEPS, np.eye(3), strict=True)]).transpose(2, 1, 0)
    good = np.abs(np.linalg.det(slope)) > 1e-9
    slope[~good] = np.eye(3)
    step = np.linalg.solve(slope, -rest.T[:, :, None])[:, :, 0].T
    return np.asarray(np.where(good, np.clip(step, -MOST, MOST), 0.0))
