"""One stage of the prediction: the car by the equations of ``vehicle``, with its actuators.

    state   (x, y, psi, v_x, v_y, omega, tau, st)     x, y: rear axle; v_x, v_y: centre of mass;
    input   (tau_c, st_c)                             tau, st: commands -1..1 after their lags

An input is constant during the stage. The lateral motion has rates of about 190/v per s, so no
explicit step of 0.1 s is stable, nor one of 10 ms at walking pace. Therefore v_y and omega are
integrated linearly implicitly (a Rosenbrock method with theta = 0.55) in steps of 25 ms, with the
slopes at the beginning of the stage. The lags are exact.

Near standstill those slopes cannot be used: a lateral speed of 1 cm/s is then 6 deg of slip, where
the tyre curve is flat, and the step becomes an explicit one with rates beyond 1000/s. At 0.3 m/s a
lateral speed of 2 cm/s lasts longer than a stage and has slopes of 15, which diverge over 20
stages. Between ``MIN_SLIPPING_SPEED`` and ``MAX_ROLLING_SPEED`` the model therefore blends into
rolling without slip.

Pure delays are compensated by the caller, which predicts the state to the time at which the input
acts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.bicycle import make_dynamic, make_kinematic
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.motor import make_motor_gains
from dart_hal.vehicle.namespace import Value, adapt
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering
from dart_hal.vehicle.step import lag_decay

# Duration of a stage, for which an input is constant [s].
STAGE_PERIOD = 0.1
# Integration steps in a stage.
SUBSTEPS_PER_STAGE = 4
# Speed up to which the car rolls without slip, and from which the tyres act alone [m/s]. Tyre
# slopes can be used from 0.5 m/s on: in a bend of 0.6 m that is a lateral acceleration of 0.4 m/s2,
# at which the published tyres slip by 0.3 to 0.9 deg.
MAX_ROLLING_SPEED = 0.2
MIN_SLIPPING_SPEED = 0.5
# Implicitness. 0.5 is of second order and oscillates at walking pace; 1 is off by 1 to 2 cm in a
# bend.
THETA = 0.55
# Increment of a state or input in the finite differences. Rounding changes a slope by about the
# precision of a result over this increment, 1e-16 / 1e-6, so by less than 1e-9.
DIFFERENCE_STEP = 1e-6
# Sizes of state and input.
N_STATES = 8
N_INPUTS = 2
# Indices of the states with slopes by differences; the slopes to the pose follow from geometry.
DIFFERENCED_STATES = (3, 4, 5, 6, 7)

StageFunction = Callable[..., tuple[Value, ...]]
VelocityStep = Callable[..., tuple[Value, Value, Value]]
# Next states (n, 8), slopes to states (n, 8, 8) and to inputs (n, 8, 2).
Linearisation = tuple[FloatArray, FloatArray, FloatArray]
# Function of states (n, 8) and inputs (n, 2).
Lineariser = Callable[[FloatArray, FloatArray], Linearisation]


def make_stage(p: Vehicle, xp: Any = np, dt: float = STAGE_PERIOD) -> StageFunction:
    """Return ``stage(x, y, psi, v_x, v_y, omega, tau, st, tau_c, st_c)``: the state dt [s] later.

    xp: numpy for many stages at once, casadi for an optimiser.
    """
    f = adapt(xp)
    p = apply_parameter_effects(p)
    h = dt / SUBSTEPS_PER_STAGE
    # Each lag as (0 if it has none else 1, its decay in half of a step).
    (has_lag_t, decay_t), (has_lag_s, decay_s) = (
        lag_decay(lag, h, f) for lag in (p.delay.throttle_lag_s, p.delay.steering_lag_s)
    )
    l_r = p.body.l_r
    make_step = _make_rolling_step if p.kind == "kinematic" else _make_slipping_step
    prepare_step = make_step(p, f, h)

    def stage(x: Value, y: Value, psi: Value, vx: Value, vy: Value, om: Value, tau: Value,
              st: Value, tau_c: Value, st_c: Value) -> tuple[Value, ...]:
        # Difference of the lagged command to the input; it decays exponentially.
        tau_lag = has_lag_t * (tau - tau_c)
        st_lag = has_lag_s * (st - st_c)
        step_velocity = prepare_step(vx, vy, om, tau_c + decay_t * tau_lag, st_c + decay_s * st_lag)
        for _ in range(SUBSTEPS_PER_STAGE):
            # 1. Mean commands of the step, then the velocity at its end.
            mean_commands = tau_c + decay_t * tau_lag, st_c + decay_s * st_lag
            tau_lag = decay_t * decay_t * tau_lag
            st_lag = decay_s * decay_s * st_lag
            vx1, vy1, om1 = step_velocity(vx, vy, om, *mean_commands, st_c + st_lag)
            # 2. The rear axle moves with the mean velocity, in the direction of the mean heading.
            v_along = 0.5 * (vx + vx1)
            v_lateral = 0.5 * (vy + vy1) - 0.5 * l_r * (om + om1)
            d_psi = 0.5 * h * (om + om1)
            c = f.cos(psi + 0.5 * d_psi)
            s = f.sin(psi + 0.5 * d_psi)
            x = x + h * (v_along * c - v_lateral * s)
            y = y + h * (v_along * s + v_lateral * c)
            psi = psi + d_psi
            vx = vx1
            vy = vy1
            om = om1
        return x, y, psi, vx, vy, om, tau_c + tau_lag, st_c + st_lag

    return stage


def _make_slipping_step(p: Vehicle, f: Any, h: float) -> Callable[..., VelocityStep]:
    """Return ``prepare_step(v_x, v_y, omega, tau, st)``, which linearises at the start of a stage
    and returns ``step_velocity(v_x, v_y, omega, tau, st, st at the end)``.
    """
    rates = make_dynamic(p, f)
    gains = make_motor_gains(p.motor, f)
    brake = _make_brake(p, f)
    steering = make_steering(p.steering, f)
    implicit = THETA * h
    step_rolling = _make_rolling_step(p, f, h)()

    def derivatives(vx: Value, vy: Value, om: Value, tau: Value,
                    st: Value) -> tuple[Value, Value, Value]:
        (k0, k1) = gains(tau)
        delta = steering(st)
        _, _, _, ax, ay, om_dot = rates(0.0, vx, vy, om, k0, k1, brake(tau), f.cos(delta),
                                        f.sin(delta))
        return ax, ay, om_dot

    def prepare_step(vx: Value, vy: Value, om: Value, tau: Value, st: Value) -> VelocityStep:
        vx = f.fmax(vx, MAX_ROLLING_SPEED)  # below it the step does not use these slopes
        # Slopes of (v_y', omega') to (v_y, omega) by differences. The implicit step solves
        #     (I - theta h J) change = h (v_y', omega')
        # with the 2 x 2 matrix ((a, -b), (-c, d)) below; h_over_det is h over its determinant.
        _, ay, om_dot = derivatives(vx, vy, om, tau, st)
        _, ay_v, om_dot_v = derivatives(vx, vy + DIFFERENCE_STEP, om, tau, st)
        _, ay_o, om_dot_o = derivatives(vx, vy, om + DIFFERENCE_STEP, tau, st)
        scale = implicit / DIFFERENCE_STEP
        a = 1.0 - scale * (ay_v - ay)
        b = scale * (ay_o - ay)
        c = scale * (om_dot_v - om_dot)
        d = 1.0 - scale * (om_dot_o - om_dot)
        h_over_det = h / (a * d - b * c)

        def step_velocity(vx: Value, vy: Value, om: Value, tau: Value, st: Value,
                          st_end: Value) -> tuple[Value, Value, Value]:
            ax, ay, om_dot = derivatives(f.fmax(vx, MAX_ROLLING_SPEED), vy, om, tau, st)
            slip_share = f.fmax(0.0, f.fmin(1.0, (vx - MAX_ROLLING_SPEED)
                                            / (MIN_SLIPPING_SPEED - MAX_ROLLING_SPEED)))
            slipping = (
                vx + h * ax,
                vy + h_over_det * (d * ay + b * om_dot),
                om + h_over_det * (c * ay + a * om_dot),
            )
            vx, vy, om = (
                r + slip_share * (s - r)
                for r, s in zip(step_rolling(vx, vy, om, tau, st, st_end), slipping, strict=True)
            )
            return vx, vy, om

        return step_velocity

    return prepare_step


def _make_rolling_step(p: Vehicle, f: Any, h: float) -> Callable[..., VelocityStep]:
    """As ``_make_slipping_step`` for a car that rolls without slip."""
    rates = make_kinematic(p, f)
    gains = make_motor_gains(p.motor, f)
    brake = _make_brake(p, f)
    steering = make_steering(p.steering, f)

    def step_velocity(vx: Value, _vy: Value, _om: Value, tau: Value, _st: Value,
                      st_end: Value) -> tuple[Value, Value, Value]:
        (k0, k1) = gains(tau)
        tan_delta = f.tan(steering(st_end))
        _, _, _, ax = rates(0.0, vx, k0, k1, brake(tau), tan_delta)
        vx = vx + h * ax
        _, vy, om, _ = rates(0.0, vx, k0, k1, 0.0, tan_delta)
        return vx, vy, om

    return lambda *_: step_velocity


def _make_brake(p: Vehicle, f: Any) -> Callable[[Value], Value]:
    """Return ``brake(tau)`` [N]: for each throttle below the dead band the force that the motor has
    above it."""
    motor = p.duty_motor
    return lambda tau: motor.d * f.fmax(0.0, -motor.g - tau)


def linearise(
    stage: StageFunction,
    states: FloatArray,
    inputs: FloatArray,
) -> Linearisation:
    """Return the next states and their slopes by finite differences.

    All stages and all variations are one batch of a single evaluation.
    """
    n = len(states)
    variations = len(DIFFERENCED_STATES) + N_INPUTS
    point = np.concatenate([states, inputs], axis=1)
    batch = np.repeat(point.T[:, None, :], 1 + variations, axis=1)
    for row, column in enumerate((*DIFFERENCED_STATES, N_STATES, N_STATES + 1), start=1):
        batch[column, row] += DIFFERENCE_STEP
    results = np.array(stage(*batch))
    next_state = results[:, 0]
    slopes = ((results[:, 1:] - next_state[:, None]) / DIFFERENCE_STEP).transpose(2, 0, 1)
    a = np.zeros((n, N_STATES, N_STATES))
    a[:, :, DIFFERENCED_STATES] = slopes[:, :, : len(DIFFERENCED_STATES)]
    a[:, (0, 1, 2), (0, 1, 2)] = 1.0
    a[:, 0, 2] = states[:, 1] - next_state[1]
    a[:, 1, 2] = next_state[0] - states[:, 0]
    return next_state.T, a, slopes[:, :, len(DIFFERENCED_STATES) :]
