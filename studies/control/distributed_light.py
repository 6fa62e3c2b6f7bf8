"""Many arrivals of cars that share their plans, at once on the light simulation.

Each car has a model that is 5 % off in all parameters, 40 ms of latency, lags, a pose with a bias
of up to 1.5 cm and noise of 3 mm, its own clock, and messages whose age is known to 10 ms.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

import numpy as np

from dart_hal.control.crossing.layout import MIN_CAR_DISTANCE
from dart_hal.control.crossing.layouts import LAYOUTS
from dart_hal.control.paths import Path
from dart_hal.control.shared_plans.planner import PlanSharer
from dart_hal.control.shared_plans.space import PlanSpace
from dart_hal.control.shared_plans.timed_plan import LENGTH_STEP, LEVEL_SPEED, TIME_STEP
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.steering import make_steering_inverse
from dart_lab.sim.light import LightBatch, LightConfig, Outline
from dart_lab.sim.light.world import corners, overlaps
from studies.control import crossing_light as light
from studies.control.mpc_loop import P, around

STEP = light.STEP
PERIOD = 5
AGE_ERROR = 0.01
"""Largest error of the age of a message [s]."""
POSE_NOISE = 0.003
LOOK_AHEAD = 0.1
"""Time from a command to the wheels, latency and most of a lag [s]."""
PROGRESS_GAIN, SPEED_TIME, INTEGRAL_GAIN = 2.5, 0.2, 2.0
"""Speed per error of the arc length [1/s]; time in which an error of the speed is removed [s]; of
its integral [1/s2]."""
MIN_STEER, STEER_TIME = 0.2, 0.15
"""Look-ahead of the pursuit [m], and per speed [s]."""
OUTLINE = Outline()
RADIUS, PARTS = 2.5, 12
"""Circle of the open space [m], and its places: starts and goals alternate."""
OFFSETS = (0.0, 0.45, -0.45, 0.9, -0.9)


@dataclass(frozen=True)
class Arrival:
    """Paths of all cars, where each begins [m] and has passed [m], and its errors."""

    space: PlanSpace
    starts: tuple[light.Start, ...]
    passed: tuple[float, ...]
    seed: int


_SPACES: dict[str, tuple] = {}


def layout_arrival(name: str, seed: int, kind: str) -> Arrival:
    """Four cars of ``crossing_light``, straight on."""
    if name not in _SPACES:
        layout = LAYOUTS[name]()
        routes = [layout.number(s.route) for s in light.arrivals(layout, 0, "random")]
        _SPACES[name] = (layout, PlanSpace([[layout.routes[r].path] for r in routes]),
                         tuple(layout.exit[r] for r in routes))
    layout, space, passed = _SPACES[name]
    return Arrival(space, tuple(light.arrivals(layout, seed, kind)), passed, seed)


def open_arrival(seed: int, kind: str = "") -> Arrival:
    """Six cars on a circle, each to a place on the other side, by one of five paths."""
    rng = np.random.default_rng([seed, 41])
    while True:
        angles = 2.0 * np.pi / PARTS * (np.arange(PARTS) + rng.uniform(-0.15, 0.15, PARTS))
        places = RADIUS * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        starts, goals = places[::2], places[1::2][rng.permutation(PARTS // 2)]
        if np.hypot(*(goals - starts).T).min() < 1.4 * RADIUS:
            continue
        fans = [fan(a, b) for a, b in zip(starts, goals, strict=True)]
        ends = np.stack([starts, goals], axis=1)
        if any(nearest(ends[i], own) < MIN_CAR_DISTANCE for i in range(len(fans))
               for j, own in enumerate(fans) if j != i):
            continue
        space = PlanSpace([[Path.through(p, closed=False) for p in own] for own in fans])
        if all(r[0] and r[-8] for own in space.rests for r in own):
            break
    cars = tuple(light.Start("", 0.0, int(rng.integers(0, PERIOD)), float(rng.uniform(0.0, 100.0)),
                             *map(float, rng.uniform(-light.BIAS, light.BIAS, 2)))
                 for _ in starts)
    return Arrival(space, cars, tuple(own[0].length - 0.5 for own in space.paths), seed)


def nearest(points: np.ndarray, others: np.ndarray) -> float:
    """Least distance [m] of points (n, 2) to those of paths (..., 2)."""
    return float(np.linalg.norm(points[:, None] - others.reshape(-1, 2), axis=2).min())


def fan(start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Points (5, 40, 2) of paths to a goal that bend to either side, no tighter than 0.7 m."""
    length = float(np.hypot(*(goal - start)))
    along = (goal - start) / length
    x = np.linspace(0.0, length, 40)
    bend = np.sign(OFFSETS) * np.minimum(np.abs(OFFSETS), 0.07 * length**2)
    y = 0.5 * bend[:, None] * (1.0 - np.cos(2.0 * np.pi * x / length))
    return start + x[:, None] * along + y[..., None] * np.array([-along[1], along[0]])


class Network(light.Network):
    """Delivers messages with their age."""

    def list_arrived(self, k: int, j: int):
        """(bytes, age [s]) of what is due."""
        due = [(data, (k - sent) * STEP) for at, sent, data in self.waiting[j] if at <= k]
        self.waiting[j] = [w for w in self.waiting[j] if w[0] > k]
        return due


@dataclass
class Outcome:
    """contacts: pairs whose bodies touched; least [m]: between two centres; passed [s]: when each
    car had passed, inf: never; error [m]: largest difference to its plan, along and across;
    stalled [s]: longest time in which all were at rest before the last had passed; counts: of all
    messages and proposals; rows: (t, x, y, yaw of the rear axle) of each car."""

    contacts: int = 0
    least: float = inf
    passed: list[float] = field(default_factory=list)
    error: tuple[float, float] = (0.0, 0.0)
    stalled: float = 0.0
    counts: dict[str, int] = field(default_factory=dict)
    rows: list[np.ndarray] = field(default_factory=list)
    sharers: list[PlanSharer] = field(default_factory=list)


class Driven:
    """All cars of all arrivals, driven along their committed plans."""

    def __init__(self, arrivals) -> None:
        self.n = len(arrivals[0].starts)
        total = len(arrivals) * self.n
        vehicles = [around(1000 * a.seed + i) for a in arrivals for i in range(self.n)]
        self.batch = LightBatch(vehicles, total, LightConfig(step=STEP, sensors=None))
        self.points = max(len(p.x) for a in arrivals for own in a.space.paths for p in own)
        self.x, self.y, self.yaw, self.bend = np.zeros((4, total, self.points))
        self.spacing = np.zeros(total)
        self.t0 = np.zeros(total)
        self.s0 = np.array([s.s for a in arrivals for s in a.starts])
        self.levels = np.zeros((total, 80))
        self.knots = np.zeros((total, 80))
        self.error = np.zeros((2, total))
        self.integral = np.zeros(total)
        biases = np.array([(s.along, s.across) for a in arrivals for s in a.starts])
        self.along, self.across = biases.T
        self.s = np.array([s.s for a in arrivals for s in a.starts])
        self.rng = np.random.default_rng([arrivals[0].seed, 43])
        self.friction = make_friction(P.friction, np)
        angles = np.linspace(-0.32, 0.30, 200)
        inverse = make_steering_inverse(P.steering)
        self.steering = angles, np.array([inverse(float(a)) for a in angles])
        self._paths: list[Path | None] = [None] * total
        for i in range(total):
            arrival = arrivals[i // self.n]
            self.set_plan(i, arrival.space.paths[i % self.n][0], None)
        k = self._index(self.s)
        rest = np.zeros((6, total))
        rest[0], rest[1], rest[2] = (v[np.arange(total), k] for v in (self.x, self.y, self.yaw))
        self.batch.reset(rest)

    def _index(self, s: np.ndarray) -> np.ndarray:
        return np.clip(np.rint(s / self.spacing).astype(int), 0, self.points - 1)

    def set_plan(self, i: int, path: Path, plan, clock: float = 0.0) -> None:
        if path is not self._paths[i]:
            self._paths[i] = path
            self.spacing[i] = path.spacing
            beyond = np.maximum(np.arange(self.points) - len(path.x) + 1, 0) * path.spacing
            end = path.heading[-1]
            for row, of, slope in ((self.x, path.x, np.cos(end)), (self.y, path.y, np.sin(end)),
                                   (self.yaw, path.heading, 0.0), (self.bend, path.curvature, 0.0)):
                row[i] = np.append(of, np.full(self.points - len(of), of[-1])) + slope * beyond
        if plan is not None:
            levels = np.array(plan.levels, dtype=float)
            self.levels[i] = 0.0
            self.levels[i, : len(levels)] = levels
            self.knots[i] = LENGTH_STEP * np.append(
                0.0, np.cumsum(self.levels[i, :-1] + self.levels[i, 1:]))
            self.t0[i], self.s0[i] = plan.t - clock, plan.s

    def motion_at(self, t: float):
        """Arc length, speed, acceleration of all plans at t [s]."""
        x = np.clip((t - self.t0) / TIME_STEP, 0.0, 78.0)
        k = x.astype(int)
        x = x - k
        i = np.arange(len(k))
        low, change = self.levels[i, k], self.levels[i, k + 1] - self.levels[i, k]
        return (self.s0 + self.knots[i, k] + LENGTH_STEP * x * (2.0 * low + change * x),
                LEVEL_SPEED * (low + change * x), LEVEL_SPEED / TIME_STEP * change)

    def move(self, t: float) -> None:
        """One step of the simulation by steering and throttle from the measured pose."""
        x, y, yaw, v, _, rate = self.batch.state[:6]
        i = np.arange(len(x))
        k = self._index(self.s)
        c, d = np.cos(self.yaw[i, k]), np.sin(self.yaw[i, k])
        dx, dy = x - self.x[i, k], y - self.y[i, k]
        self.s = k * self.spacing + np.clip(c * dx + d * dy, -0.05, 0.05)
        plan_s, speed, _ = self.motion_at(t + 0.5 * LOOK_AHEAD)
        plan_s = self.motion_at(t)[0]
        self.error = np.maximum(self.error, np.abs((self.s - plan_s, c * dy - d * dx)))
        noise = POSE_NOISE * self.rng.standard_normal((2, len(x)))
        x = x + self.along * c - self.across * d + noise[0]
        y = y + self.along * d + self.across * c + noise[1]
        # Pursuit of the path by the rear axle at the time at which the command acts.
        yaw = yaw + LOOK_AHEAD * rate
        x = x + LOOK_AHEAD * v * np.cos(yaw) - P.body.l_r * np.cos(yaw)
        y = y + LOOK_AHEAD * v * np.sin(yaw) - P.body.l_r * np.sin(yaw)
        s = self.s + LOOK_AHEAD * v - P.body.l_r
        near, far = self._index(s), self._index(s + MIN_STEER + STEER_TIME * np.abs(v))
        target = self.x[i, far], self.y[i, far]
        curvature = self.bend[i, near] + _arc(x, y, yaw, *target) - _arc(
            self.x[i, near], self.y[i, near], self.yaw[i, near], *target)
        steering = np.interp(np.arctan(P.body.wheelbase * curvature), *self.steering)
        _, coming, acceleration = self.motion_at(t + LOOK_AHEAD)
        target_speed = np.maximum(
            speed + PROGRESS_GAIN * (plan_s - self.s - self.along - noise[0]), 0.0)
        target_speed = np.where((coming == 0.0) & (plan_s - self.s < 0.02), 0.0, target_speed)
        throttle = self._throttle(target_speed, v, acceleration)
        self.batch.advance(throttle, steering)

    def _throttle(self, target, v, acceleration):
        """By the motor of the published set; the brake is the motor in reverse."""
        m = P.motor
        error = np.where(target > 0.0, target - v, 0.0)
        self.integral = np.clip(self.integral + INTEGRAL_GAIN * STEP * error, -1.0, 1.0)
        a = acceleration + (target - v) / SPEED_TIME + self.integral
        a = np.where((target == 0.0) & (v < 0.05), 0.0, np.clip(a, -3.0, 2.0))
        force = P.body.mass * a - self.friction(np.maximum(v, 0.02))
        drive = np.where(force > 0.0, force / (m.d - m.e * v) - m.g,
                         m.g + force / (m.reverse * (m.d + m.e * v)))
        return np.where((target == 0.0) & (v < 0.05), 0.0, np.clip(drive, -0.5, 0.6))

    def rear_axles(self) -> np.ndarray:
        x, y, yaw = (np.asarray(v) for v in self.batch.state[:3])
        ahead = P.body.l_r
        return np.stack([x - ahead * np.cos(yaw), y - ahead * np.sin(yaw), yaw], axis=1)


def _arc(x, y, course, tx, ty):
    """Curvature of the arc from a pose to a point [1/m]."""
    distance = np.maximum(np.hypot(tx - x, ty - y), 1e-3)
    return 2.0 * np.sin(np.arctan2(ty - y, tx - x) - course) / distance


def drive(arrivals, loss: float, seconds: float = 40.0, make=PlanSharer, rows: bool = False,
          ) -> list[Outcome]:
    """Drive all arrivals until each car has passed, or the time is over."""
    n = len(arrivals[0].starts)
    cars = Driven(arrivals)
    outcomes = [Outcome(passed=[inf] * n) for _ in arrivals]
    networks = [Network(np.random.default_rng([a.seed, 42]), n, loss) for a in arrivals]
    for a, outcome in zip(arrivals, outcomes, strict=True):
        outcome.sharers = [make(a.space, i, s.s, 1 + i, s.clock) for i, s in enumerate(a.starts)]
    committed = [None] * len(cars.s)
    passed_s = np.array([p for a in arrivals for p in a.passed])
    passed_t = np.full(len(cars.s), inf)
    moved_t = np.zeros(len(arrivals))
    stalled = np.zeros(len(arrivals))
    pairs = np.triu_indices(n, 1)
    active = list(range(len(arrivals)))
    touching = [set() for _ in arrivals]
    for k in range(round(seconds / STEP)):
        t = k * STEP
        for r in active:
            for i, start in enumerate(arrivals[r].starts):
                if k % PERIOD == start.shift % PERIOD:
                    decide(outcomes[r].sharers[i], networks[r], k, i, t + start.clock)
                    plan = outcomes[r].sharers[i].committed
                    if plan is not committed[r * n + i]:
                        committed[r * n + i] = plan
                        path = arrivals[r].space.paths[i][plan.path]
                        cars.set_plan(r * n + i, path, plan, start.clock)
        cars.move(t)
        passed_t = np.where((cars.s > passed_s) & (passed_t == inf), t, passed_t)
        axles = cars.rear_axles()
        centres = np.stack(cars.batch.state[:2], axis=1).reshape(-1, n, 2)
        distances = np.hypot(*np.moveaxis(centres[:, pairs[0]] - centres[:, pairs[1]], 2, 0))
        is_moving = (np.asarray(cars.batch.state[3]).reshape(-1, n) > 0.05).any(axis=1)
        moved_t = np.where(is_moving, t, moved_t)
        stalled[active] = np.maximum(stalled, t - moved_t)[active]
        for r in active:
            outcomes[r].least = min(outcomes[r].least, float(distances[r].min()))
            if distances[r].min() < 0.36:
                found = overlaps(corners(axles[r * n : (r + 1) * n], OUTLINE))
                touching[r] |= set(zip(*np.nonzero(np.triu(found)), strict=True))
            if rows and k % PERIOD == 0:
                outcomes[r].rows.append(np.column_stack([np.full(n, t), axles[r * n:(r + 1) * n]]))
        if k % PERIOD == 0:
            active = [r for r in active if passed_t[r * n : (r + 1) * n].max() == inf]
            if not active:
                break
    for r, outcome in enumerate(outcomes):
        own = slice(r * n, (r + 1) * n)
        outcome.passed = passed_t[own].tolist()
        outcome.error = tuple(cars.error[:, own].max(axis=1).tolist())
        outcome.stalled = float(stalled[r])
        outcome.contacts = len(touching[r])
        for sharer in outcome.sharers:
            for name, count in sharer.counts.items():
                outcome.counts[name] = outcome.counts.get(name, 0) + count
    return outcomes


def decide(sharer: PlanSharer, network: Network, k: int, i: int, t: float) -> None:
    """One decision of a car at its time t [s]."""
    for data, age in network.list_arrived(k, i):
        sharer.receive(data, t, age + network.rng.uniform(-AGE_ERROR, AGE_ERROR))
    sharer.step(t)
    network.send(k, i, sharer.next_message(t))
