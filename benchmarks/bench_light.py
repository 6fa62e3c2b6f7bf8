"""How fast controllers and learning are served: the light simulation and DartCar-v0.

A step of the light simulation is 10 ms; one of the environment is 50 ms, so
five of them, with sensors, actuators, disturbance, observation and reward.
"""

from __future__ import annotations

import math

import numpy as np
from figures import Figure, best_cpu

from dart_hal.vehicle.native import status
from dart_lab.sim.light import (
    DART_ACTUATORS,
    FIRMWARE,
    Disturbance,
    LightBatch,
    LightCar,
    LightConfig,
)

ROUNDS, CARS = 4, 10_000
BARE = LightConfig(sensors=None)
FULL = LightConfig(sensors=FIRMWARE, actuators=DART_ACTUATORS,
                   disturbance=Disturbance(0.12, 0.12, 0.15))
BEAMS = 36
PUBLIC = "f1tenth_gym_jax without scan: 250-390 k of 10 ms"
"""For comparison: the fastest public environment of small cars, on another machine."""


def figures(scale: float = 1.0) -> list[Figure]:
    """Rows of the table."""
    engine = "compiled kernel" if status().startswith("compiled") else "numpy, no kernel"
    rows = [Figure("light: one car, bare", _one(BARE, round(20_000 * scale)), "steps/s", 50e3),
            Figure("light: one car, sensors, noise, force", _one(FULL, round(10_000 * scale)),
                   "steps/s"),
            Figure(f"light: {cars(scale):,} cars, bare", _many(BARE, scale), "car-steps/s",
                   note=engine),
            Figure(f"light: {cars(scale):,} cars, sensors, noise, force", _many(FULL, scale),
                   "car-steps/s", note=engine)]
    try:
        import dart_lab.sim.gym  # noqa: F401 - the extra may be absent
    except ValueError as why:
        return [*rows, Figure("DartCar-v0", math.nan, "", note=str(why).splitlines()[0])]
    return [*rows, _single(scale, FULL, "one car"),
            _single(scale, LightConfig(), "one car, perfect sensors, no force"),
            _vector(scale, 0.05, False), _vector(scale, 0.05, True), _vector(scale, 0.01, False),
            _vector(scale, 0.05, False, BEAMS)]


def cars(scale: float) -> int:
    """Cars of a batch."""
    return max(200, round(CARS * scale))


def _one(config: LightConfig, steps: int) -> float:
    car = LightCar(config=config)
    car.reset(v_x=1.0)
    has_sensors = config.sensors is not None

    def drive() -> None:
        for _ in range(steps):
            car.advance(0.3, 0.2)
            if has_sensors:
                car.read()

    return steps / best_cpu(drive, ROUNDS)


def _many(config: LightConfig, scale: float) -> float:
    n, steps = cars(scale), max(2, round(30 * scale))
    batch = LightBatch(n=n, config=config)
    start = np.zeros((6, n))
    start[3] = np.random.default_rng(0).uniform(0.5, 2.5, n)
    batch.reset(start)
    held = np.full(n, 0.3), np.random.default_rng(1).uniform(-0.5, 0.5, n)

    def drive() -> None:
        for _ in range(steps):
            batch.advance(*held)
            if config.sensors is not None:
                batch.read()

    return n * steps / best_cpu(drive, ROUNDS)


def _single(scale: float, light: LightConfig, name: str) -> Figure:
    from dart_lab.sim.gym import DartCarEnv

    env, steps = DartCarEnv(light=light), max(20, round(2000 * scale))
    env.reset(seed=0)
    action = np.array([0.27, 0.0], dtype=np.float32)

    def drive() -> None:
        for _ in range(steps):
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

    return Figure(f"DartCar-v0: {name}", steps / best_cpu(drive, ROUNDS), "env-steps/s",
                  note="resets included")


def _vector(scale: float, period: float, drawn: bool, beams: int = 0) -> Figure:
    from dart_lab.sim.gym import DartCarVectorEnv

    n, steps = cars(scale), max(2, round(20 * scale))
    env = DartCarVectorEnv(n, period=period, beams=beams, opponents=2 if beams else 0)
    env.reset(seed=0, options={"randomise": drawn})
    action = np.tile(np.array([0.27, 0.0], dtype=np.float32), (n, 1))
    for _ in range(round(1.5 / period)):   # until resets are spread over the steps
        env.step(action)

    def drive() -> None:
        for _ in range(steps):
            env.step(action)

    rate = n * steps / best_cpu(drive, ROUNDS)
    name = f"DartCar-v0: {n:,} cars, {1e3 * period:.0f} ms{', drawn anew at resets' * drawn}"
    if beams:
        name += f", {beams} beams, 2 opponents"
    target = 100e3 if period == 0.05 and not drawn and not beams else None
    return Figure(name, rate, "env-steps/s", target,
                  note=f"{rate * env.config.frame / 1e6:.1f} M car-steps/s"
                  + f"; {PUBLIC}" * (not beams))


def main() -> None:
    """Print the rows."""
    for f in figures():
        print(f"{f.name:<52}{f.measured:>26}{f.target:>14}  {f.note}")


if __name__ == "__main__":
    main()
