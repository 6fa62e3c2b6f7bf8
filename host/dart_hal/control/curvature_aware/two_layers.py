"""Both layers for one sample: a path from the pose of the car, then the inputs that follow it.

    last plan -> shift -> path generator -> follower -> plan

A planner as ``mpc.iteration.Mpcc``: one real-time iteration for each sample and layer, several for
a first plan, ``budget`` s by ``clock``, and the same outcomes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.control.curvature_aware.follower import FollowedMotion, FollowWeights, PathFollower
from dart_hal.control.curvature_aware.generator import (
    COL_S,
    PATH_STAGES,
    GeneratedPath,
    PathGenerator,
    PathWeights,
)
from dart_hal.control.curvature_aware.lane import Bounds
from dart_hal.control.curvature_aware.progress import Law
from dart_hal.control.mpc.iteration import INITIAL_STEPS, QP_ITERATIONS
from dart_hal.control.mpc.model import STAGE_PERIOD
from dart_hal.control.mpc.planner import (
    DIVERGENCE_LIMIT,
    MpcPlan,
    MpcPlanner,
    PlanOutcome,
    PlanRequest,
)
from dart_hal.control.mpc.problem import MpcLimits
from dart_hal.control.paths import Path
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering

# Iterations of a shifted plan.
STEPS_PER_PLAN = 2
# Smallest set speed [m/s]; the path ahead must have a length.
MIN_SPEED = 0.1


@dataclass(frozen=True, slots=True)
class TwoLayerPlan(MpcPlan):
    """A plan whose s is the progress of its generated path ``way``."""

    way: GeneratedPath


class TwoLayers(MpcPlanner[TwoLayerPlan]):
    """MPCC or CA-MPCC of one car on one path.

    The target speed is evaluated at the position of each stage: with the present speed, a path
    through a bend that the tyres hold at less would have no slope to any input. law, path_weights,
    follow_weights: default as published. Raises UsageError for a path that the car cannot drive,
    and for a lane wider than the radius of a bend, where progress is undefined.
    """

    def __init__(self, vehicle: Vehicle, path: Path, speed_of: Callable[[FloatArray], FloatArray],
                 limits: MpcLimits | None = None, *, law: Law = Law.CA,
                 path_weights: PathWeights | None = None,
                 follow_weights: FollowWeights | None = None, steps: int = STEPS_PER_PLAN,
                 iterations: int = QP_ITERATIONS) -> None:
        super().__init__(vehicle, path, speed_of, limits)
        _check_path(path, self.vehicle, self.limits)
        self.generator = PathGenerator(law, path_weights or PathWeights(), self.reference,
                                       self.limits.lane, self.limits.lateral)
        self.follower = PathFollower(self.vehicle, follow_weights or FollowWeights(), self.limits)
        self.steps = steps
        self.iterations = iterations

    def set_steering_range(self, low: float, high: float) -> None:
        """See ``MpcPlanner``."""
        self.follower.set_steering_range(low, high)

    def _improve(
        self, plan: TwoLayerPlan, request: PlanRequest, *, from_guess: bool
    ) -> TwoLayerPlan | None:
        """Improve the path, then the inputs, from the last ones or from a guess; None if late."""
        bounds_at = self._bounds(request.t)
        steps = INITIAL_STEPS if from_guess else self.steps
        try:
            with np.errstate(over="ignore", invalid="ignore"):  # checked below
                way = self._generate(plan.way, steps, request, bounds_at)
                if way is None:
                    return None
                bounds = bounds_at(request.s + way.states[1:, COL_S])
                motion = (
                    self.follower.guess(way, request.state, self._speeds(request, way))
                    if from_guess
                    else FollowedMotion(plan.states, plan.inputs[:2], plan.slopes)
                )
                followed = self._follow(motion, steps, request, way, bounds)
        except np.linalg.LinAlgError:
            return replace(plan, outcome=PlanOutcome.DIVERGED)
        if followed is None:
            return None
        blocked = bounds is not None and self.corridor.blocked
        return _plan(request, way, followed, PlanOutcome.BLOCKED if blocked else PlanOutcome.SOLVED)

    def _generate(self, way: GeneratedPath, steps: int, request: PlanRequest,
                  bounds_at: Callable[[FloatArray], Bounds | None]) -> GeneratedPath | None:
        """Improve the path by a number of steps; None if late."""
        first_state = self.generator.first_state(request.state, request.s)
        for _ in range(steps):
            improved = self.generator.step(
                way,
                first_state,
                request.s,
                self._speeds(request, way)[:-1],
                bounds_at,
                self.iterations,
                request.is_late,
            )
            if improved is None:
                return None
            way = improved
            _check_divergence(way.states)
        return way

    def _follow(self, motion: FollowedMotion, steps: int, request: PlanRequest, way: GeneratedPath,
                bounds: Bounds | None) -> FollowedMotion | None:
        """Improve the inputs by a number of steps; None if late."""
        speeds = self._speeds(request, way)[1:]
        for _ in range(steps):
            improved = self.follower.step(
                motion, request.state, way, speeds, bounds, self.iterations, request.is_late
            )
            if improved is None:
                return None
            motion = improved
            _check_divergence(motion.states)
        return motion

    def _speeds(self, request: PlanRequest, way: GeneratedPath) -> FloatArray:
        """Return the set speeds [m/s] at the states of a path, (n + 1,)."""
        return np.maximum(self.speed_of(request.s + way.states[:, COL_S]), MIN_SPEED)

    def _speeds_along_path(self, request: PlanRequest) -> FloatArray:
        """Return the set speeds [m/s] of the stages of a path along the reference, (n,)."""
        s = request.s
        speeds = []
        for _ in range(PATH_STAGES):
            speeds.append(max(float(self.speed_of(np.array([s]))[0]), MIN_SPEED))
            s += STAGE_PERIOD * speeds[-1]
        return np.array(speeds)

    def _bounds(self, t: float) -> Callable[[FloatArray], Bounds | None]:
        """Return the function of the bounds by obstacles."""
        times = t + STAGE_PERIOD * np.arange(1.0, PATH_STAGES + 1.0)
        if not self.obstacles:
            return lambda s: None
        return lambda s: self.corridor.bounds(s + self.vehicle.body.l_r, times)

    def _shift_last_plan(self, request: PlanRequest) -> TwoLayerPlan | None:
        last = self.last
        stages = self._stages_since_last(request)
        if last is None or not 0 <= stages < PATH_STAGES:
            return None
        motion = self.follower.shift(
            FollowedMotion(last.states, last.inputs[:2], last.slopes), stages
        )
        way = self.generator.shift(last.way, request.s, self._speeds(request, last.way)[1:], stages)
        return _plan(request, way, motion, last.outcome)

    def _initial_guess(self, request: PlanRequest) -> TwoLayerPlan:
        way = self.generator.guess(
            self.generator.first_state(request.state, request.s),
            request.s,
            self._speeds_along_path(request),
        )
        motion = self.follower.guess(way, request.state, self._speeds(request, way))
        return _plan(request, way, motion, PlanOutcome.SOLVED)


def _plan(
    request: PlanRequest, way: GeneratedPath, motion: FollowedMotion, outcome: PlanOutcome
) -> TwoLayerPlan:
    s = way.states[:, COL_S]
    inputs = np.vstack([motion.inputs, np.diff(s) / STAGE_PERIOD])
    return TwoLayerPlan(
        request.t, motion.states, request.s + s, inputs, outcome, motion.slopes, way
    )


def _check_divergence(states: FloatArray) -> None:
    """Raise LinAlgError for a plan that diverges, as its next programme would."""
    if not np.abs(states - states[0]).max() < DIVERGENCE_LIMIT:
        raise np.linalg.LinAlgError("the plan diverged")


def _check_path(path: Path, p: Vehicle, limits: MpcLimits) -> None:
    """Raise UsageError for a path that is too tight, or a lane that is too wide."""
    curve = make_steering(p.steering)
    k = path.curvature
    right, left = (float(np.tan(curve(st))) / p.body.wheelbase for st in limits.st)
    tight = np.flatnonzero((k > left) | (k < right))
    if len(tight):
        i = int(tight[np.argmax(np.abs(k[tight]))])
        limit = left if k[i] > 0.0 else -right
        raise UsageError(f"the path is tighter than the car turns: at {path.s[i]:.2f} m",
                         found=f"a radius of {1.0 / abs(k[i]):.3f} m",
                         expected=f"at least {1.0 / limit:.3f} m", remedy="widen the bend")
    radius = 1.0 / max(float(np.abs(k).max()), 1e-9)
    if limits.lane >= radius:
        raise UsageError("the lane is wider than a bend's radius, so that it has no inside",
                         found=f"{limits.lane:g} m to either side, a radius of {radius:.3f} m",
                         expected="a lane narrower than the tightest bend",
                         remedy=f"a lane of {0.5 * radius:.2f} m, or a wider bend")
