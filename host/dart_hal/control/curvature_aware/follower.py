"""Low level: throttle and steering that keep the car on the generated path.

    q_v (v_x - V)^2 + q_acc a_x^2 + q_pos |p - p_ref|^2 + q_rot (psi - psi_ref)^2
    + q_u (tau^2 + st^2) + 100 slack^2,     at the end  q_v, q_tpos, q_trot

within the same lane. p: rear axle, the point that goes where the car looks; p_ref, psi_ref and the
lane's middle: of the high level, stage by stage; a_x: the mean of a stage. The car is that of
``control.mpc.model``, kinematic or dynamic, with actuators that lag where the vehicle has lags:
the published one has none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dart_hal.control.curvature_aware.generator import PHI, PSI, STAGES, X_R, Y_R, Way
from dart_hal.control.curvature_aware.lane import Bounds, beside, keep
from dart_hal.control.curvature_aware.programme import RHO_INPUT, Programme, slopes
from dart_hal.control.drivetrain import Inverse
from dart_hal.control.mpc.model import STAGE, linearised, make_stage
from dart_hal.control.mpc.problem import Limits, condensed
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering_inverse

V_X = 3
# m/s2 of the first guess.
GAINS = 3.0
# Most that is taken of a step of the steering.
LARGEST = 0.8


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


class Motion(NamedTuple):
    """states (n + 1, 8) as in ``mpc.model``; inputs (2, n): tau, st; slopes (n, 8, 8)."""

    states: FloatArray
    inputs: FloatArray
    slopes: FloatArray


class PathFollower:
    """One low level of a vehicle."""

    def __init__(self, vehicle: Vehicle, weights: FollowWeights, limits: Limits) -> None:
        self.weights = weights
        self.limits = limits
        w = weights
        self.stage = make_stage(vehicle, np)
        self._vehicle = vehicle
        self._place = np.full(STAGES, w.position)
        self._turn = np.full(STAGES, w.turn)
        self._place[-1] = w.end_position
        self._turn[-1] = w.end_turn
        self._low, self._high = (np.repeat((limits.tau[i], limits.st[i]), STAGES) for i in (0, 1))

    def turn_within(self, low: float, high: float) -> None:
        """Ends of the steering from now on."""
        self._low[STAGES:] = low
        self._high[STAGES:] = high

    def guess(self, way: Way, state: FloatArray, speeds: FloatArray) -> Motion:
        """On the path, without slip, at speeds that come to the wanted ones (n + 1,) [m/s]."""
        p = self._vehicle
        v = float(state[V_X])
        pace = np.minimum(v + GAINS * STAGE * np.arange(STAGES + 1.0), np.maximum(speeds, v))
        turns = np.append(way.turns, way.turns[-1])
        bend = turns / np.maximum(speeds, 0.1)
        command = make_steering_inverse(p.steering)
        st = np.clip([command(float(np.arctan(p.body.wheelbase * k))) for k in bend],
                     *self.limits.st)
        hold = Inverse(p).throttle(max(float(pace.mean()), 0.1))
        tau = np.full(STAGES + 1, min(max(hold, self.limits.tau[0]), self.limits.tau[1]))
        om = bend * pace
        x, y, psi = way.states[:, :3].T
        states = np.stack([x, y, psi, pace, p.body.l_r * om, om, tau, st], axis=1)
        return Motion(states, np.array([tau[:-1], st[:-1]]), np.zeros((STAGES, 8, 8)))

    def shifted(self, motion: Motion, by: int) -> Motion:
        """A plan ``by`` stages later; its end goes on as it was."""
        states, inputs, all_ = motion
        for _ in range(by):
            end = np.array(self.stage(*states[-1], *inputs[:, -1]))
            states = np.vstack([states[1:], end])
            inputs = np.hstack([inputs[:, 1:], inputs[:, -1:]])
        return Motion(states, inputs, all_)

    def step(self, motion: Motion, state: FloatArray, way: Way, speeds: FloatArray,
             bounds: Bounds | None, iterations: int, late: Callable[[], bool]) -> Motion | None:
        """One linearisation and one programme from the state (8,), towards the speeds (n,) [m/s]
        behind the stages; None where late."""
        states = motion.states
        inputs = motion.inputs
        w = self.weights
        reference = way.states[1:]
        after, a, b = linearised(self.stage, states[:-1], inputs.T)
        moved = condensed(state - states[0], a, b, after - states[1:])
        programme = Programme(moved)
        at, by = programme.through(*slopes(_errors, np.column_stack(
            [states[1:], reference[:, (X_R, Y_R, PHI)]])))
        for column, wanted, weight in ((0, reference[:, 0], self._place),
                                       (1, reference[:, 1], self._place),
                                       (2, reference[:, PSI], self._turn),
                                       (3, speeds, np.full(STAGES, w.speed))):
            programme.squares(at[:, column] - wanted, by[:, column], weight)
        faster = np.diff(np.append(state[V_X], at[:, 3])) / STAGE
        programme.squares(faster, np.diff(by[:, 3], axis=0, prepend=0.0) / STAGE, w.acceleration)
        one = np.eye(2 * STAGES, programme.size)
        held = inputs.ravel()
        programme.squares(held, one, w.input)
        programme.bound(held, one, self._low, self._high, RHO_INPUT)
        keep(programme, at[:, 4:], by[:, 4:], self.limits.lane, bounds)
        found = programme.solved(iterations, late)
        if found is None:
            return None
        change = np.clip(held + found[:2 * STAGES], self._low, self._high) - held
        most = np.abs(change[STAGES:]).max()
        change = change * min(1.0, LARGEST / most) if most > LARGEST else change
        return Motion(np.vstack([state, states[1:] + moved.free + moved.forced @ change]),
                      inputs + change.reshape(2, STAGES), a)


def _errors(x: FloatArray, y: FloatArray, psi: FloatArray, v_x: FloatArray, _vy: FloatArray,
            _om: FloatArray, _tau: FloatArray, _st: FloatArray, x_r: FloatArray, y_r: FloatArray,
            phi: FloatArray) -> tuple[FloatArray, ...]:
    return x, y, psi, v_x, *beside(x, y, x_r, y_r, phi)
