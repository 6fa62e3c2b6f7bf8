"""Who holds the wheel: drivers of a stranger's car, each asked for (throttle, steering)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from studies.diagnosis.stranger import Now

Driver = Callable[[float, Now], tuple[float, float]]
STYLES = ("steps", "waves", "laps", "prbs", "ramps", "gentle")
HALL = 2.6  # m from the middle; beyond it a driver turns back


def driver(style: str, seconds: float, rng: np.random.Generator, rest: float = 1.5) -> Driver:
    """One of STYLES, standing still for ``rest`` [s] before."""
    if style == "laps":
        inner = _laps(rng)
    elif style == "ramps":
        inner = _ramps(seconds, rng)
    else:
        inner = _inside({"steps": _steps, "waves": _waves, "prbs": _prbs,
                         "gentle": _gentle}[style](seconds, rng))

    def driven(t: float, now: Now) -> tuple[float, float]:
        if t < rest:
            return 0.0, 0.0
        u, s = inner(t, now)
        return min(max(u, 0.0), 1.0), min(max(s, -1.0), 1.0)

    return driven


def _pieces(seconds: float, rng: np.random.Generator, hold: tuple[float, float],
            value: Callable[[float], float]) -> Callable[[float], float]:
    """A level that lasts for a while, then another: value(start) gives the levels."""
    starts, levels = [0.0], [value(0.0)]
    while starts[-1] < seconds:
        starts.append(starts[-1] + rng.uniform(*hold))
        levels.append(value(starts[-1]))
    edges = np.array(starts)
    return lambda t: levels[int(np.searchsorted(edges, t, side="right")) - 1]


def _pedal(rng: np.random.Generator, low: float, high: float) -> Callable[[float], float]:
    """Throttle levels: mostly cruising, now and then coasting or a push."""
    def level(_: float) -> float:
        pick = rng.random()
        if pick < 0.12:
            return 0.0
        return rng.uniform(0.34, 0.45) if pick < 0.22 else rng.uniform(low, high)

    return level


def _gas(seconds: float, rng: np.random.Generator, low: float, high: float,
         hold: tuple[float, float]) -> Callable[[float], float]:
    """Pushes and pauses are short, whatever the hold."""
    starts, levels, level = [0.0], [0.25], _pedal(rng, low, high)
    while starts[-1] < seconds:
        last = levels[-1]
        starts.append(starts[-1] + (rng.uniform(0.4, 0.8) if last > 0.33 or last == 0.0
                                    else rng.uniform(*hold)))
        levels.append(level(0.0))
    edges = np.array(starts)
    return lambda t: levels[int(np.searchsorted(edges, t, side="right")) - 1]


def _steps(seconds: float, rng: np.random.Generator) -> Driver:
    gas = _gas(seconds, rng, 0.215, 0.31, (0.8, 2.5))
    steer = _pieces(seconds, rng, (0.35, 2.0), lambda _: rng.uniform(-1.0, 1.0))
    return lambda t, now: (gas(t), steer(t))


def _waves(seconds: float, rng: np.random.Generator) -> Driver:
    gas = _gas(seconds, rng, 0.22, 0.31, (1.0, 3.0))
    big = _pieces(seconds, rng, (2.0, 5.0), lambda _: rng.uniform(0.2, 0.8))
    rate = rng.uniform(0.25, 0.5)
    base = _pieces(seconds, rng, (1.0, 3.0), lambda _: rng.choice([0.0, rng.uniform(-0.5, 0.5)]))

    def both(t: float, now: Now) -> tuple[float, float]:
        wave = math.sin(2 * math.pi * rate * t) + 0.4 * math.sin(2 * math.pi * 3.1 * rate * t)
        return gas(t), big(t) * wave / 1.2 + base(t)

    return both


def _prbs(seconds: float, rng: np.random.Generator) -> Driver:
    bit = 0.3
    high, low = rng.uniform(0.4, 0.9), -rng.uniform(0.4, 0.9)
    steer = rng.random(int(seconds / bit) + 2) < 0.5
    gas = rng.random(int(seconds / (3 * bit)) + 2) < 0.5
    levels = (rng.uniform(0.215, 0.235), rng.uniform(0.28, 0.32))
    return lambda t, now: (levels[int(gas[int(t / (3 * bit))])],
                           high if steer[int(t / bit)] else low)


def _gentle(seconds: float, rng: np.random.Generator) -> Driver:
    gas = _pieces(seconds, rng, (4.0, 9.0), lambda _: rng.uniform(0.215, 0.245))
    turn = _pieces(seconds, rng, (3.0, 7.0), lambda _: rng.uniform(0.1, 0.5) * rng.choice([-1, 1]))
    state = [0.0, 0.0]

    def both(t: float, now: Now) -> tuple[float, float]:
        share = 1.0 - math.exp(-(t - state[1]) / 0.5)
        state[0] += share * (turn(t) - state[0])
        state[1] = t
        return gas(t), state[0]

    return both


def _ramps(seconds: float, rng: np.random.Generator) -> Driver:
    """Circles to both sides with slow ramps of the throttle."""
    period = rng.uniform(14.0, 18.0)
    level = _pieces(seconds, rng, (period, period), lambda _: rng.uniform(0.3, 0.95))
    side = rng.choice([-1.0, 1.0])

    def both(t: float, now: Now) -> tuple[float, float]:
        lap, phase = divmod(t, period)
        up = 1.0 - abs(2.0 * phase / period - 1.0)
        return 0.21 + 0.11 * up, float(level(t) * side * (-1.0)**int(lap))

    return both


def _inside(inner: Driver) -> Driver:
    """Open-loop driving, with a turn back wherever the hall ends."""
    turning = [0.0]

    def both(t: float, now: Now) -> tuple[float, float]:
        u, s = inner(t, now)
        r = math.hypot(now.x, now.y)
        away = math.remainder(math.atan2(-now.y, -now.x) - now.yaw, 2 * math.pi)
        if turning[0] and abs(away) < 0.5:
            turning[0] = 0.0
        elif not turning[0] and r > HALL and abs(away) > 1.2:
            turning[0] = math.copysign(1.0, away)
        return (u, 0.85 * turning[0]) if turning[0] else (u, s)

    return both


def _laps(rng: np.random.Generator) -> Driver:
    """Pure pursuit of a closed curve, in turns to either side, at speeds that change."""
    a, b, bend = rng.uniform(1.5, 2.4), rng.uniform(1.0, 1.5), rng.uniform(0.1, 0.35)
    eight = rng.random() < 0.6
    speeds = rng.uniform(0.7, 1.7, 400)
    phase = [0.0]

    def point(p: float) -> tuple[float, float]:
        if eight:
            return a * math.sin(p), b * math.sin(2 * p)
        return a * math.cos(p) + bend * math.cos(3 * p), b * math.sin(p)

    def both(t: float, now: Now) -> tuple[float, float]:
        ahead = 0.25 + 0.25 * max(now.v, 0.3)
        for _ in range(200):
            px, py = point(phase[0])
            if math.hypot(px - now.x, py - now.y) > ahead:
                break
            phase[0] += 0.01
        bearing = math.remainder(math.atan2(py - now.y, px - now.x) - now.yaw, 2 * math.pi)
        wanted = math.atan(2 * 0.175 * math.sin(bearing) / ahead)
        v = speeds[int(t / 3.0) % len(speeds)]
        return 0.21 + 0.045 * v + min(max(0.15 * (v - now.v), -0.08), 0.08), 2.2 * wanted

    return both
