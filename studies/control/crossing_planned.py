"""The same arrivals with contouring control in the loop: light cars with slip, lags and 40 ms, the
real coordinators, commands of the plan itself.

    python -m studies.control.crossing_planned [--layout intersection] [--seeds 10] [--loss 0.5]
"""

from __future__ import annotations

import argparse
import time
from itertools import combinations
from math import cos, hypot, inf, sin

import numpy as np

from dart_hal.control.crossing.layouts import LAYOUTS
from dart_hal.control.crossing.speed import safe_speed, sendable_throttle
from dart_hal.control.mpc.iteration import Mpcc
from dart_lab.sim.light import LightCar
from studies.control import crossing_light as light
from studies.control.mpc_loop import LATE, Loop, P, limits_of

AHEAD = P.body.l_r


class Planned:
    """One car: ``Loop`` with a line, its pose with the bias of its start."""

    def __init__(self, layout, start) -> None:
        self.path, self.start = layout.routes[layout.number(start.route)].path, start
        self.mpc = Mpcc(P, self.path, self._paces, limits_of(P))
        self.speed = layout.speed
        self.loop = Loop(self.mpc)
        spot = self.path.interpolate(start.s)
        self.loop.car = LightCar(P)
        self.loop.car.reset(spot.x, spot.y, spot.heading)
        self.s = self.loop.s = start.s - AHEAD
        self.cpu: list[float] = []
        self.command = (0.0, 0.0)

    def _paces(self, s):
        line = min(self.mpc.stop_line + AHEAD, self.path.length)
        return np.minimum(self.speed, safe_speed(line - AHEAD - s))

    def seen(self):
        z, spot, (a, b) = self.loop.seen(), self.path.interpolate(self.s), (self.start.along,
                                                                  self.start.across)
        c, s = cos(spot.heading), sin(spot.heading)
        z[0], z[1] = z[0] + a * c - b * s, z[1] + a * s + b * c
        return z

    def plan(self, line: float) -> None:
        """0.1 s on: a plan that stands before the line."""
        self.mpc.stop_line = line - AHEAD
        z = np.array(self.loop._ahead(*self.seen(), *self.command))
        s = self.path.closest(z[0], z[1], self.s)
        plan = self.mpc.plan(self.loop.car.t + LATE, z, s, self.loop.sent)
        self.loop.sent = float(plan.inputs[0, 0]), float(plan.inputs[1, 0])
        self.command = (
            sendable_throttle(self.loop.sent[0], self.mpc.limits.tau[0]),
            self.loop.sent[1],
        )

    def move(self) -> None:
        self.loop.car.advance(*self.command, round(light.STEP / self.loop.car.config.step))
        x, y, yaw = self.loop.car.state[:3]
        self.s = self.path.closest(x - AHEAD * cos(yaw), y - AHEAD * sin(yaw), self.s)

    def middle(self):
        return self.loop.car.state[:2]


def drive(layout, starts, network, seconds: float):
    """(least distance [m], s of each across, CPU s of each step of a car)."""
    cars = [Planned(layout, s) for s in starts]
    minds = [light.coordinator(layout, starts, i, 1 + i, s.s) for i, s in enumerate(starts)]
    least, across = inf, [inf] * len(cars)
    for k in range(round(seconds / light.STEP)):
        t = k * light.STEP
        for i, (car, mind, start) in enumerate(zip(cars, minds, starts, strict=True)):
            if k % light.EVERY == start.shift:
                begun = time.process_time()
                for data in network.come(k, i):
                    mind.receive(data, t + start.clock)
                seen = car.s + start.along + AHEAD
                line = mind.step(t + start.clock, seen).line
                network.send(k, i, mind.next_message())
                car.plan(line)
                car.cpu.append(time.process_time() - begun)
            car.move()
            if car.s + AHEAD > layout.exit[mind.route]:
                across[i] = min(across[i], t)
        least = min(least, *(hypot(a[0] - b[0], a[1] - b[1]) for a, b in combinations(
            [car.middle() for car in cars], 2)))
        if max(across) < inf:
            break
    return least, across, [c for car in cars for c in car.cpu]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--layout", choices=("intersection", "roundabout"), default="intersection")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--ways", choices=("straight", "any"), default="straight")
    parser.add_argument("--loss", type=float, default=0.5)
    given = parser.parse_args()
    layout = LAYOUTS[given.layout]()
    rows, cpu = [], []
    for seed, kind in light.kinds(given.seeds):
        seed += given.first
        starts = light.arrivals(layout, seed, kind, given.ways)
        network = light.Network(np.random.default_rng([seed, 29]), len(starts), given.loss)
        least, across, took = drive(layout, starts, network, 30.0)
        rows.append((least, max(across)))
        cpu += took
    least, last = np.array(rows).T
    print(f"{layout.name}, {given.ways}, planned, loss {given.loss:g}: least {least.min():.3f} m; "
          f"in 12 s {np.sum(last <= 12.0)} of {len(last)}, worst {last.max():.1f} s; a step "
          f"{1e3 * np.median(cpu):.1f} ms, p95 {1e3 * np.percentile(cpu, 95):.1f}", flush=True)


if __name__ == "__main__":
    main()
