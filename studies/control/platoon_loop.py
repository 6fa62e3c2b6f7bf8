"""A platoon of points on a line: nothing but the laws, delays, noise and loss.

gap: from point to point, so that of net gaps; a contact is a gap of 0 or less.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import inf, pi, sin

import numpy as np

from dart_hal.control.platoon.follower import Gap, PlatoonFollower
from dart_hal.control.platoon.gains import PlatoonGains
from dart_hal.control.platoon.hearing import PredecessorReport
from dart_hal.control.platoon.laws import acc, clip, leader, limit_feed_forward
from dart_hal.control.platoon.safe import integrate_motion

Law = Callable[[float], float]


@dataclass(frozen=True)
class Scenario:
    """What the leader does (None: holds the speed), when it brakes fully [s], what is told in place
    of the truth about the acceleration of each car, by its number (0: the leader), and what is
    added to the told speed."""

    drive: Law | None = None
    brakes: tuple[float, float] = (inf, inf)
    attacks: dict[int, Law] = field(default_factory=dict)
    speeds: dict[int, Law] = field(default_factory=dict)


def random_scenario(
    rng: np.random.Generator, gains: PlatoonGains, cars: int, lasts: float
) -> Scenario:
    """Leader: holds, swings or jumps from acceleration to acceleration; two of three brake fully
    for a while; two of three have 1 to 3 links attacked: a constant, a square wave, or noise."""
    low, high = gains.u_min, gains.u_max
    kind, drive = rng.integers(3), None
    if kind == 1:
        size, period = rng.uniform(0.2, 1.0) * high, rng.uniform(2.0, 15.0)
        drive = lambda t: size * sin(2.0 * pi * t / period)  # noqa: E731
    elif kind == 2:
        values, each = rng.uniform(low, high, 200), rng.uniform(0.5, 4.0)
        drive = lambda t: float(values[int(t / each) % 200])  # noqa: E731
    begin = rng.uniform(0.1, 0.8) * lasts
    brakes = (begin, begin + rng.uniform(0.05, 0.9) * lasts) if rng.random() < 2 / 3 else (inf, inf)
    attacks = {}
    if rng.random() < 2 / 3:
        for link in rng.choice(cars, rng.integers(1, 4), replace=False):
            attacks[int(link)] = _attack(rng, gains, rng.uniform(0.0, 0.6) * lasts)
    return Scenario(drive, brakes, attacks)


def _attack(rng: np.random.Generator, gains: PlatoonGains, since: float) -> Law:
    kind, size = rng.integers(3), gains.u_max * 10.0 ** rng.uniform(-0.5, 3.0)
    if kind == 0:
        return lambda t: size if t >= since else 0.0
    if kind == 1:
        period = rng.uniform(1.0, 20.0)
        return lambda t: size * (1.0 if (t - since) % period < period / 2 else -1.0)
    values = rng.normal(0.0, size, 500)
    return lambda t: float(values[int(t * 10) % 500])


@dataclass(frozen=True)
class Line:
    """What lies between the cars. noise [m] of a gap, each 1/rate s (0: each step, exact); wrong
    [m/s]: of a told speed; loss: share of messages; brake: each car's
    hardest as a share of u_min, drawn between these."""

    noise: float = 0.0
    rate: float = 0.0
    wrong: float = 0.0
    loss: float = 0.0
    brake: tuple[float, float] = (1.0, 1.0)


def drive(
    scenario: Scenario,
    make: Callable[[], PlatoonFollower],
    n: int,
    lasts: float,
    *,
    dt: float,
    delay: float,
    line: Line | None = None,
    rng: np.random.Generator | None = None,
) -> tuple[np.ndarray, list[PlatoonFollower]]:
    """Gaps (steps, n) [m] of n followers behind a leader, and the followers."""
    line, rng = line or Line(), rng or np.random.default_rng(0)
    followers = [make() for _ in range(n)]
    gains = followers[0].gains
    p = [-gains.d * i for i in range(n + 1)]
    v, u, done = [gains.v_d] * (n + 1), [0.0] * (n + 1), [0.0] * (n + 1)
    queue = [[0.0] * (n + 1) for _ in range(round(delay / dt))]
    brake = rng.uniform(*line.brake, n + 1)
    gaps = np.empty((round(lasts / dt), n))
    for k in range(len(gaps)):
        t = k * dt
        for i, one in enumerate(followers, 1):
            if rng.random() >= line.loss:
                attack = scenario.attacks.get(i - 1)
                told = attack(t) if attack is not None else done[i - 1]
                said = v[i - 1] + line.wrong * rng.uniform(-1, 1)
                said += scenario.speeds[i - 1](t) if i - 1 in scenario.speeds else 0.0
                one.hearing.take(PredecessorReport(t, said, told), t)
            gap = None
            if not line.rate or int((t + 0.02 * i) * line.rate) > int((t + 0.02 * i - dt)
                                                                      * line.rate):
                off = rng.normal(0.0, line.noise) if line.noise else 0.0
                gap = Gap(t, p[i - 1] - p[i] + off, one.margins.e_g)
            u[i] = one.answer(t, v[i], gap)
        u[0] = _leads(scenario, gains, t, v[0])
        queue.append(list(u))
        acts = queue.pop(0)
        for i in range(n + 1):
            a = max(acts[i], gains.u_min * brake[i])
            way, after = integrate_motion(v[i], a, dt, gains.v_max)
            p[i], v[i], done[i] = p[i] + way, after, (after - v[i]) / dt
        gaps[k] = -np.diff(p)
    return gaps, followers


def _leads(scenario: Scenario, gains: PlatoonGains, t: float, v: float) -> float:
    if scenario.brakes[0] <= t < scenario.brakes[1]:
        return gains.u_min
    return clip(gains, scenario.drive(t) if scenario.drive else leader(gains, v))


def published(gains: PlatoonGains, n: int, dt: float, lasts: float, *, drive: Law | None = None,
              told: Law | None = None, forward: str = "limited", brakes: float = inf,
              delay: float = 0.0) -> np.ndarray:
    """Gaps (steps, n) [m] as the published simulation takes its steps: position by the old speed,
    speed clipped, the predecessor's acceleration of the last step. forward: "", "all", "limited";
    told: in place of the leader's acceleration."""
    scenario = Scenario(drive, (brakes, inf))
    p, v = -gains.d * np.arange(n + 1.0), np.full(n + 1, gains.v_d)
    done, queue = np.zeros(n + 1), [np.zeros(n + 1)] * round(delay / dt)
    gaps = np.empty((round(lasts / dt), n))
    for k in range(len(gaps)):
        t, u = k * dt, np.zeros(n + 1)
        u[0] = _leads(scenario, gains, t, v[0])
        for i in range(1, n + 1):
            gap, ahead = p[i - 1] - p[i], v[i - 1]
            a = told(t) if told is not None and i == 1 else done[i - 1]
            if forward != "all":
                a = limit_feed_forward(gains, gap, v[i], ahead, a) if forward else 0.0
            u[i] = clip(gains, acc(gains, gap, v[i], ahead) + a)
        queue.append(u)
        after = np.clip(v + dt * queue.pop(0), 0.0, gains.v_max)
        p, v, done = p + dt * v, after, (after - v) / dt
        gaps[k] = -np.diff(p)
    return gaps


def as_published(gains: PlatoonGains, alpha: float) -> PlatoonGains:
    """Another share of the distance for the feed-forward."""
    return replace(gains, alpha=alpha)
