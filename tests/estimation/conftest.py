"""Simulated wheels, links and cars for the estimators."""

from __future__ import annotations

import math
import random
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import pytest

from dart_hal.estimation import ClockFit, Ring, WheelSpeed

NANO_TICK = 0.5e-6
BYTE_TIME = 10 / 500_000
STATE_WIRE = 44 * BYTE_TIME
FRAME_PERIOD = 0.01
LATCH = 0.2e-3


@dataclass
class Wheel:
    """A turning ring: edge times from a travel profile, frames at 100 Hz."""

    metres: float
    n: int
    fractions: Sequence[float] | None
    travel: Callable[[float], float]
    duration: float
    edges: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        ring = Ring(self.metres, self.n, self.fractions)
        step = 2e-4
        k = 1
        t = 0.0
        target = ring.position(k)
        while t < self.duration:
            x0 = self.travel(t)
            x1 = self.travel(t + step)
            while target <= x1:
                at = t + step * (target - x0) / (x1 - x0)
                self.edges.append(math.floor(at / NANO_TICK) * NANO_TICK)
                k += 1
                target = ring.position(k)
            t += step

    def frame(self, now: float) -> tuple[int, float, float, float]:
        """(count, t_edge, dt_prev, now) as in a STATE frame."""
        i = bisect_right(self.edges, now)
        t_edge = self.edges[i - 1] if i else 0.0
        dt = t_edge - self.edges[i - 2] if i > 1 else 0.0
        return i, t_edge, dt if dt < 65535 * NANO_TICK else 0.0, now


@dataclass
class SpeedRun:
    """Errors [m/s] and stated deviations of the second half of a run."""

    errors: list[float]
    stds: list[float]
    estimator: WheelSpeed

    @property
    def rms(self) -> float:
        return math.sqrt(sum(e * e for e in self.errors) / len(self.errors))


@pytest.fixture
def wheel() -> type[Wheel]:
    return Wheel


def simulate_speed(speed: Callable[[float], float], travel: Callable[[float], float], *,
                   metres: float, n: int, true_ring: Sequence[float] | None = None,
                   table: Sequence[float] | None = None, duration: float = 5.0,
                   upstream: bool = False) -> SpeedRun:
    """Run the estimator over a profile (speed(t), travel(t))."""
    ring = Wheel(metres, n, true_ring, travel, duration)
    estimator = WheelSpeed(metres, n, table)
    errors = []
    stds = []
    for k in range(1, int(duration / FRAME_PERIOD)):
        now = k * FRAME_PERIOD
        value, std = estimator.update(*ring.frame(now), 1.0, 1)
        if upstream:  # counts of the last 0.1 s, the negative control
            value = (ring.frame(now)[0] - ring.frame(now - 0.1)[0]) * metres / 0.1
        if now > duration / 2:
            errors.append(value - speed(now))
            stds.append(std)
    return SpeedRun(errors, stds, estimator)


@pytest.fixture
def speed_run() -> Callable[..., SpeedRun]:
    return simulate_speed


@dataclass
class ClockRun:
    """Errors of host time [s] by age of the stream, and of the arrival stamps."""

    early: list[float]
    late: list[float]
    arrival: list[float]
    stds: list[float]
    published: list[float]
    rate_error: float
    clock: ClockFit


def p99(values: Sequence[float]) -> float:
    return sorted(map(abs, values))[int(0.99 * len(values))]


def simulate_clock(disturbed: float, seed: int, *, duration: float = 40.0, jitter: float = 1e-3,
                   least: float = 0.2e-3, warm_up: float = 40e-6,
                   reset_at: float = math.inf) -> ClockRun:
    """A Nano with a resonator up to 0.5 % off behind a USB link.

    USB adds 0..``jitter`` s, a share ``disturbed`` of the frames an exponential
    tail of 12 ms mean; frames queue behind a late one. ``warm_up``: 40 ppm
    with 20 s time constant. ``reset_at`` [s]: the device clock restarts.
    """
    rng = random.Random(seed)
    error = rng.uniform(-0.005, 0.005)
    clock = ClockFit(byte_time=BYTE_TIME, latch_delay=LATCH)
    out = ClockRun([], [], [], [], [], 0.0, clock)
    boot = 5.0
    newest = 0.0
    next_ping = 5.1
    started = 5.0

    def device(t: float) -> float:
        age = t - boot
        return (1 + error) * age + warm_up * 20 * (1 - math.exp(-age / 20))

    def late() -> float:
        tail = rng.expovariate(1 / 0.012) if rng.random() < disturbed else 0.0
        return least + rng.random() * jitter + tail

    for k in range(1, int(duration * 100)):
        true = started + k * FRAME_PERIOD
        if boot < reset_at <= true:
            boot = reset_at = true - 0.001
            clock.restart()
        newest = max(newest, true + LATCH + STATE_WIRE + late())
        clock.add_frame(device(true), newest, STATE_WIRE)
        if true >= next_ping:
            next_ping += 0.1 if true < started + 3 else 0.5
            received = true + 12 * BYTE_TIME + least + rng.random() * jitter
            answered = received + 0.004
            clock.add_ping(true, device(received), device(answered),
                           answered + 22 * BYTE_TIME + late(), 34 * BYTE_TIME)
        t, std = clock.to_host(device(true))
        out.published.append(t)
        age = true - max(started, boot)
        if age > 20:
            out.late.append(t - true)
            out.arrival.append(newest - true)
            out.stds.append(std)
        elif age > 3:
            out.early.append(t - true)
    out.rate_error = clock.rate * (1 + error) - 1
    return out


@pytest.fixture
def clock_run() -> Callable[..., ClockRun]:
    return simulate_clock
