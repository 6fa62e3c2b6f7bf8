"""Real-time iteration: Newton-type steps of the whole problem, mostly one for each sample.

    last plan -> shift -> linearise at every stage -> condense -> solve -> one step -> plan

Up to MAX_EXTRA_STEPS follow while the steering still changes much; INITIAL_STEPS from a guess.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import inf

import numpy as np

from dart_hal.control.drivetrain import InverseDrive
from dart_hal.control.mpc import generated
from dart_hal.control.mpc.admm import Sweep, run_sweep, solve
from dart_hal.control.mpc.model import STAGE_PERIOD, Lineariser, linearise, make_stage
from dart_hal.control.mpc.planner import (
    DIVERGENCE_LIMIT,
    MpcPlan,
    MpcPlanner,
    PlanOutcome,
    PlanRequest,
)
from dart_hal.control.mpc.problem import ST, V_S, ContouringProblem, MpcLimits, Weights, condense
from dart_hal.control.paths import Path
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering

# Number of stages: 2 s, 4 m at 2 m/s, a half circle of 0.75 m and the straights around it.
HORIZON_STAGES = 20
# ADMM iterations of a quadratic programme.
QP_ITERATIONS = 40
# Newton-type steps of a plan from a guess.
INITIAL_STEPS = 8
# Step of the steering after which another step follows, the largest step that is applied, and the
# largest number of additional steps.
LARGE_STEERING_STEP = 0.4
MAX_STEERING_STEP = 0.8
MAX_EXTRA_STEPS = 2
# Acceleration of the first guess [m/s2].
GUESS_ACCELERATION = 3.0


class Mpcc(MpcPlanner[MpcPlan]):
    """Model predictive contouring control of one car on one path."""

    def __init__(
        self,
        vehicle: Vehicle,
        path: Path,
        speed_of: Callable[[FloatArray], FloatArray],
        limits: MpcLimits | None = None,
        weights: Weights | None = None,
        horizon: int = HORIZON_STAGES,
        iterations: int = QP_ITERATIONS,
        compiled: bool = False,
    ) -> None:
        """See ``MpcPlanner``; compiled: by generated C, see ``generated``."""
        super().__init__(vehicle, path, speed_of, limits)
        self.problem = ContouringProblem(horizon, weights or Weights(), self.limits)
        self.stage = make_stage(self.vehicle, np)
        self._linearise: Lineariser = partial(linearise, self.stage)
        self._sweep: Sweep = run_sweep
        if compiled:
            self._linearise = generated.compile_lineariser(self.vehicle)
            self._sweep = generated.compile_sweep()
        self.iterations = iterations
        self.stop_line = inf
        """Arc length [m] before which the rear axle has to stop; may be set at any time."""

    def set_steering_range(self, low: float, high: float) -> None:
        """See ``MpcPlanner``."""
        self.problem.set_steering_range(low, high)

    def _improve(self, plan: MpcPlan, request: PlanRequest, *, from_guess: bool) -> MpcPlan | None:
        """Do one step, and some more while the steering still changes; None if late."""
        steps, extra_steps = (INITIAL_STEPS, 0) if from_guess else (1, MAX_EXTRA_STEPS)
        while steps:
            with np.errstate(over="ignore", invalid="ignore"):  # checked below
                improved = self._step(plan, request)
            if improved is None:
                return None
            if not np.abs(improved.states - improved.states[0]).max() < DIVERGENCE_LIMIT:
                return replace(plan, outcome=PlanOutcome.DIVERGED)
            steering_change = np.abs(improved.inputs[ST] - plan.inputs[ST]).max()
            plan = improved
            steps -= 1
            if not steps and extra_steps and steering_change > LARGE_STEERING_STEP:
                steps = 1
                extra_steps = extra_steps - 1
        return plan

    def _step(self, plan: MpcPlan, request: PlanRequest) -> MpcPlan | None:
        """Linearise, solve one programme and apply its step; None if late."""
        inputs = plan.inputs
        states = plan.states
        _, state, s, last_inputs, is_late = request
        # 1. Linearise at the last plan. The gaps close when the step is applied.
        next_states, a, b = self._linearise(states[:-1], inputs[:V_S].T)
        condensed = condense(state - states[0], a, b, next_states - states[1:])
        # 2. Errors and bounds at the progress of the last plan.
        progress = self.problem.progress(s, inputs[V_S])
        errors = self.reference.errors(states[1:, 0], states[1:, 1], progress)
        times: FloatArray = plan.t + STAGE_PERIOD * np.arange(1.0, len(progress) + 1.0)
        # The bounds are those of the car's centre, l_r ahead. They are applied to e_c of the rear
        # axle: this neglects l_r times the sine of the heading error.
        lane = self.corridor.bounds(progress + self.vehicle.body.l_r, times)
        outcome = PlanOutcome.BLOCKED if self.corridor.blocked else PlanOutcome.SOLVED
        stop_distance = self.stop_line - progress if self.stop_line < inf else None
        # v_s is the mean speed of a stage, so its target is that of the middle.
        target_speed = self.speed_of(np.append(s, progress))
        h, g, constraints = self.problem.build(
            states[1:],
            inputs,
            last_inputs,
            condensed,
            errors,
            0.5 * (target_speed[:-1] + target_speed[1:]),
            target_speed[1:],
            lane,
            stop_distance,
        )
        solution = solve(h, g, constraints, self.iterations, is_late, self._sweep)
        if solution is None:
            return None
        # 3. Apply the step, shortened where the steering would change too much.
        change = solution.reshape(inputs.shape)
        max_change = np.abs(change[ST]).max()
        change = (
            change * min(1.0, MAX_STEERING_STEP / max_change)
            if max_change > MAX_STEERING_STEP
            else change
        )
        new = inputs + change
        state_change = condensed.free + condensed.forced @ change[:V_S].ravel()
        return MpcPlan(
            plan.t,
            np.vstack([state, states[1:] + state_change]),
            np.append(s, self.problem.progress(s, new[V_S])),
            new,
            outcome,
            a,
        )

    def _shift_last_plan(self, request: PlanRequest) -> MpcPlan | None:
        last = self.last
        stages = self._stages_since_last(request)
        if last is None or not 0 <= stages < self.problem.n:
            return None
        states = last.states
        inputs = last.inputs
        s = last.s
        for _ in range(stages):
            end = np.array(self.stage(*states[-1], *inputs[:V_S, -1]))
            states = np.vstack([states[1:], end])
            s = np.append(s[1:], s[-1] + STAGE_PERIOD * inputs[V_S, -1])
            inputs = np.hstack([inputs[:, 1:], inputs[:, -1:]])
        return MpcPlan(request.t, states, s, inputs, last.outcome, last.slopes)

    def _initial_guess(self, request: PlanRequest) -> MpcPlan:
        """Return a plan along the path without slip, with a speed that ramps up to the target
        speed.
        """
        t, state, s = request[:3]
        n = self.problem.n
        v = float(state[3])
        p = self.vehicle
        speed: FloatArray = v + GUESS_ACCELERATION * STAGE_PERIOD * np.arange(float(n))
        # Fixed point: the target speed depends on the position, and that on the speed.
        for _ in range(3):
            progress = self.problem.progress(s, speed)
            speed = np.minimum(
                v + GUESS_ACCELERATION * STAGE_PERIOD * np.arange(1, n + 1), self.speed_of(progress)
            )
        x, y, psi = self.reference.poses(progress)
        psi = psi + 2.0 * np.pi * np.round(
            (state[2] - self.reference.poses(np.array([s]))[2]) / (2.0 * np.pi)
        )
        curvature = self.reference.curvatures(progress)
        commands = np.linspace(-1.0, 1.0, 201)
        angles = make_steering(p.steering, np)(commands)
        st = np.clip(
            np.interp(np.arctan(p.body.wheelbase * curvature), angles, commands), *self.limits.st
        )
        tau_hold = InverseDrive(p).throttle(max(float(speed.mean()), 0.1))
        tau = np.full(n, min(max(tau_hold, self.limits.tau[0]), self.limits.tau[1]))
        om = curvature * speed
        states = np.stack([x, y, psi, speed, p.body.l_r * om, om, tau, st], axis=1)
        inputs = np.array([tau, st, speed])
        return MpcPlan(
            t,
            np.vstack([state, states]),
            np.append(s, progress),
            inputs,
            PlanOutcome.SOLVED,
            np.zeros((n, 8, 8)),
        )
