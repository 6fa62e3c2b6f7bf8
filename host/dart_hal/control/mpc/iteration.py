"""Real-time iteration: one Newton-type step of the whole problem for each sample.

    last plan -> shifted -> linearised at every stage -> condensed -> solved -> one step -> plan
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import inf

import numpy as np

from dart_hal.control.drivetrain import Inverse
from dart_hal.control.mpc import generated
from dart_hal.control.mpc.admm import Sweep, solve, swept
from dart_hal.control.mpc.model import STAGE, Linearise, linearised, make_stage
from dart_hal.control.mpc.planner import FAR, Aim, Outcome, Plan, Planner
from dart_hal.control.mpc.problem import ST, V_S, Limits, Problem, Weights, condensed
from dart_hal.control.paths import Path
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering

# Stages: 2 s, 4 m at 2 m/s, a half circle of 0.75 m and the straights beside it.
HORIZON = 20
# Of the quadratic programme; steps of a first plan.
ITERATIONS = 40
BEGINNING = 8
# A step of the steering that asks for one more iteration, the most that is taken of one, and how
# many more there are.
LARGE = 0.4
LARGEST = 0.8
MORE = 2
# m/s2 of the first guess.
GAINS = 3.0


class Mpcc(Planner[Plan]):
    """Model predictive contouring control of one car on one path."""

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
        """See ``Planner``; compiled: by generated C, see ``generated``."""
        super().__init__(vehicle, path, speed_of, limits)
        self.problem = Problem(horizon, weights or Weights(), self.limits)
        self.stage = make_stage(self.vehicle, np)
        self._linearise: Linearise = partial(linearised, self.stage)
        self._sweep: Sweep = swept
        if compiled:
            self._linearise = generated.compiled(self.vehicle)
            self._sweep = generated.sweep()
        self.iterations = iterations
        self.line = inf
        """m of the path before which the rear axle has to stand; may be set at any time."""

    def turn_within(self, low: float, high: float) -> None:
        """See ``Planner``."""
        self.problem.turn_within(low, high)

    def _improved(self, plan: Plan, aim: Aim, *, anew: bool) -> Plan | None:
        """One step on, and some more where the steering still turns; None where late."""
        steps, more = (BEGINNING, 0) if anew else (1, MORE)
        while steps:
            with np.errstate(over="ignore", invalid="ignore"):  # it is looked at below
                after = self._step(plan, aim)
            if after is None:
                return None
            if not np.abs(after.states - after.states[0]).max() < FAR:
                return replace(plan, outcome=Outcome.DIVERGED)
            turned = np.abs(after.inputs[ST] - plan.inputs[ST]).max()
            plan = after
            steps -= 1
            if not steps and more and turned > LARGE:
                steps = 1
                more = more - 1
        return plan

    def _step(self, plan: Plan, aim: Aim) -> Plan | None:
        """One linearisation and one programme; None where it was late."""
        inputs = plan.inputs
        states = plan.states
        _, state, s, before, late = aim
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

    def _shifted(self, aim: Aim) -> Plan | None:
        last = self.last
        by = self._stages_since(aim)
        if last is None or not 0 <= by < self.problem.n:
            return None
        states = last.states
        inputs = last.inputs
        s = last.s
        for _ in range(by):
            end = np.array(self.stage(*states[-1], *inputs[:V_S, -1]))
            states = np.vstack([states[1:], end])
            s = np.append(s[1:], s[-1] + STAGE * inputs[V_S, -1])
            inputs = np.hstack([inputs[:, 1:], inputs[:, -1:]])
        return Plan(aim.t, states, s, inputs, last.outcome, last.slopes)

    def _guess(self, aim: Aim) -> Plan:
        """Along the path, without slip, at a speed that comes to the wanted one."""
        t, state, s = aim[:3]
        n = self.problem.n
        v = float(state[3])
        p = self.vehicle
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
