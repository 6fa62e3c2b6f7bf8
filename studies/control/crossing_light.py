"""Cars of a crossing on their lanes: the drive train of the later published set with its lag, 40 ms
late, poses with a bias; the real coordinators; a network that is as bad as one likes."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, exp, hypot, inf, sin

import numpy as np

from dart_hal.control.crossing.coordinator import Coordinator, CrossingWait
from dart_hal.control.crossing.layout import CrossingLayout
from dart_hal.control.crossing.order import CrossingPhase
from dart_hal.control.crossing.speed import safe_speed
from dart_hal.control.drivetrain import InverseDrive
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.sets import UPSTREAM_2024

P = UPSTREAM_2024
STEP, EVERY, LATE = 0.01, 10, 4
"""s; steps from one decision to the next, and from a command to the motor."""
BIAS = 0.015
"""m, the most that a pose is off, along and across."""
PULLS, CLOSES = 2.0, 0.3
"""m/s2 at most; s in which an error of the speed is made good."""


@dataclass(frozen=True)
class Start:
    """One car: route, where it begins [m], the steps by which its decisions are shifted, the error
    of its clock [s], bias of its pose along and across [m]."""

    route: str
    s: float
    shift: int = 0
    clock: float = 0.0
    along: float = 0.0
    across: float = 0.0


class Network:
    """loss: share of messages that do not come; bursts: of seconds in which a way carries nothing;
    each is 10 to 50 ms late, so that they overtake each other."""

    def __init__(self, rng: np.random.Generator, n: int, loss: float = 0.0,
                 bursts: float = 0.0) -> None:
        self.rng, self.loss, self.bursts = rng, loss, bursts
        self.waiting: list[list[tuple[int, int, bytes]]] = [[] for _ in range(n)]
        self._phases = rng.uniform(0.0, 1.0, (n, n))
        self._out: dict[tuple[int, int, int], bool] = {}

    def send(self, k: int, i: int, data: bytes) -> None:
        for j, line in enumerate(self.waiting):
            if j == i or self.rng.random() < self.loss or self.silent(k, i, j):
                continue
            line.append((k + int(self.rng.integers(1, 6)), k, data))

    def silent(self, k: int, i: int, j: int) -> bool:
        """Whether the way from i to j carries nothing in this second."""
        slot = i, j, int(k * STEP + self._phases[i, j])
        if slot not in self._out:
            self._out[slot] = bool(self.rng.random() < self.bursts)
        return self._out[slot]

    def come(self, k: int, j: int) -> list[bytes]:
        due = [data for at, _, data in self.waiting[j] if at <= k]
        self.waiting[j] = [w for w in self.waiting[j] if w[0] > k]
        return due


class LightDrive:
    """One car along its path."""

    def __init__(self, layout: CrossingLayout, start: Start) -> None:
        self.path = layout.routes[layout.number(start.route)].path
        self.s, self.v, self.tau = start.s, 0.0, 0.0
        self.start, self.wanted = start, 0.0
        self.queue = [0.0] * LATE
        self.inverse, self._friction = InverseDrive(P), make_friction(P.friction)
        self._share = 1.0 - exp(-STEP / P.delay.throttle_lag_s)

    @property
    def seen(self) -> float:
        return self.s + self.start.along

    def decide(self, speed: float) -> None:
        """Throttle for a speed [m/s]; none where it has to slow down."""
        pull = min((speed - self.v) / CLOSES, PULLS)
        if speed <= 0.02 and self.v < 0.05:
            pull = -inf
        self.wanted = self.inverse.forward(max(self.v, 0.02), pull) if pull > -5.0 else 0.0

    def move(self) -> None:
        self.queue.append(self.wanted)
        self.tau += self._share * (self.queue.pop(0) - self.tau)
        m, tau = P.motor, self.tau
        pull = max(m.d - m.e * self.v, 0.0) * max(tau + m.g, 0.0)
        force = pull + self._friction(max(self.v, 0.0))
        self.v = max(self.v + STEP * force / P.body.mass, 0.0) if self.v > 0 or force > 0 else 0.0
        self.s += STEP * self.v

    def middle(self) -> tuple[float, float]:
        spot = self.path.interpolate(self.s)
        d = self.start.across
        return spot.x - d * sin(spot.heading), spot.y + d * cos(spot.heading)


@dataclass
class Run:
    """One arrival. least [m]: between two middles, ever; across [s]: when each had its ground
    behind it, inf: never; rows: s of each car at each decision."""

    least: float = inf
    across: list[float] = field(default_factory=list)
    rows: list[tuple[float, ...]] = field(default_factory=list)
    cars: list[Coordinator] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class Faults:
    """dead: (car, s from which its computer does nothing: it rolls out); mute: (car, s from which
    it sends nothing); restart: (car, t, s until it is back, whether it kept its stamp)."""

    dead: tuple[int, float] | None = None
    mute: tuple[int, float] | None = None
    restart: tuple[int, float, float, bool] | None = None


NO_FAULTS = Faults()


def coordinator(layout: CrossingLayout, starts: list[Start], i: int, boot: int, s: float,
                kept: int | None = None, keep=lambda stamp: None) -> Coordinator:
    names = tuple(f"car-{k}" for k in range(len(starts)))
    lane = layout.routes[layout.number(starts[i].route)].lane
    ahead = [(o.s, k) for k, o in enumerate(starts) if o.s > starts[i].s
             and layout.routes[layout.number(o.route)].lane == lane]
    return Coordinator(
        layout,
        names,
        names[i],
        starts[i].route,
        s,
        boot,
        stored_stamp=kept,
        store_stamp=keep,
        leader=names[min(ahead)[1]] if ahead else "",
    )


def drive(layout: CrossingLayout, starts: list[Start], network: Network, seconds: float,
          faults: Faults = NO_FAULTS, make=coordinator, ends: bool = True) -> Run:
    """Until all are across, or the time is over."""
    n, run = len(starts), Run(across=[inf] * len(starts), speeds=[0.0] * len(starts))
    cars = [LightDrive(layout, s) for s in starts]
    kept = [0] * n

    def keeping(i):
        return lambda stamp: kept.__setitem__(i, stamp)

    run.cars = [make(layout, starts, i, 1 + i, cars[i].seen, None, keeping(i)) for i in range(n)]
    off = [inf] * n
    for k in range(round(seconds / STEP)):
        t = k * STEP
        for i, (start, car) in enumerate(zip(starts, cars, strict=True)):
            if faults.restart is not None and i == faults.restart[0]:
                _, begin, lasts, keeps = faults.restart
                if k == round(begin / STEP):
                    off[i] = begin + lasts
                if off[i] <= t:
                    off[i] = inf
                    run.cars[i] = make(layout, starts, i, 100 + i, car.seen,
                                       kept[i] if keeps else 0, keeping(i))
            down = off[i] < inf or (faults.dead is not None and i == faults.dead[0]
                                    and car.s > faults.dead[1])
            if down:
                car.wanted = 0.0
                network.come(k, i)
            elif k % EVERY == start.shift:
                mute = faults.mute is not None and i == faults.mute[0] and t > faults.mute[1]
                run.speeds[i] = decide(layout, run.cars[i], car, cars, starts, network, k, i, mute)
                car.decide(run.speeds[i])
            car.move()
            if run.across[i] == inf and car.s > layout.exit[run.cars[i].route]:
                run.across[i] = t
        at = [car.middle() for car in cars]
        run.least = min(run.least, min((hypot(a[0] - b[0], a[1] - b[1]) for i, a in enumerate(at)
                                        for b in at[:i]), default=inf))
        if k % EVERY == 0:
            run.rows.append((t, *(car.s for car in cars)))
        if ends and max(run.across) < inf:
            break
    return run


def decide(layout, mind, car, cars, starts, network, k, i, mute=False) -> float:
    """One decision of car i: the speed [m/s] to drive."""
    t = k * STEP + starts[i].clock
    for data in network.come(k, i):
        mind.receive(data, t)
    ahead = [free for o in cars if o is not car if (free := gap(car, o)) < inf]
    answer = mind.step(t, car.seen, min(ahead, default=inf))
    if not mute:
        network.send(k, i, mind.next_message())
    ending = car.path.length - 0.1 - car.s
    return float(min(layout.speed, safe_speed(answer.line - car.seen), safe_speed(ending)))


AHEAD, BESIDE = 1.5, 0.12
"""m that the lidar looks ahead along the path, and to either side of it."""


def gap(car: LightDrive, other: LightDrive) -> float:
    """m along the path to the middle of a car on it; inf: there is none."""
    x, y = other.middle()
    spot = car.path.interpolate(car.s)
    if hypot(x - spot.x, y - spot.y) > AHEAD:
        return inf
    for d in np.arange(0.0, AHEAD, 0.05):
        at = car.path.interpolate(car.s + d)
        along = cos(at.heading) * (x - at.x) + sin(at.heading) * (y - at.y)
        left = cos(at.heading) * (y - at.y) - sin(at.heading) * (x - at.x)
        if abs(along) <= 0.03 and abs(left) < BESIDE:
            return float(d + along) if d + along > 0.0 else inf
    return inf


STRAIGHT = ("S-N", "E-W", "N-S", "W-E")


def arrivals(layout: CrossingLayout, seed: int, kind: str, ways: str = "straight") -> list[Start]:
    """Four cars. kind: random, within 1 m; near, within 0.15 m of each other; symmetric: exactly
    alike, at one time, without any bias. ways: straight, or any."""
    rng = np.random.default_rng([seed, 27])
    if layout.name == "merge":
        routes = ["lane", "lane", "ramp", "ramp"]
        base = np.array([1.0, 0.0, 1.0, 0.0])
    else:
        arms = ("S", "E", "N", "W")
        routes = list(STRAIGHT) if ways == "straight" else [
            str(rng.choice([r.name for r in layout.routes if r.lane == arm])) for arm in arms]
        base = np.zeros(4)
    if kind == "symmetric":
        return [Start(r, float(b) + 0.3) for r, b in zip(routes, base, strict=True)]
    spread = {"random": 0.45 if layout.name == "merge" else 1.0, "near": 0.15}[kind]
    s = base + rng.uniform(0.0, spread, 4)
    return [Start(r, float(at), int(rng.integers(0, EVERY)), float(rng.uniform(0.0, 100.0)),
                  *map(float, rng.uniform(-BIAS, BIAS, 2)))
            for r, at in zip(routes, s, strict=True)]


def kinds(count: int) -> list[tuple[int, str]]:
    """(seed, kind): half of them random, three tenths near, two tenths symmetric."""
    near, same = round(0.3 * count), round(0.2 * count)
    return [(k, "random" if k < count - near - same else "near" if k < count - same
             else "symmetric") for k in range(count)]


def waits(run: Run) -> set[CrossingWait]:
    """Names of all waiting there was."""
    return {wait for car in run.cars for _, wait, _ in car.events}


def phases(run: Run) -> list[CrossingPhase]:
    return [car.phase for car in run.cars]
