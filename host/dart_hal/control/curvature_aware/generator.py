"""High level: the path of the next 1.5 s, driven at set speeds, that stays in the lane.

    MPCC      q_con e_lat^2 + q_lag e_lag^2         CA-MPCC   q_con |p - p_r|^2
    both      + q_u u^2 + 100 slack^2,   at the end  q_tpos |p - p_r|^2 - q_trot cos(psi - phi)

With equal weights of both errors the two costs are the same, and only the progress differs. The
cosine is replaced by 2 sin^2((psi - phi) / 2), which is a square.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import NamedTuple

import numpy as np

from dart_hal.control.curvature_aware.curvature import GRID, curvature, fit_weights
from dart_hal.control.curvature_aware.lane import Bounds, add_lane_rows, lane_distances
from dart_hal.control.curvature_aware.programme import (
    RHO_INPUT,
    LeastSquaresProgramme,
    differentiate,
)
from dart_hal.control.curvature_aware.progress import Law, make_rates, make_stage
from dart_hal.control.mpc.model import STAGE_PERIOD
from dart_hal.control.mpc.problem import TYRE_SHARE, condense
from dart_hal.control.mpc.reference import PathReference
from dart_hal.core.types import FloatArray

# Number of stages: 1.5 s.
PATH_STAGES = 15
# Length of the known path ahead, relative to the distance at the set speed.
LOOKAHEAD_FACTOR = 1.2
# Largest turn rate [rad/s].
MAX_TURN_RATE = 10.0
# Lateral limit relative to ``MpcLimits.lateral``: the full force of the tyres; bends are driven
# with 0.9 of it.
LATERAL_FACTOR = 1.0 / TYRE_SHARE
COL_X, COL_Y, COL_PSI, COL_S, COL_X_R, COL_Y_R, COL_PHI = range(7)


@dataclass(frozen=True, slots=True)
class PathWeights:
    """As published: q_con, q_lag, q_u, q_tpos, q_trot."""

    contour: float = 0.1
    lag: float = 0.1
    input: float = 0.01
    end_position: float = 1.0
    end_turn: float = 1.0


# Weights with which the car does not cut the bends.
TUNED = PathWeights(contour=10.0, lag=10.0)
WEIGHTS = {"published": PathWeights(), "tuned": TUNED}


class GeneratedPath(NamedTuple):
    """States (n + 1, 7) as in ``progress``, s relative to the first; turns (n,): u [rad/s]."""

    states: FloatArray
    turns: FloatArray

    def error(self, reference: PathReference, s: float) -> FloatArray:
        """Return the planned progress minus that of the closest point [m] at each stage after the
        first, (n,).

        s [m]: of the first state.
        """
        s_closest = s
        error = self.states[1:, COL_S] + s
        for k, (x, y) in enumerate(self.states[1:, :2]):
            s_closest = reference.path.closest(float(x), float(y), s_closest)
            error[k] -= s_closest
        return error


class PathGenerator:
    """Path generator.

    half [m]: half width of the lane; lateral [m/s2]: as ``MpcLimits``. Paths beyond the tyres are
    excluded: low levels that follow one go from stop to stop.
    """

    def __init__(self, law: Law, weights: PathWeights, reference: PathReference, half: float,
                 lateral: float = inf) -> None:
        self.law = law
        self.weights = weights
        self.reference = reference
        self.half = half
        self._max_lateral = LATERAL_FACTOR * lateral
        w = weights
        lag = w.lag if law is Law.MPCC else w.contour
        self._across = np.full(PATH_STAGES, w.contour)
        self._along = np.full(PATH_STAGES, lag)
        self._across[-1] = self._along[-1] = w.end_position
        self._turn = np.zeros(PATH_STAGES)
        self._turn[-1] = 2.0 * w.end_turn

    def first_state(self, state: FloatArray, s: float) -> FloatArray:
        """Return the state (7,) of a car (8,) whose closest point is at arc length s [m]."""
        x, y, psi = state[:3]
        x_r, y_r, phi = (float(v[0]) for v in self.reference.poses(np.array([s])))
        phi += 2.0 * np.pi * round((psi - phi) / (2.0 * np.pi))
        return np.array([x, y, psi, 0.0, x_r, y_r, phi])

    def guess(self, first_state: FloatArray, s: float, speeds: FloatArray) -> GeneratedPath:
        """Return a path along the reference at the speeds (n,) [m/s] of the stages."""
        progress = np.append(0.0, np.cumsum(STAGE_PERIOD * speeds))
        x, y, phi = self.reference.poses(s + progress)
        phi = phi + first_state[COL_PHI] - phi[0]
        states = np.stack([x, y, phi, progress, x, y, phi], axis=1)
        return GeneratedPath(states, speeds * self.reference.curvatures(s + progress[:-1]))

    def stage(self, s: float, speed: float | FloatArray,
              mean: float | None = None) -> Callable[..., tuple[FloatArray, ...]]:
        """Return one stage of the dynamics from arc length s [m] on.

        speed [m/s]: of one stage, or (n,) of all; mean [m/s]: of all stages, if speed is that of
        one.
        """
        length = (
            LOOKAHEAD_FACTOR
            * PATH_STAGES
            * STAGE_PERIOD
            * (float(np.mean(speed)) if mean is None else mean)
        )
        k = fit_weights(self.reference.curvatures(s + length * GRID))
        return make_stage(
            make_rates(self.law, speed, lambda progress: curvature(progress, k, length)),
            STAGE_PERIOD,
        )

    def shift(
        self, path: GeneratedPath, s: float, speeds: FloatArray, stages: int
    ) -> GeneratedPath:
        """Return the path ``stages`` later, relative to arc length s [m]; its end repeats the last
        turn rate.

        speeds (n,) [m/s]: the last one applies to the new stages.
        """
        states = path.states.copy()
        turns = path.turns
        states[:, COL_S] -= states[stages, COL_S]
        stage = self.stage(s, float(speeds[-1]), float(speeds.mean()))
        for _ in range(stages):
            end = np.array(stage(*states[-1], turns[-1]))
            states = np.vstack([states[1:], end])
            turns = np.append(turns[1:], turns[-1])
        return GeneratedPath(states, turns)

    def step(self, path: GeneratedPath, first_state: FloatArray, s: float, speeds: FloatArray,
             bounds_at: Callable[[FloatArray], Bounds | None], iterations: int,
             is_late: Callable[[], bool]) -> GeneratedPath | None:
        """Do one Gauss-Newton step from the first state (7,); None if late.

        speeds (n,) [m/s]: of the stages; bounds_at(s of the stages (n,)): bounds by obstacles.
        """
        states, turns = path
        next_states, slope = differentiate(
            self.stage(s, speeds), np.column_stack([states[:-1], turns])
        )
        condensed = condense(
            first_state - states[0], slope[:, :, :7], slope[:, :, 7:], next_states - states[1:]
        )
        programme = LeastSquaresProgramme(condensed)
        values, slopes = programme.condense(*differentiate(_errors, states[1:]))
        for column, weight in enumerate((self._across, self._along, self._turn)):
            programme.add_squares(values[:, column], slopes[:, column], weight)
        identity = np.eye(PATH_STAGES, programme.size)
        programme.add_squares(turns, identity, self.weights.input)
        max_turn_rate = np.minimum(MAX_TURN_RATE, self._max_lateral / speeds)
        programme.add_bounds(turns, identity, -max_turn_rate, max_turn_rate, RHO_INPUT)
        add_lane_rows(
            programme, values[:, 3:], slopes[:, 3:], self.half, bounds_at(s + states[1:, COL_S])
        )
        solution = programme.solve(iterations, is_late)
        if solution is None:
            return None
        change = np.clip(turns + solution[:PATH_STAGES], -max_turn_rate, max_turn_rate) - turns
        state_change = condensed.free + condensed.forced @ change
        return GeneratedPath(np.vstack([first_state, states[1:] + state_change]), turns + change)


def _errors(x: FloatArray, y: FloatArray, psi: FloatArray, _s: FloatArray, x_r: FloatArray,
            y_r: FloatArray, phi: FloatArray) -> tuple[FloatArray, ...]:
    """Return lateral and lag error, half the sine of the heading error; distance, lateral error."""
    distance, across = lane_distances(x, y, x_r, y_r, phi)
    along = np.cos(phi) * (x - x_r) + np.sin(phi) * (y - y_r)
    return across, along, np.sin(0.5 * (psi - phi)), distance, across
