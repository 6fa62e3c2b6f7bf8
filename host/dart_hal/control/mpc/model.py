"""One stage of the prediction: the car by the equations of ``vehicle``, with its actuators.

    state   (x, y, psi, v_x, v_y, omega, tau, st)     x, y: rear axle; v_x, v_y: centre of mass;
    input   (tau_c, st_c)                             tau, st: commands -1..1 behind their lags

An input is held over the stage. The motion across the car settles with about 190/v per s: no
explicit step of 0.1 s, nor of 10 ms at walking pace, is stable. v_y and omega are therefore
linearly implicit (a Rosenbrock method with theta = 0.55) in steps of 25 ms, with the slopes at the
stage's begin; the lags are exact.

Towards rest those slopes are of no use: there 1 cm/s across is 6 deg of slip, a tyre that slips is
flatter than the same tyre when it holds, and the step is then an explicit one, of rates beyond
1000/s. At 0.3 m/s a motion across of 2 cm/s outlives a stage and has slopes of 15, which over 20
stages run away. From ``SLIPS`` down to ``ROLLS`` the car therefore comes to roll without slip.

Pure delays are the caller's, who predicts the state to the time
at which the input acts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.bicycle import make_dynamic, make_kinematic
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.motor import make_motor_gains
from dart_hal.vehicle.namespace import Value, adapt
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering
from dart_hal.vehicle.step import decay

# s for which an input is held, and the steps in it.
STAGE = 0.1
SUBSTEPS = 4
# m/s: without slip below, by the tyres above, whose slopes are well from 0.5 on. In a bend of 0.6
# m 0.5 m/s is 0.4 m/s2 across, which the published tyres hold at 0.3 to 0.9 deg of slip.
ROLLS = 0.2
SLIPS = 0.5
# 0.5 is of second order and rings at walking pace; 1 loses 1 to 2 cm in a bend.
THETA = 0.55
# Of a state or input, for its slopes: the rounding of double precision stays below 1e-9.
SLOPE = 1e-6
STATES = 8
INPUTS = 2
# States whose slopes are differences; those of the pose are its geometry.
VARIED = (3, 4, 5, 6, 7)

Stage = Callable[..., tuple[Value, ...]]
Velocity = Callable[..., tuple[Value, Value, Value]]
# Next states (n, 8), slopes to states (n, 8, 8) and to inputs (n, 8, 2).
Linearised = tuple[FloatArray, FloatArray, FloatArray]
# Of states (n, 8) and inputs (n, 2).
Linearise = Callable[[FloatArray, FloatArray], Linearised]


def make_stage(p: Vehicle, xp: Any = np, dt: float = STAGE) -> Stage:
    """``stage(x, y, psi, v_x, v_y, omega, tau, st, tau_c, st_c)``: the state dt [s] later.

    xp: numpy for many stages at once, casadi for an optimiser.
    """
    f = adapt(xp)
    p = settled(p)
    h = dt / SUBSTEPS
    (on_t, half_t), (on_s, half_s) = (
        decay(lag, h, f) for lag in (p.delay.throttle_lag_s, p.delay.steering_lag_s)
    )
    l_r = p.body.l_r
    begin = _rolling(p, f, h) if p.kind == "kinematic" else _slipping(p, f, h)

    def stage(x: Value, y: Value, psi: Value, vx: Value, vy: Value, om: Value, tau: Value,
              st: Value, tau_c: Value, st_c: Value) -> tuple[Value, ...]:
        tau = on_t * (tau - tau_c)
        st = on_s * (st - st_c)  # what is left of the way to the input
        move = begin(vx, vy, om, tau_c + half_t * tau, st_c + half_s * st)
        for _ in range(SUBSTEPS):
            middle = tau_c + half_t * tau, st_c + half_s * st
            tau = half_t * half_t * tau
            st = half_s * half_s * st
            vx1, vy1, om1 = move(vx, vy, om, *middle, st_c + st)
            along = 0.5 * (vx + vx1)
            across = 0.5 * (vy + vy1) - 0.5 * l_r * (om + om1)
            turned = 0.5 * h * (om + om1)
            c = f.cos(psi + 0.5 * turned)
            s = f.sin(psi + 0.5 * turned)
            x = x + h * (along * c - across * s)
            y = y + h * (along * s + across * c)
            psi = psi + turned
            vx = vx1
            vy = vy1
            om = om1
        return x, y, psi, vx, vy, om, tau_c + tau, st_c + st

    return stage


def _slipping(p: Vehicle, f: Any, h: float) -> Callable[..., Velocity]:
    """``begin(v_x, v_y, omega, tau, st) -> move(v_x, v_y, omega, tau, st, st at the end)``."""
    rates = make_dynamic(p, f)
    gains = make_motor_gains(p.motor, f)
    steering = make_steering(p.steering, f)
    implicit = THETA * h
    rolling = _rolling(p, f, h)()

    def change(vx: Value, vy: Value, om: Value, tau: Value,
               st: Value) -> tuple[Value, Value, Value]:
        (k0, k1) = gains(tau)
        delta = steering(st)
        _, _, _, ax, ay, turning = rates(0.0, vx, vy, om, k0, k1, 0.0, f.cos(delta), f.sin(delta))
        return ax, ay, turning

    def begin(vx: Value, vy: Value, om: Value, tau: Value, st: Value) -> Velocity:
        vx = f.fmax(vx, ROLLS)  # slower, this has no part in the move
        _, ay, turning = change(vx, vy, om, tau, st)
        _, ay_v, turning_v = change(vx, vy + SLOPE, om, tau, st)
        _, ay_o, turning_o = change(vx, vy, om + SLOPE, tau, st)
        per = implicit / SLOPE
        a = 1.0 - per * (ay_v - ay)
        b = per * (ay_o - ay)
        c = per * (turning_v - turning)
        d = 1.0 - per * (turning_o - turning)
        det = h / (a * d - b * c)

        def move(vx: Value, vy: Value, om: Value, tau: Value, st: Value,
                 end: Value) -> tuple[Value, Value, Value]:
            ax, ay, turning = change(f.fmax(vx, ROLLS), vy, om, tau, st)
            part = f.fmax(0.0, f.fmin(1.0, (vx - ROLLS) / (SLIPS - ROLLS)))
            slipping = (
                vx + h * ax,
                vy + det * (d * ay + b * turning),
                om + det * (c * ay + a * turning),
            )
            vx, vy, om = (
                r + part * (s - r)
                for r, s in zip(rolling(vx, vy, om, tau, st, end), slipping, strict=True)
            )
            return vx, vy, om

        return move

    return begin


def _rolling(p: Vehicle, f: Any, h: float) -> Callable[..., Velocity]:
    rates = make_kinematic(p, f)
    gains = make_motor_gains(p.motor, f)
    steering = make_steering(p.steering, f)

    def move(vx: Value, _vy: Value, _om: Value, tau: Value, _st: Value,
             end: Value) -> tuple[Value, Value, Value]:
        (k0, k1) = gains(tau)
        turn = f.tan(steering(end))
        _, _, _, ax = rates(0.0, vx, k0, k1, 0.0, turn)
        vx = vx + h * ax
        _, vy, om, _ = rates(0.0, vx, k0, k1, 0.0, turn)
        return vx, vy, om

    return lambda *_: move


def linearised(
    stage: Stage,
    states: FloatArray,
    inputs: FloatArray,
) -> Linearised:
    """Next states and slopes by differences.

    All stages and all variations are lanes of one evaluation.
    """
    n = len(states)
    varied = len(VARIED) + INPUTS
    point = np.concatenate([states, inputs], axis=1)
    lanes = np.repeat(point.T[:, None, :], 1 + varied, axis=1)
    for lane, column in enumerate((*VARIED, STATES, STATES + 1), start=1):
        lanes[column, lane] += SLOPE
    after = np.array(stage(*lanes))
    end = after[:, 0]
    slopes = ((after[:, 1:] - end[:, None]) / SLOPE).transpose(2, 0, 1)
    a = np.zeros((n, STATES, STATES))
    a[:, :, VARIED] = slopes[:, :, : len(VARIED)]
    a[:, (0, 1, 2), (0, 1, 2)] = 1.0
    a[:, 0, 2] = states[:, 1] - end[1]
    a[:, 1, 2] = end[0] - states[:, 0]
    return end.T, a, slopes[:, :, len(VARIED) :]
