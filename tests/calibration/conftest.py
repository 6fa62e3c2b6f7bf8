"""A small generator of cars, independent of the simulator, for the estimator's tests."""

from __future__ import annotations

import contextlib
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from dart_hal.core.config import CarFiles, parse_car
from dart_hal.core.types import NEUTRAL_APPLIED, Applied, Health, Pose, State
from dart_hal.vehicle.parameters import Steering
from dart_hal.vehicle.sets import PAPER
from dart_hal.vehicle.steering import make_steering

sys.path.append(str(Path(__file__).parent))  # esc_pin, hidden_errors

CAR_TOML = """
schema = "dart-hal/car/1"
name = "bench"
[geometry]
wheelbase = 0.175
l_f = 0.0805
l_r = 0.0945
mass = 1.67
[pwm]
oscillator_hz = { value = 25000000.0, std = 2500.0 }
[encoder]
metres_per_edge = { value = 0.0020646, std = 0.0000248 }
"""
FLAT = Health(frozenset(), 0.005, 0.0, 0, 0, 5.0, 1e-4, "linear", (0, 3, 0, 0))


@dataclass
class BenchCar:
    """Bicycle with slip, servo lag and backlash; one State each 10 ms of its own time."""

    files: CarFiles
    curve: Steering = PAPER.steering
    backlash: float = 0.015
    kappa: float = 0.04
    speed_scale: float = 1.0
    gyro_scale: float = 1.0
    gyro_bias: float = 0.003
    gyro_sign: float = 1.0
    encoder: str = "ok"
    esc: str = "ok"
    ground: bool = True
    imu: bool = True
    interrupt_at: float = math.inf
    seed: int = 0
    t: float = 0.0
    v: float = 0.0
    command: float = 0.0
    angle: float = 0.0
    travelled: float = 0.0
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    applied: Applied = NEUTRAL_APPLIED
    push: float = 0.0
    stops: int = 0
    refused: tuple[str, ...] = ()
    armed: bool = False
    max_distance: float = 0.0
    max_speed: float = 0.0
    pulses_sent: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)

    @contextlib.contextmanager
    def raw(self) -> Iterator[None]:
        self.armed = True
        try:
            yield
        finally:
            self.armed = False

    def arm(self, *, waive: tuple[str, ...] = ()) -> None:
        self.armed = True

    def refusals(self) -> tuple[str, ...]:
        return self.refused

    def stop(self) -> None:
        self.stops += 1
        self.applied = replace(self.applied, throttle_us=1500.0)

    def pulses(self, *, steering_us: float, throttle_us: float) -> Applied:
        assert self.armed
        self.pulses_sent.append(steering_us)
        self.applied = Applied(0.0, 0.0, steering_us, throttle_us)
        return self.applied

    def states(self, *, duration: float = math.inf, timeout: float = 0.5) -> Iterator[State]:
        end = self.t + duration
        while self.t < end:
            if self.t >= self.interrupt_at:
                raise KeyboardInterrupt
            for _ in range(5):
                self._step(0.002)
            self.max_speed = max(self.max_speed, self.v)
            yield self._state()

    def true_angle(self, command: np.ndarray) -> np.ndarray:
        return make_steering(self.curve, np)(command)

    def _step(self, dt: float) -> None:
        self.t += dt
        target = (self.applied.steering_us - 1500.0) / 375.0
        self.command += (target - self.command) * dt / 0.08
        middle = make_steering(self.curve)(self.command)
        half = self.backlash / 2.0
        self.angle = min(max(self.angle, middle - half), middle + half)
        tau = (self.applied.throttle_us - 1500.0) / 450.0 if self.esc == "ok" else 0.0
        drive = max(0.0, tau - 0.15) * (28.9 - 6.0 * self.v)
        drag = 1.72 * math.tanh(13.0 * self.v) + 0.29 * self.v
        self.v = max(0.0, self.v + (drive + self.push - drag) / 1.67 * dt)
        self.travelled += self.v * dt
        self.yaw += self._rate() * dt
        self.x += self.v * math.cos(self.yaw) * dt
        self.y += self.v * math.sin(self.yaw) * dt
        self.max_distance = max(self.max_distance, math.hypot(self.x, self.y))

    def _rate(self) -> float:
        bend = math.tan(self.angle) / (1.0 + self.kappa * self.v**2)
        return self.v * bend / 0.175 if self.ground else 0.0

    def _state(self) -> State:
        gyro = self.gyro_sign * self.gyro_scale * self._rate() + self.gyro_bias
        gyro = round((gyro + self.rng.normal(0.0, 0.002)) / 0.00109083) * 0.00109083
        measured = 0.0 if self.encoder == "dead" else self.v * self.speed_scale
        if measured:
            measured *= 1.0 + self.rng.normal(0.0, 0.01)
        ticks = 0 if self.encoder == "dead" else int(self.travelled / 0.0020646)
        return State(self.t, int(self.t * 100), measured, 0.01, gyro if self.imu else None, 0.0,
                     0.0, ticks, Pose(self.x, self.y, self.yaw), self.applied, FLAT)


@pytest.fixture
def car_toml() -> str:
    return CAR_TOML


@pytest.fixture
def files(tmp_path) -> CarFiles:
    return parse_car(CAR_TOML, "bench", [tmp_path])


@pytest.fixture
def bench(files):
    """``bench(**what)`` -> BenchCar."""
    return lambda **what: BenchCar(files=files, **what)


@pytest.fixture
def drawn(files):
    """``drawn(seed)`` -> BenchCar with a hidden steering, slip, scales and backlash."""
    def draw(seed: int) -> BenchCar:
        rng = np.random.default_rng([seed, 7])
        base = PAPER.steering
        f = rng.uniform(0.92, 1.08, 4)
        curve = Steering(base.k_left * f[0], base.a_left_rad * f[1],
                         base.s0 + rng.uniform(-0.06, 0.06), base.a_right_rad * f[2],
                         base.k_right * f[3])
        return BenchCar(files=files, curve=curve, backlash=rng.uniform(0.005, 0.035),
                        kappa=rng.uniform(0.0, 0.06), speed_scale=1.0 + rng.normal(0.0, 0.012),
                        gyro_scale=1.0 + rng.uniform(-0.01, 0.01),
                        gyro_bias=rng.uniform(-0.01, 0.01), seed=seed)
    return draw
