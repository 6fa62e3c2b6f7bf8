"""Both layers of the curvature-aware controller as published, solved by IPOPT: the lane as squares,
the cosine as a cosine, states as variables. What one iteration a sample is measured against.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from dart_hal.control.curvature_aware import curvature, progress
from dart_hal.control.curvature_aware.follower import FollowedMotion
from dart_hal.control.curvature_aware.generator import (
    LOOKAHEAD_FACTOR,
    MAX_TURN_RATE,
    PATH_STAGES,
    GeneratedPath,
)
from dart_hal.control.curvature_aware.lane import MAX_SLACK, SLACK_COST
from dart_hal.control.curvature_aware.progress import Law
from dart_hal.control.curvature_aware.two_layers import TwoLayers, _plan
from dart_hal.control.mpc.model import STAGE_PERIOD, make_stage
from dart_hal.control.mpc.planner import PlanOutcome
from dart_hal.vehicle.namespace import adapt
from tests.control.mpc_oracle import SILENT_IPOPT

LENGTH = LOOKAHEAD_FACTOR * PATH_STAGES * STAGE_PERIOD
"""Of the grid, by the speed."""


class Shooting:
    """min cost, after each stage z = stage(z, u), inside the lane; inputs u and a slack [m]."""

    def __init__(self, stage, cost, ends, squared_distance, half, low, high, parameters):
        """cost, ends(k, z, u, p), squared_distance(k, z, p); low, high of the inputs."""
        nz = stage.size1_in(0)
        nu = len(low)
        n = PATH_STAGES
        z = ca.SX.sym("z", nz, n)
        u = ca.SX.sym("u", nu, n)
        slack = ca.SX.sym("slack", n)
        first = ca.SX.sym("first", nz)
        p = ca.SX.sym("p", parameters)
        motion_index = first
        total = SLACK_COST * ca.sumsqr(slack)
        gaps = []
        room = []
        for k in range(n):
            gaps.append(stage(motion_index, u[:, k], p) - z[:, k])
            total += cost(k, motion_index, z[:, k], u[:, k], p)
            motion_index = z[:, k]
            room.append((half + 0.5 * slack[k]) ** 2 - squared_distance(k, motion_index, p))
        total += ends(motion_index, p)
        self.nz, self.nu, free = nz, nu, np.full(nz * n, np.inf)
        self.low = np.concatenate([-free, np.tile(low, n), np.zeros(n)])
        self.high = np.concatenate([free, np.tile(high, n), np.full(n, MAX_SLACK)])
        self.solver = ca.nlpsol("layer", "ipopt", {
            "x": ca.vertcat(ca.vec(z), ca.vec(u), slack), "p": ca.vertcat(first, p), "f": total,
            "g": ca.vertcat(*gaps, *room)}, {**SILENT_IPOPT, "ipopt.max_iter": 300})

    def solve(self, first, states, inputs, p):
        """(states (n + 1, nz), inputs (nu, n)) from a guess of both."""
        n = PATH_STAGES
        nz = self.nz
        x0 = np.concatenate([states[1:].ravel(), inputs.T.ravel(), np.zeros(n)])
        found = self.solver(x0=x0, p=np.concatenate([first, p]), lbx=self.low, ubx=self.high,
                            lbg=np.zeros((nz + 1) * n),
                            ubg=np.append(np.zeros(nz * n), np.full(n, np.inf)))
        assert self.solver.stats()["success"], self.solver.stats()["return_status"]
        x = np.array(found["x"]).ravel()
        return (np.vstack([first, x[:nz * n].reshape(n, nz)]),
                x[nz * n:(nz + self.nu) * n].reshape(n, self.nu).T)


class ConvergedContouring(TwoLayers):
    """A ``TwoLayers`` whose layers are optima."""

    layers = None

    def _improve(self, plan, request, *, from_guess):
        self.layers = self.layers or (self._path_layer(), self._follow_layer())
        (high, low), speed = self.layers, float(self._speeds_along_path(request)[0])  # it is one
        first = self.generator.first_state(request.state, request.s)
        k = curvature.fit_weights(
            self.reference.curvatures(request.s + LENGTH * speed * curvature.GRID)
        )
        states, turns = high.solve(first, plan.way.states, plan.way.turns[None],
                                   np.append(speed, k))
        way = GeneratedPath(states, turns[0])
        motion = low.solve(request.state, plan.states, plan.inputs[:2],
                           np.append(speed, way.states[1:].ravel()))
        return replace(
            _plan(request, way, FollowedMotion(*motion, plan.slopes), PlanOutcome.SOLVED)
        )

    def _path_layer(self):
        law = self.generator.law
        w = self.generator.weights
        f = adapt(ca)
        z = ca.SX.sym("z", 7)
        u = ca.SX.sym("u")
        p = ca.SX.sym("p", 1 + curvature.GRID_POINTS)

        def bend(s):
            away = ca.fabs(s / (LENGTH * p[0]) - curvature.GRID) / curvature.KERNEL_WIDTH
            return ca.dot(curvature.matern(away, ca.exp), p[1:])

        stage = progress.make_stage(progress.make_rates(law, p[0], bend, f), STAGE_PERIOD)
        stage = ca.Function("stage", [z, u, p], [ca.vertcat(*stage(*ca.vertsplit(z), u))])

        def squared_distance(_k, z, _p=None):
            return (z[0] - z[4]) ** 2 + (z[1] - z[5]) ** 2

        def cost(_k, z, _after, u, _p):
            if law is Law.CA:
                return w.contour * squared_distance(0, z) + w.input * u**2
            dx = z[0] - z[4]
            dy = z[1] - z[5]
            c = ca.cos(z[6])
            d = ca.sin(z[6])
            return (w.contour * (d * dx - c * dy) ** 2 + w.lag * (c * dx + d * dy) ** 2
                    + w.input * u**2)

        def ends(z, _p):
            return w.end_position * squared_distance(0, z) - w.end_turn * ca.cos(z[2] - z[6])

        return Shooting(
            stage,
            cost,
            ends,
            squared_distance,
            self.limits.lane,
            [-MAX_TURN_RATE],
            [MAX_TURN_RATE],
            1 + curvature.GRID_POINTS,
        )

    def _follow_layer(self):
        w = self.follower.weights
        limits = self.limits
        z = ca.SX.sym("z", 8)
        u = ca.SX.sym("u", 2)
        p = ca.SX.sym("p", 1 + 7 * PATH_STAGES)
        after = make_stage(self.vehicle, ca)(*ca.vertsplit(z), *ca.vertsplit(u))
        stage = ca.Function("stage", [z, u, p], [ca.vertcat(*after)])

        def reference(k, p):
            return p[1 + 7 * k:8 + 7 * k]

        def squared_distance(k, z, p):
            r = reference(k, p)
            return (z[0] - r[4]) ** 2 + (z[1] - r[5]) ** 2

        def cost(k, motion_index, z, u, p):
            r = reference(k, p)
            last = k == PATH_STAGES - 1
            place, turn = (w.end_position, w.end_turn) if last else (w.position, w.turn)
            return (
                w.speed * (z[3] - p[0]) ** 2
                + w.acceleration * ((z[3] - motion_index[3]) / STAGE_PERIOD) ** 2
                + place * ((z[0] - r[0]) ** 2 + (z[1] - r[1]) ** 2)
                + turn * (z[2] - r[2]) ** 2
                + w.input * ca.sumsqr(u)
            )

        return Shooting(stage, cost, lambda z, p: 0.0, squared_distance, limits.lane,
                        [limits.tau[0], limits.st[0]], [limits.tau[1], limits.st[1]],
                        1 + 7 * PATH_STAGES)
