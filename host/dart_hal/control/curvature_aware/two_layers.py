"""Both layers for one sample: a path from where the car is, then the inputs that follow it.

    last plan -> shifted -> path generator -> follower -> plan

Like ``mpc.iteration.Mpcc``, whose place it takes in a tracker: one real-time iteration a sample and
layer, several for a first plan, ``budget`` s by ``clock``; the same outcomes, named and counted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.control.curvature_aware.follower import FollowWeights, Motion, PathFollower
from dart_hal.control.curvature_aware.generator import STAGES, Generator, PathWeights, S, Way
from dart_hal.control.curvature_aware.lane import Bounds
from dart_hal.control.curvature_aware.progress import Law
from dart_hal.control.mpc.iteration import BEGINNING, ITERATIONS
from dart_hal.control.mpc.model import STAGE
from dart_hal.control.mpc.planner import FAR, Aim, Outcome, Plan, Planner
from dart_hal.control.mpc.problem import Limits
from dart_hal.control.paths import Path
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering

# Iterations of a plan that goes on.
STEPS = 2
# m/s; the way ahead must have a length.
SLOWEST = 0.1


@dataclass(frozen=True, slots=True)
class TwoLayerPlan(Plan):
    """A plan whose s is the progress of its generated ``way``."""

    way: Way


class TwoLayers(Planner[TwoLayerPlan]):
    """MPCC or CA-MPCC of one car on one path.

    The wanted speed is asked where each stage is: a path at the speed of here through a bend that
    the tyres hold at less is one on which no input has a slope. law, path_weights,
    follow_weights: as published unless given. Raises UsageError for a path that the car does not
    turn, and for a lane wider than a bend's radius, beside which progress has no meaning.
    """

    def __init__(self, vehicle: Vehicle, path: Path, speed_of: Callable[[FloatArray], FloatArray],
                 limits: Limits | None = None, *, law: Law = Law.CA,
                 path_weights: PathWeights | None = None,
                 follow_weights: FollowWeights | None = None, steps: int = STEPS,
                 iterations: int = ITERATIONS) -> None:
        super().__init__(vehicle, path, speed_of, limits)
        _check(path, self.vehicle, self.limits)
        self.generator = Generator(law, path_weights or PathWeights(), self.reference,
                                   self.limits.lane, self.limits.lateral)
        self.follower = PathFollower(self.vehicle, follow_weights or FollowWeights(), self.limits)
        self.steps = steps
        self.iterations = iterations

    def turn_within(self, low: float, high: float) -> None:
        """See ``Planner``."""
        self.follower.turn_within(low, high)

    def _improved(self, plan: TwoLayerPlan, aim: Aim, *, anew: bool) -> TwoLayerPlan | None:
        """The path by some steps, then the inputs by as many, anew from that path or from the last
        ones; None where late."""
        bounds = self._bounds(aim.t)
        steps = BEGINNING if anew else self.steps
        try:
            with np.errstate(over="ignore", invalid="ignore"):  # it is looked at
                way = self._generated(plan.way, steps, aim, bounds)
                if way is None:
                    return None
                within = bounds(aim.s + way.states[1:, S])
                motion = (self.follower.guess(way, aim.state, self._speeds(aim, way)) if anew
                          else Motion(plan.states, plan.inputs[:2], plan.slopes))
                moved = self._followed(motion, steps, aim, way, within)
        except np.linalg.LinAlgError:
            return replace(plan, outcome=Outcome.DIVERGED)
        if moved is None:
            return None
        blocked = within is not None and self.corridor.blocked
        return _plan(aim, way, moved, Outcome.BLOCKED if blocked else Outcome.SOLVED)

    def _generated(self, way: Way, steps: int, aim: Aim,
                   bounds: Callable[[FloatArray], Bounds | None]) -> Way | None:
        first = self.generator.first(aim.state, aim.s)
        for _ in range(steps):
            better = self.generator.step(way, first, aim.s, self._speeds(aim, way)[:-1], bounds,
                                         self.iterations, aim.late)
            if better is None:
                return None
            way = better
            _near(way.states)
        return way

    def _followed(self, motion: Motion, steps: int, aim: Aim, way: Way,
                  within: Bounds | None) -> Motion | None:
        speeds = self._speeds(aim, way)[1:]
        for _ in range(steps):
            better = self.follower.step(motion, aim.state, way, speeds, within, self.iterations,
                                        aim.late)
            if better is None:
                return None
            motion = better
            _near(motion.states)
        return motion

    def _speeds(self, aim: Aim, way: Way) -> FloatArray:
        """The set speeds [m/s] where the states of a way are, (n + 1,)."""
        return np.maximum(self.speed_of(aim.s + way.states[:, S]), SLOWEST)

    def _ahead(self, aim: Aim) -> FloatArray:
        """The same of the stages of a way along the path, (n,)."""
        s = aim.s
        speeds = []
        for _ in range(STAGES):
            speeds.append(max(float(self.speed_of(np.array([s]))[0]), SLOWEST))
            s += STAGE * speeds[-1]
        return np.array(speeds)

    def _bounds(self, t: float) -> Callable[[FloatArray], Bounds | None]:
        times = t + STAGE * np.arange(1.0, STAGES + 1.0)
        if not self.obstacles:
            return lambda s: None
        return lambda s: self.corridor.bounds(s + self.vehicle.body.l_r, times)

    def _shifted(self, aim: Aim) -> TwoLayerPlan | None:
        last = self.last
        by = self._stages_since(aim)
        if last is None or not 0 <= by < STAGES:
            return None
        motion = self.follower.shifted(Motion(last.states, last.inputs[:2], last.slopes), by)
        way = self.generator.shifted(last.way, aim.s, self._speeds(aim, last.way)[1:], by)
        return _plan(aim, way, motion, last.outcome)

    def _guess(self, aim: Aim) -> TwoLayerPlan:
        way = self.generator.guess(self.generator.first(aim.state, aim.s), aim.s, self._ahead(aim))
        motion = self.follower.guess(way, aim.state, self._speeds(aim, way))
        return _plan(aim, way, motion, Outcome.SOLVED)


def _plan(aim: Aim, way: Way, motion: Motion, outcome: Outcome) -> TwoLayerPlan:
    s = way.states[:, S]
    inputs = np.vstack([motion.inputs, np.diff(s) / STAGE])
    return TwoLayerPlan(aim.t, motion.states, aim.s + s, inputs, outcome, motion.slopes, way)


def _near(states: FloatArray) -> None:
    """Raises LinAlgError for a plan that runs away, as its next programme would."""
    if not np.abs(states - states[0]).max() < FAR:
        raise np.linalg.LinAlgError("the plan diverged")


def _check(path: Path, p: Vehicle, limits: Limits) -> None:
    curve = make_steering(p.steering)
    k = path.curvature
    right, left = (float(np.tan(curve(st))) / p.body.wheelbase for st in limits.st)
    tight = np.flatnonzero((k > left) | (k < right))
    if len(tight):
        i = int(tight[np.argmax(np.abs(k[tight]))])
        most = left if k[i] > 0.0 else -right
        raise UsageError(f"the path is tighter than the car turns: at {path.s[i]:.2f} m",
                         found=f"a radius of {1.0 / abs(k[i]):.3f} m",
                         expected=f"at least {1.0 / most:.3f} m", remedy="widen the bend")
    radius = 1.0 / max(float(np.abs(k).max()), 1e-9)
    if limits.lane >= radius:
        raise UsageError("the lane is wider than a bend's radius, so that it has no inside",
                         found=f"{limits.lane:g} m to either side, a radius of {radius:.3f} m",
                         expected="a lane narrower than the tightest bend",
                         remedy=f"a lane of {0.5 * radius:.2f} m, or a wider bend")
