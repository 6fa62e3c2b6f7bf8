"""Base class of planning controllers: for each sample, a plan from the last one in limited time.

    last plan -> shift -> improve -> plan

A plan that takes longer than ``budget`` s by ``clock`` is discarded and the last plan is continued
(``PlanOutcome.LATE``): its next stages were planned for this time. The clock is read before each
ten iterations of the solver, so a plan may take as much longer as ten of them. Without a last plan
the guess along the path is returned as LATE.

A plan that diverges is restarted from such a guess; if that diverges too, the outcome is
``DIVERGED``. If obstacles leave no passage, it is ``BLOCKED``. All outcomes are counted, also the
DIVERGED of a plan that was restarted; the caller decides when to brake.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from dart_hal.control.mpc.model import N_STATES, STAGE_PERIOD
from dart_hal.control.mpc.obstacles import Corridor, Obstacle
from dart_hal.control.mpc.problem import MpcLimits
from dart_hal.control.mpc.reference import PathReference
from dart_hal.control.paths import Path
from dart_hal.core.types import FloatArray, TextEnum
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.parameters import Vehicle

# Largest distance of a state to the first one of a plan that has not diverged, in m, m/s, ...
DIVERGENCE_LIMIT = 1e3


class PlanOutcome(TextEnum):
    """How a plan was obtained, see the module."""

    SOLVED = "SOLVED"
    BLOCKED = "BLOCKED"
    LATE = "LATE"
    DIVERGED = "DIVERGED"


@dataclass(frozen=True, slots=True)
class MpcPlan:
    """A sequence of states and inputs.

    t [s]: time of the first state; states (n + 1, 8) as in ``model``, x and y of the rear axle;
    s (n + 1,) [m]; inputs (3, n): tau, st, v_s [m/s], each constant for ``STAGE_PERIOD``;
    slopes (n, 8, 8): of each state to the previous one, of the newest linearisation: zeros for a
    guess, those of the last plan where it was only shifted.
    """

    t: float
    states: FloatArray
    s: FloatArray
    inputs: FloatArray
    outcome: PlanOutcome
    slopes: FloatArray

    def state_at(self, t: float) -> FloatArray:
        """Interpolate the state (8,) at a time [s] of the plan."""
        times = self.t + STAGE_PERIOD * np.arange(len(self.states))
        return np.array([np.interp(t, times, row) for row in self.states.T])

    def covariances(self, first: FloatArray, per_stage: FloatArray) -> FloatArray:
        """Propagate the covariance of the first state, P_k+1 = A P_k A' + Q, to (n + 1, 8, 8).

        first, per_stage (8, 8): covariance of the first state, and what each stage adds.
        """
        result = [first]
        for a in self.slopes:
            result.append(a @ result[-1] @ a.T + per_stage)
        return np.array(result)


PlanT = TypeVar("PlanT", bound=MpcPlan)


class PlanRequest(NamedTuple):
    """Data of one sample.

    t [s]; state (8,): first state; s [m]: its progress; last_inputs: tau and st that act until t;
    is_late: whether the time budget is over.
    """

    t: float
    state: FloatArray
    s: float
    last_inputs: tuple[float, float]
    is_late: Callable[[], bool]


class MpcPlanner(ABC, Generic[PlanT]):
    """Planner of one car on one path.

    speed_of(s): target speed [m/s] at progresses (n,) [m]; limits: None = those of the vehicle's
    model. ``outcomes`` counts. ``budget`` [s] for a plan and ``clock``, which measures it, may be
    set.
    """

    def __init__(self, vehicle: Vehicle, path: Path, speed_of: Callable[[FloatArray], FloatArray],
                 limits: MpcLimits | None) -> None:
        self.vehicle = apply_parameter_effects(vehicle)
        self.speed_of = speed_of
        self.limits = limits or MpcLimits(tau=(-vehicle.duty_motor.g, 1.0))
        self.reference = PathReference(path)
        self.corridor = Corridor(self.limits.lane, path.length if path.closed else inf)
        self.budget = inf
        self.clock: Callable[[], float] = lambda: 0.0
        self.outcomes: Counter[PlanOutcome] = Counter()
        self.last: PlanT | None = None

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """Obstacles to be passed; may be set at any time."""
        return self.corridor.obstacles

    @obstacles.setter
    def obstacles(self, obstacles: tuple[Obstacle, ...]) -> None:
        self.corridor.obstacles = tuple(obstacles)

    def reset(self) -> None:
        """Forget the last plan."""
        self.last = None

    def plan(
        self, t: float, state: FloatArray, s: float, last_inputs: tuple[float, float]
    ) -> PlanT:
        """Plan from the state (8,) at t [s], when the inputs take effect, at progress s [m].

        1. Shift the last plan to t; without one, start from a guess along the path.
        2. Improve it. If it diverges, improve the guess instead, with more iterations.
        3. If the time is over, return what step 1 gave, or the guess of step 2, as LATE.
        4. For a state that is not finite, return it as DIVERGED.

        last_inputs: tau, st that act until then.
        """
        end = self.clock() + self.budget if self.budget < inf else inf
        request = PlanRequest(t, state, s, last_inputs, lambda: end < inf and self.clock() > end)
        guess = self._shift_last_plan(request)
        if not np.isfinite(state).all():
            origin = request._replace(state=np.zeros(N_STATES))
            return self._record(
                replace(guess or self._initial_guess(origin), outcome=PlanOutcome.DIVERGED)
            )
        plan = self._improve(guess, request, from_guess=False) if guess else None
        if guess is None or (plan is not None and plan.outcome is PlanOutcome.DIVERGED):
            self.outcomes[PlanOutcome.DIVERGED] += plan is not None
            guess = self._initial_guess(request)
            plan = self._improve(guess, request, from_guess=True)
        return self._record(plan or replace(guess, outcome=PlanOutcome.LATE))

    @abstractmethod
    def set_steering_range(self, low: float, high: float) -> None:
        """Set the range of the steering command, which the disturbance estimate shifts."""

    @abstractmethod
    def _shift_last_plan(self, request: PlanRequest) -> PlanT | None:
        """Return the last plan from ``request.t`` on with its last input repeated, or None."""

    @abstractmethod
    def _initial_guess(self, request: PlanRequest) -> PlanT:
        """Return a plan along the path without slip."""

    @abstractmethod
    def _improve(self, plan: PlanT, request: PlanRequest, *, from_guess: bool) -> PlanT | None:
        """Iterate a plan; more often from a guess. None if late; outcome DIVERGED if it diverges.
        """

    def _stages_since_last(self, request: PlanRequest) -> int:
        """Return the number of stages since the last plan, or -1 if it cannot be shifted."""
        return round((request.t - self.last.t) / STAGE_PERIOD) if self.last else -1

    def _record(self, plan: PlanT) -> PlanT:
        """Count the outcome and store the plan for the next sample."""
        self.outcomes[plan.outcome] += 1
        self.last = None if plan.outcome is PlanOutcome.DIVERGED else plan
        return plan
