"""Real-time iteration: one Newton-type step of the whole problem for each sample.

    last plan -> shifted -> linearised at every stage -> condensed -> solved -> one step -> plan

A plan is made within ``budget`` s by ``clock``, or not at all: then the last plan goes on
(``Outcome.LATE``), which is what its first stages were made for. One that runs away is begun anew
from the path; where that does as well, it is ``DIVERGED``. Where obstacles leave no way, a plan is
``BLOCKED``. All are counted; who asks decides when to brake.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from math import inf
from typing import NamedTuple

import numpy as np

from dart_hal.control.drivetrain import Inverse
from dart_hal.control.mpc import generated
from dart_hal.control.mpc.admm import Sweep, solve, swept
from dart_hal.control.mpc.model import STAGE, Linearise, linearised, make_stage
from dart_hal.control.mpc.obstacles import Corridor, Obstacle
from dart_hal.control.mpc.problem import ST, V_S, Limits, Problem, Weights, condensed
from dart_hal.control.mpc.reference import Reference
from dart_hal.control.paths import Path
from dart_hal.types import FloatArray
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering

HORIZON = 20
"""Stages: 2 s, 4 m at 2 m/s, a half circle of 0.75 m and the straights beside it."""
ITERATIONS, BEGINNING = 40, 8
"""Of the quadratic programme; steps of a first plan."""
LARGE, LARGEST, MORE = 0.4, 0.8, 2
"""A step of the steering that asks for one more iteration, the most that is taken of one, and how
many more there are."""
FAR = 1e3
"""m, m/s, ... from the first state to any of a plan that has not diverged."""
GAINS = 3.0
"""m/s2 of the first guess."""


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


class _Aim(NamedTuple):
    """What a sample asks: first state, progress, what acts until then, whether time is over."""

    state: FloatArray
    s: float
    before: tuple[float, float]
    late: Callable[[], bool]


class Mpcc:
    """Model predictive contouring control of one car on one path.

    ``speed_of(s)``: wanted speed [m/s] at progresses (n,) [m]. ``outcomes`` counts.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        path: Path,
        speed_of: Callable[[FloatArray], FloatArray],
        limits: Limits | None = None,
        weights: Weights | None = None,
        horizon: int = HORIZON,
        iterations: int = ITERATIONS,
        compiled: bool = False,
    ) -> None:
        """limits None: of the vehicle, without any of the car's own; compiled: by generated C,
        see ``generated``."""
        self.vehicle, self.speed_of = settled(vehicle), speed_of
        self.limits = limits or Limits(tau=(-vehicle.motor.g, 1.0))
        self.problem = Problem(horizon, weights or Weights(), self.limits)
        self.stage = make_stage(self.vehicle, np)
        self._linearise: Linearise = partial(linearised, self.stage)
        self._sweep: Sweep = swept
        if compiled:
            self._linearise, self._sweep = generated.compiled(self.vehicle), generated.sweep()
        self.reference = Reference(path)
        self.corridor = Corridor(self.limits.lane, path.length if path.closed else inf)
        self.iterations = iterations
        self.budget = inf
        self.clock: Callable[[], float] = lambda: 0.0
        """s for a plan, and what tells them; both may be set."""
        self.line = inf
        """m of the path before which the rear axle has to stand; may be set at any time."""
        self.outcomes: Counter[Outcome] = Counter()
        self.last: Plan | None = None

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

    def plan(self, t: float, state: FloatArray, s: float, before: tuple[float, float]) -> Plan:
        """From the state (8,) at t [s], when the answer acts, at progress s [m].

        before: tau, st that act until then.
        """
        end = self.clock() + self.budget if self.budget < inf else inf
        aim = _Aim(state, s, before, lambda: end < inf and self.clock() > end)
        guess = self._shifted(t)
        if not np.isfinite(state).all():
            self.last, guess = None, guess or self._guess(t, np.zeros(len(state)), s)
            self.outcomes[Outcome.DIVERGED] += 1
            return replace(guess, outcome=Outcome.DIVERGED)
        plan = self._iterated(guess, 1, aim) if guess else None
        if guess is None or (plan is not None and plan.outcome is Outcome.DIVERGED):
            self.outcomes[Outcome.DIVERGED] += plan is not None
            guess = self._guess(t, state, s)
            plan = self._iterated(guess, BEGINNING, aim)
        plan = plan or replace(guess, outcome=Outcome.LATE)
        self.outcomes[plan.outcome] += 1
        self.last = None if plan.outcome is Outcome.DIVERGED else plan
        return plan

    def _iterated(self, plan: Plan, steps: int, aim: _Aim) -> Plan | None:
        """So many steps on, and some more where the steering still turns; None where late."""
        more = MORE if steps == 1 else 0
        while steps:
            with np.errstate(over="ignore", invalid="ignore"):  # it is looked at below
                after = self._step(plan, aim)
            if after is None:
                return None
            if not np.abs(after.states - after.states[0]).max() < FAR:
                return replace(plan, outcome=Outcome.DIVERGED)
            turned, plan = np.abs(after.inputs[ST] - plan.inputs[ST]).max(), after
            steps -= 1
            if not steps and more and turned > LARGE:
                steps, more = 1, more - 1
        return plan

    def _step(self, plan: Plan, aim: _Aim) -> Plan | None:
        """One linearisation and one programme; None where it was late."""
        inputs, states = plan.inputs, plan.states
        state, s, before, late = aim
        after, a, b = self._linearise(states[:-1], inputs[:V_S].T)
        moved = condensed(state - states[0], a, b, after - states[1:])
        way = self.problem.progress(s, inputs[V_S])
        errors = self.reference.errors(states[1:, 0], states[1:, 1], way)
        times: FloatArray = plan.t + STAGE * np.arange(1.0, len(way) + 1.0)
        lane = self.corridor.bounds(way + self.vehicle.body.l_r, times)
        outcome = Outcome.BLOCKED if self.corridor.blocked else Outcome.SOLVED
        room = self.line - way if self.line < inf else None
        h, g, rows = self.problem.build(
            states[1:], inputs, before, moved, errors, self.speed_of(way), lane, room
        )
        found = solve(h, g, rows, self.iterations, late, self._sweep)
        if found is None:
            return None
        change = found.reshape(inputs.shape)
        most = np.abs(change[ST]).max()
        change = change * min(1.0, LARGEST / most) if most > LARGEST else change
        new = inputs + change
        moved_by = moved.free + moved.forced @ change[:V_S].ravel()
        return Plan(
            plan.t,
            np.vstack([state, states[1:] + moved_by]),
            np.append(s, self.problem.progress(s, new[V_S])),
            new,
            outcome,
            a,
        )

    def _shifted(self, t: float) -> Plan | None:
        """The last plan from t [s] on; its end goes on as it was."""
        last = self.last
        if last is None:
            return None
        n = self.problem.n
        by = round((t - last.t) / STAGE)
        if not 0 <= by < n:
            return None
        states, inputs, s = last.states, last.inputs, last.s
        for _ in range(by):
            end = np.array(self.stage(*states[-1], *inputs[:V_S, -1]))
            states = np.vstack([states[1:], end])
            s = np.append(s[1:], s[-1] + STAGE * inputs[V_S, -1])
            inputs = np.hstack([inputs[:, 1:], inputs[:, -1:]])
        return Plan(t, states, s, inputs, last.outcome, last.slopes)

    def _guess(self, t: float, state: FloatArray, s: float) -> Plan:
        """Along the path, without slip, at a speed that comes to the wanted one."""
        n, v, p = self.problem.n, float(state[3]), self.vehicle
        speed: FloatArray = v + GAINS * STAGE * np.arange(float(n))
        for _ in range(3):  # the wanted speed is that of the place, which follows from the speed
            way = self.problem.progress(s, speed)
            speed = np.minimum(v + GAINS * STAGE * np.arange(1, n + 1), self.speed_of(way))
        x, y, psi = self.reference.spots(way)
        psi = psi + 2.0 * np.pi * np.round(
            (state[2] - self.reference.spots(np.array([s]))[2]) / (2.0 * np.pi)
        )
        bend = self.reference.curvatures(way)
        commands = np.linspace(-1.0, 1.0, 201)
        angles = make_steering(p.steering, np)(commands)
        st = np.clip(
            np.interp(np.arctan(p.body.wheelbase * bend), angles, commands), *self.limits.st
        )
        hold = Inverse(p).throttle(max(float(speed.mean()), 0.1))
        tau = np.full(n, min(max(hold, self.limits.tau[0]), self.limits.tau[1]))
        om = bend * speed
        states = np.stack([x, y, psi, speed, p.body.l_r * om, om, tau, st], axis=1)
        inputs = np.array([tau, st, speed])
        return Plan(
            t,
            np.vstack([state, states]),
            np.append(s, way),
            inputs,
            Outcome.SOLVED,
            np.zeros((n, 8, 8)),
        )
