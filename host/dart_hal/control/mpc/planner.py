"""What a controller that plans is: a plan for each sample, within its time, from the last one.

    last plan -> shifted -> improved -> plan

A plan is made within ``budget`` s by ``clock``, or not at all: then the last plan goes on
(``Outcome.LATE``), which is what its first stages were made for. One that runs away is begun anew
from the path; where that does as well, it is ``DIVERGED``. Where obstacles leave no way, a plan is
``BLOCKED``. All are counted; who asks decides when to brake.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from math import inf
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from dart_hal.control.mpc.model import STAGE
from dart_hal.control.mpc.obstacles import Corridor, Obstacle
from dart_hal.control.mpc.problem import Limits
from dart_hal.control.mpc.reference import Reference
from dart_hal.control.paths import Path
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.parameters import Vehicle

# m, m/s, ... from the first state to any of a plan that has not diverged.
FAR = 1e3
STATES = 8


class Outcome(str, Enum):
    """How a plan came about."""

    SOLVED = "SOLVED"
    BLOCKED = "BLOCKED"
    LATE = "LATE"
    DIVERGED = "DIVERGED"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, slots=True)
class Plan:
    """t [s] of the first state; states (n + 1, 8) as in ``model``, x and y of the rear axle;
    s (n + 1,) [m]; inputs (3, n): tau, st, v_s [m/s], each held for ``STAGE``; slopes (n, 8, 8)
    of each state to the one before."""

    t: float
    states: FloatArray
    s: FloatArray
    inputs: FloatArray
    outcome: Outcome
    slopes: FloatArray

    def at(self, t: float) -> FloatArray:
        """State (8,) at a time [s] of the plan."""
        times = self.t + STAGE * np.arange(len(self.states))
        return np.array([np.interp(t, times, row) for row in self.states.T])

    def covariances(self, first: FloatArray, per_stage: FloatArray) -> FloatArray:
        """(n + 1, 8, 8) from that of the first state, with what each stage adds, both (8, 8)."""
        all_ = [first]
        for a in self.slopes:
            all_.append(a @ all_[-1] @ a.T + per_stage)
        return np.array(all_)


PlanT = TypeVar("PlanT", bound=Plan)


class Aim(NamedTuple):
    """What a sample asks: t [s], first state (8,), progress s [m], tau and st that act until then,
    whether time is over."""

    t: float
    state: FloatArray
    s: float
    before: tuple[float, float]
    late: Callable[[], bool]


class Planner(ABC, Generic[PlanT]):
    """One car on one path. ``speed_of(s)``: wanted speed [m/s] at progresses (n,) [m]; ``limits``:
    None = of the vehicle, without any of the car's own; ``outcomes`` counts.

    budget [s] for a plan, and clock, which tells them; both may be set.
    """

    def __init__(self, vehicle: Vehicle, path: Path, speed_of: Callable[[FloatArray], FloatArray],
                 limits: Limits | None) -> None:
        self.vehicle = settled(vehicle)
        self.speed_of = speed_of
        self.limits = limits or Limits(tau=(-vehicle.motor.g, 1.0))
        self.reference = Reference(path)
        self.corridor = Corridor(self.limits.lane, path.length if path.closed else inf)
        self.budget = inf
        self.clock: Callable[[], float] = lambda: 0.0
        self.outcomes: Counter[Outcome] = Counter()
        self.last: PlanT | None = None

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """What is to be passed; may be set at any time."""
        return self.corridor.obstacles

    @obstacles.setter
    def obstacles(self, obstacles: tuple[Obstacle, ...]) -> None:
        self.corridor.obstacles = tuple(obstacles)

    def reset(self) -> None:
        """Forget the last plan."""
        self.last = None

    def plan(self, t: float, state: FloatArray, s: float, before: tuple[float, float]) -> PlanT:
        """From the state (8,) at t [s], when the answer acts, at progress s [m].

        before: tau, st that act until then.
        """
        end = self.clock() + self.budget if self.budget < inf else inf
        aim = Aim(t, state, s, before, lambda: end < inf and self.clock() > end)
        guess = self._shifted(aim)
        if not np.isfinite(state).all():
            nowhere = aim._replace(state=np.zeros(STATES))
            return self._kept(replace(guess or self._guess(nowhere), outcome=Outcome.DIVERGED))
        plan = self._improved(guess, aim, anew=False) if guess else None
        if guess is None or (plan is not None and plan.outcome is Outcome.DIVERGED):
            self.outcomes[Outcome.DIVERGED] += plan is not None
            guess = self._guess(aim)
            plan = self._improved(guess, aim, anew=True)
        return self._kept(plan or replace(guess, outcome=Outcome.LATE))

    @abstractmethod
    def turn_within(self, low: float, high: float) -> None:
        """Ends of the steering from now on: what is learnt of it moves them."""

    @abstractmethod
    def _shifted(self, aim: Aim) -> PlanT | None:
        """The last plan from ``aim.t`` on; its end goes on as it was. None: there is none."""

    @abstractmethod
    def _guess(self, aim: Aim) -> PlanT:
        """Along the path, without slip."""

    @abstractmethod
    def _improved(self, plan: PlanT, aim: Aim, *, anew: bool) -> PlanT | None:
        """A sample's steps on, more of them from a guess; None where late, or DIVERGED."""

    def _stages_since(self, aim: Aim) -> int:
        """Stages from the last plan on, -1: there is none, or it began later."""
        return round((aim.t - self.last.t) / STAGE) if self.last else -1

    def _kept(self, plan: PlanT) -> PlanT:
        self.outcomes[plan.outcome] += 1
        self.last = None if plan.outcome is Outcome.DIVERGED else plan
        return plan
