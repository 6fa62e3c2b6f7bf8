"""The whole nonlinear programme of contouring control, solved by IPOPT: what one iteration is
measured against. Without the soft limits, which a lap on the middle of its lane does not reach.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from dart_hal.control.mpc.iteration import Mpcc
from dart_hal.control.mpc.model import N_STATES, STAGE_PERIOD, make_stage
from dart_hal.control.mpc.planner import MpcPlan, PlanOutcome, PlanRequest

KNOTS = 0.1
"""m between the knots of the path's splines."""
SILENT_IPOPT = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-4,
                "ipopt.max_iter": 100}


class Converged(Mpcc):
    """An ``Mpcc`` whose plans are optima; the first guess and the shift are those of ``Mpcc``."""

    solver = None

    def plan(self, t, state, s, last_plan):
        if self.solver is None:
            self._build()
        aim = PlanRequest(t, state, s, last_plan, lambda: False)
        n = self.problem.n
        guess = self._shift_last_plan(aim) or self._initial_guess(aim)
        v = float(self.speed_of(np.array([s]))[0])
        x0 = np.concatenate([guess.states[1:].ravel(), guess.inputs.T.ravel()])
        found = self.solver(x0=x0, p=np.concatenate([state, [s, *last_plan, v]]), lbx=self._low,
                            ubx=self._high, lbg=self._g_low, ubg=self._g_high)
        assert self.solver.stats()["success"]
        x = np.array(found["x"]).ravel()
        states = x[:8 * n].reshape(n, 8)
        inputs = x[8 * n:].reshape(n, 3).T
        self.last = MpcPlan(t, np.vstack([state, states]),
                            np.append(s, self.problem.progress(s, inputs[2])), inputs,
                            PlanOutcome.SOLVED, np.zeros((n, 8, 8)))
        return self.last

    def _build(self):
        n = self.problem.n
        w = self.problem.weights
        limits = self.limits
        path = self.reference.path
        z = ca.SX.sym("z", N_STATES)
        u = ca.SX.sym("u", 2)
        after = make_stage(self.vehicle, ca)(*ca.vertsplit(z), *ca.vertsplit(u))
        stage = ca.Function("stage", [z, u], [ca.vertcat(*after)])
        knots = np.arange(-2.0, path.length + 8.0, KNOTS)
        x_r, y_r, phi = self.reference.poses(knots)
        phi = np.unwrap(phi)
        curves = [ca.interpolant(name, "bspline", [knots], values)
                  for name, values in (("x", x_r), ("y", y_r), ("phi", phi))]
        states = ca.MX.sym("X", N_STATES, n)
        inputs = ca.MX.sym("U", 3, n)
        p = ca.MX.sym("p", 12)
        cost = 0.0
        gaps = []
        rates = []
        at = p[:8]
        s = p[8]
        last_plan = p[9:11]
        for k in range(n):
            u = inputs[:, k]
            gaps.append(stage(at, u[:2]) - states[:, k])
            at = states[:, k]
            s = s + STAGE_PERIOD * u[2]
            x, y, yaw = (curve(s) for curve in curves)
            dx = at[0] - x
            dy = at[1] - y
            across = ca.cos(yaw) * dy - ca.sin(yaw) * dx
            along = ca.cos(yaw) * dx + ca.sin(yaw) * dy
            change = u[:2] - last_plan
            cost += (w.contour * (w.ends if k == n - 1 else 1.0) * across**2 + w.lag * along**2
                     + w.progress * (u[2] - p[11])**2 + w.input * (u[0]**2 + u[1]**2)
                     + w.throttle_change * change[0]**2 + w.steering_change * change[1]**2)
            rates.append(change)
            last_plan = u[:2]
        most = STAGE_PERIOD * np.array(limits.rates)
        self._g_low = np.concatenate([np.zeros(8 * n), np.tile(-most, n)])
        self._g_high = np.concatenate([np.zeros(8 * n), np.tile(most, n)])
        free = np.full(8 * n, np.inf)
        self._low = np.append(-free, np.tile((limits.tau[0], limits.st[0], 0.0), n))
        self._high = np.append(free, np.tile((limits.tau[1], limits.st[1], limits.fastest), n))
        self.solver = ca.nlpsol("oracle", "ipopt", {
            "x": ca.vertcat(ca.vec(states), ca.vec(inputs)), "p": p, "f": cost,
            "g": ca.vertcat(*gaps, *rates)}, SILENT_IPOPT)
