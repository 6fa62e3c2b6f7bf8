"""Low level: throttle and steering that follow the generated path.

    q_v (v_x - V)^2 + q_acc a_x^2 + q_pos |p - p_ref|^2 + q_rot (psi - psi_ref)^2
    + q_u (tau^2 + st^2) + 100 slack^2,     at the end  q_v, q_tpos, q_trot

within the same lane. p: rear axle, whose motion has the direction of the heading; p_ref, psi_ref
and the centre of the lane: of the high level, stage by stage; a_x: the mean of a stage. The car is
that of ``control.mpc.model``, kinematic or dynamic, with the lags of the actuators; the published
one has none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dart_hal.control.curvature_aware.generator import (
    COL_PHI,
    COL_PSI,
    COL_X_R,
    COL_Y_R,
    PATH_STAGES,
    GeneratedPath,
)
from dart_hal.control.curvature_aware.lane import Bounds, add_lane_rows, lane_distances
from dart_hal.control.curvature_aware.programme import (
    RHO_INPUT,
    LeastSquaresProgramme,
    differentiate,
)
from dart_hal.control.drivetrain import InverseDrive
from dart_hal.control.mpc.model import STAGE_PERIOD, linearise, make_stage
from dart_hal.control.mpc.problem import MpcLimits, condense
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering_inverse

# Column of the speed.
COL_V_X = 3
# Acceleration of the first guess [m/s2].
GUESS_ACCELERATION = 3.0
# Largest applied step of the steering.
MAX_STEERING_STEP = 0.8


@dataclass(frozen=True, slots=True)
class FollowWeights:
    """As published: q_v, q_acc, q_pos, q_rot, q_u, q_tpos, q_trot."""

    speed: float = 0.1
    acceleration: float = 0.03
    position: float = 1.0
    turn: float = 1.0
    input: float = 0.01
    end_position: float = 5.0
    end_turn: float = 5.0


class FollowedMotion(NamedTuple):
    """States (n + 1, 8) as in ``mpc.model``; inputs (2, n): tau, st; slopes (n, 8, 8)."""

    states: FloatArray
    inputs: FloatArray
    slopes: FloatArray


class PathFollower:
    """Low level for one vehicle."""

    def __init__(self, vehicle: Vehicle, weights: FollowWeights, limits: MpcLimits) -> None:
        self.weights = weights
        self.limits = limits
        w = weights
        self.stage = make_stage(vehicle, np)
        self._vehicle = vehicle
        self._position_weights = np.full(PATH_STAGES, w.position)
        self._heading_weights = np.full(PATH_STAGES, w.turn)
        self._position_weights[-1] = w.end_position
        self._heading_weights[-1] = w.end_turn
        self._low, self._high = (
            np.repeat((limits.tau[i], limits.st[i]), PATH_STAGES) for i in (0, 1)
        )

    def set_steering_range(self, low: float, high: float) -> None:
        """Set the range of the steering command."""
        self._low[PATH_STAGES:] = low
        self._high[PATH_STAGES:] = high

    def guess(self, path: GeneratedPath, state: FloatArray, speeds: FloatArray) -> FollowedMotion:
        """Return a motion on the path without slip, with speeds that ramp up to (n + 1,) [m/s]."""
        p = self._vehicle
        v = float(state[COL_V_X])
        speed = np.minimum(
            v + GUESS_ACCELERATION * STAGE_PERIOD * np.arange(PATH_STAGES + 1.0),
            np.maximum(speeds, v),
        )
        turns = np.append(path.turns, path.turns[-1])
        bend = turns / np.maximum(speeds, 0.1)
        command = make_steering_inverse(p.steering)
        st = np.clip([command(float(np.arctan(p.body.wheelbase * k))) for k in bend],
                     *self.limits.st)
        tau_hold = InverseDrive(p).throttle(max(float(speed.mean()), 0.1))
        tau = np.full(PATH_STAGES + 1, min(max(tau_hold, self.limits.tau[0]), self.limits.tau[1]))
        om = bend * speed
        x, y, psi = path.states[:, :3].T
        states = np.stack([x, y, psi, speed, p.body.l_r * om, om, tau, st], axis=1)
        return FollowedMotion(states, np.array([tau[:-1], st[:-1]]), np.zeros((PATH_STAGES, 8, 8)))

    def shift(self, motion: FollowedMotion, stages: int) -> FollowedMotion:
        """Return the motion ``stages`` later; its end repeats the last inputs."""
        states, inputs, slopes = motion
        for _ in range(stages):
            end = np.array(self.stage(*states[-1], *inputs[:, -1]))
            states = np.vstack([states[1:], end])
            inputs = np.hstack([inputs[:, 1:], inputs[:, -1:]])
        return FollowedMotion(states, inputs, slopes)

    def step(
        self,
        motion: FollowedMotion,
        state: FloatArray,
        path: GeneratedPath,
        speeds: FloatArray,
        bounds: Bounds | None,
        iterations: int,
        is_late: Callable[[], bool],
    ) -> FollowedMotion | None:
        """Do one Gauss-Newton step from the state (8,) towards the speeds (n,) [m/s] of the stages.

        Returns None if late.
        """
        states = motion.states
        inputs = motion.inputs
        w = self.weights
        reference = path.states[1:]
        next_states, a, b = linearise(self.stage, states[:-1], inputs.T)
        condensed = condense(state - states[0], a, b, next_states - states[1:])
        programme = LeastSquaresProgramme(condensed)
        values, slopes = programme.condense(*differentiate(_errors, np.column_stack(
            [states[1:], reference[:, (COL_X_R, COL_Y_R, COL_PHI)]])))
        for column, target, weight in ((0, reference[:, 0], self._position_weights),
                                       (1, reference[:, 1], self._position_weights),
                                       (2, reference[:, COL_PSI], self._heading_weights),
                                       (3, speeds, np.full(PATH_STAGES, w.speed))):
            programme.add_squares(values[:, column] - target, slopes[:, column], weight)
        acceleration = np.diff(np.append(state[COL_V_X], values[:, 3])) / STAGE_PERIOD
        programme.add_squares(
            acceleration, np.diff(slopes[:, 3], axis=0, prepend=0.0) / STAGE_PERIOD, w.acceleration
        )
        identity = np.eye(2 * PATH_STAGES, programme.size)
        flat_inputs = inputs.ravel()
        programme.add_squares(flat_inputs, identity, w.input)
        programme.add_bounds(flat_inputs, identity, self._low, self._high, RHO_INPUT)
        add_lane_rows(programme, values[:, 4:], slopes[:, 4:], self.limits.lane, bounds)
        solution = programme.solve(iterations, is_late)
        if solution is None:
            return None
        change = (
            np.clip(flat_inputs + solution[: 2 * PATH_STAGES], self._low, self._high) - flat_inputs
        )
        max_change = np.abs(change[PATH_STAGES:]).max()
        change = (
            change * min(1.0, MAX_STEERING_STEP / max_change)
            if max_change > MAX_STEERING_STEP
            else change
        )
        return FollowedMotion(
            np.vstack([state, states[1:] + condensed.free + condensed.forced @ change]),
            inputs + change.reshape(2, PATH_STAGES),
            a,
        )


def _errors(x: FloatArray, y: FloatArray, psi: FloatArray, v_x: FloatArray, _vy: FloatArray,
            _om: FloatArray, _tau: FloatArray, _st: FloatArray, x_r: FloatArray, y_r: FloatArray,
            phi: FloatArray) -> tuple[FloatArray, ...]:
    """Return position, heading, speed, distance and lateral error."""
    return x, y, psi, v_x, *lane_distances(x, y, x_r, y_r, phi)
