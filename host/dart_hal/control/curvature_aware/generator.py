"""High level: the path of the next 1.5 s, driven at set speeds, that stays in the lane.

    MPCC      q_con e_lat^2 + q_lag e_lag^2         CA-MPCC   q_con |p - p_r|^2
    both      + q_u u^2 + 100 slack^2,   at the end  q_tpos |p - p_r|^2 - q_trot cos(psi - phi)

With the same weight for both errors the two costs are one, and only the progress differs. The
cosine is taken as 2 sin^2((psi - phi) / 2), which is a square.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import NamedTuple

import numpy as np

from dart_hal.control.curvature_aware.curvature import GRID, curvature, weights_of
from dart_hal.control.curvature_aware.lane import Bounds, beside, keep
from dart_hal.control.curvature_aware.programme import RHO_INPUT, Programme, slopes
from dart_hal.control.curvature_aware.progress import Law, make_rates, make_stage
from dart_hal.control.mpc.model import STAGE
from dart_hal.control.mpc.problem import GRIP, condensed
from dart_hal.control.mpc.reference import Reference
from dart_hal.core.types import FloatArray

# 1.5 s.
STAGES = 15
# Of the way at the set speed over all stages: how far the path ahead is known.
REACH = 1.2
# rad/s at most.
TURNS = 10.0
# Of ``Limits.lateral``: all that the tyres hold; bends are driven at 0.9 of it.
HOLD = 1.0 / GRIP
X, Y, PSI, S, X_R, Y_R, PHI = range(7)


@dataclass(frozen=True, slots=True)
class PathWeights:
    """As published: q_con, q_lag, q_u, q_tpos, q_trot."""

    contour: float = 0.1
    lag: float = 0.1
    input: float = 0.01
    end_position: float = 1.0
    end_turn: float = 1.0


# With which the car does not cut the bends.
TUNED = PathWeights(contour=10.0, lag=10.0)
WEIGHTS = {"published": PathWeights(), "tuned": TUNED}


class Way(NamedTuple):
    """states (n + 1, 7) as in ``progress``, s from the first on; turns (n,): u [rad/s]."""

    states: FloatArray
    turns: FloatArray

    def error(self, reference: Reference, s: float) -> FloatArray:
        """Progress planned less that of the closest point [m] at each stage behind the first,
        (n,); s [m]: of the first state."""
        near = s
        error = self.states[1:, S] + s
        for k, (x, y) in enumerate(self.states[1:, :2]):
            near = reference.path.closest(float(x), float(y), near)
            error[k] -= near
        return error


class Generator:
    """One high level; ``half`` [m]: of the lane; lateral [m/s2]: as ``Limits``. What no tyres hold
    is no path: low levels that follow one go from stop to stop."""

    def __init__(self, law: Law, weights: PathWeights, reference: Reference, half: float,
                 lateral: float = inf) -> None:
        self.law = law
        self.weights = weights
        self.reference = reference
        self.half = half
        self._held = HOLD * lateral
        w = weights
        lag = w.lag if law is Law.MPCC else w.contour
        self._across = np.full(STAGES, w.contour)
        self._along = np.full(STAGES, lag)
        self._across[-1] = self._along[-1] = w.end_position
        self._turn = np.zeros(STAGES)
        self._turn[-1] = 2.0 * w.end_turn

    def first(self, state: FloatArray, s: float) -> FloatArray:
        """State (7,) of a car (8,) whose closest point is at arc length s [m]."""
        x, y, psi = state[:3]
        x_r, y_r, phi = (float(v[0]) for v in self.reference.spots(np.array([s])))
        phi += 2.0 * np.pi * round((psi - phi) / (2.0 * np.pi))
        return np.array([x, y, psi, 0.0, x_r, y_r, phi])

    def guess(self, first: FloatArray, s: float, speeds: FloatArray) -> Way:
        """Along the path itself, at the speeds (n,) [m/s] of the stages."""
        way = np.append(0.0, np.cumsum(STAGE * speeds))
        x, y, phi = self.reference.spots(s + way)
        phi = phi + first[PHI] - phi[0]
        states = np.stack([x, y, phi, way, x, y, phi], axis=1)
        return Way(states, speeds * self.reference.curvatures(s + way[:-1]))

    def stage(self, s: float, speed: float | FloatArray,
              mean: float | None = None) -> Callable[..., tuple[FloatArray, ...]]:
        """One stage of the dynamics, from arc length s [m] on at a speed [m/s], or as many as
        stages (n,); mean [m/s]: of all stages, where speed is that of one."""
        length = REACH * STAGES * STAGE * (float(np.mean(speed)) if mean is None else mean)
        k = weights_of(self.reference.curvatures(s + length * GRID))
        return make_stage(make_rates(self.law, speed, lambda at: curvature(at, k, length)), STAGE)

    def shifted(self, way: Way, s: float, speeds: FloatArray, by: int) -> Way:
        """A plan ``by`` stages later, seen from arc length s [m] = that stage's; its end goes on as
        it was, at the last of the speeds (n,) [m/s]."""
        states = way.states.copy()
        turns = way.turns
        states[:, S] -= states[by, S]
        stage = self.stage(s, float(speeds[-1]), float(speeds.mean()))
        for _ in range(by):
            end = np.array(stage(*states[-1], turns[-1]))
            states = np.vstack([states[1:], end])
            turns = np.append(turns[1:], turns[-1])
        return Way(states, turns)

    def step(self, way: Way, first: FloatArray, s: float, speeds: FloatArray,
             bounds: Callable[[FloatArray], Bounds | None], iterations: int,
             late: Callable[[], bool]) -> Way | None:
        """One linearisation and one programme from the state ``first`` (7,) at the speeds (n,)
        [m/s] of the stages; None where late.

        bounds(s of the stages (n,)): what obstacles leave.
        """
        states, turns = way
        after, slope = slopes(self.stage(s, speeds), np.column_stack([states[:-1], turns]))
        moved = condensed(first - states[0], slope[:, :, :7], slope[:, :, 7:], after - states[1:])
        programme = Programme(moved)
        at, by = programme.through(*slopes(_errors, states[1:]))
        for column, weight in enumerate((self._across, self._along, self._turn)):
            programme.squares(at[:, column], by[:, column], weight)
        one = np.eye(STAGES, programme.size)
        programme.squares(turns, one, self.weights.input)
        most = np.minimum(TURNS, self._held / speeds)
        programme.bound(turns, one, -most, most, RHO_INPUT)
        keep(programme, at[:, 3:], by[:, 3:], self.half, bounds(s + states[1:, S]))
        found = programme.solved(iterations, late)
        if found is None:
            return None
        change = np.clip(turns + found[:STAGES], -most, most) - turns
        moved_by = moved.free + moved.forced @ change
        return Way(np.vstack([first, states[1:] + moved_by]), turns + change)


def _errors(x: FloatArray, y: FloatArray, psi: FloatArray, _s: FloatArray, x_r: FloatArray,
            y_r: FloatArray, phi: FloatArray) -> tuple[FloatArray, ...]:
    """across, along, half the sine of the turn beside the path; distance, across."""
    apart, across = beside(x, y, x_r, y_r, phi)
    along = np.cos(phi) * (x - x_r) + np.sin(phi) * (y - y_r)
    return across, along, np.sin(0.5 * (psi - phi)), apart, across
