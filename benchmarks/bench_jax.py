"""How fast the simulation on JAX is for many cars on one core, and a peer in the same process.

4,096 cars in f32 at steps of 10 ms, all in one compiled loop: DART without sensors and with all of
it, and the single-track car of f1tenth_gym (``single_track``), written for JAX too.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from typing import Any

# One core for all engines.
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false "
                      "intra_op_parallelism_threads=1")

import numpy as np
from bench_light import BARE, FULL
from figures import Figure, best_cpu
from single_track import make_step

CARS = 4096
STEPS = 200
ROUNDS = 4
MIN_RATIO = 3.0


def figures(scale: float = 1.0) -> list[Figure]:
    """Rows of the table."""
    try:
        import jax
    except ImportError as why:
        return [Figure("JAX: 4,096 cars", math.nan, "", note=str(why))]
    from dart_lab.sim.jax import Light
    from dart_lab.sim.light.car import vehicle_named

    jnp = jax.numpy
    steps = max(10, round(STEPS * scale))
    speed = np.random.default_rng(0).uniform(0.5, 2.5, CARS)
    side = np.random.default_rng(1).uniform(-0.5, 0.5, CARS)

    def dart(config: Any) -> Callable[[], None]:
        light = Light(vehicle_named("paper"), config)
        keys = jax.random.split(jax.random.key(0), CARS)
        states = np.zeros((CARS, 8))
        states[:, 3] = speed
        cars = jax.vmap(light.start)(keys, jnp.asarray(states))
        held = jnp.asarray(side)

        def go(car: Any, steering: Any) -> Any:
            if config.sensors is None:
                return light.advance(car, 0.3, steering, steps=steps).state

            def one(now: Any, _: None) -> tuple[Any, None]:
                now, _ = light.read(light.advance(now, 0.3, steering), passed=1)
                return now, None

            return jax.lax.scan(one, car, None, length=steps)[0].state

        work = jax.jit(jax.vmap(go))
        return lambda: jax.block_until_ready(work(cars, held))

    def peer() -> Callable[[], None]:
        step = make_step(jnp, jnp.where)
        first = tuple(jnp.asarray(speed if i == 3 else 0.0 * speed, jnp.float32) for i in range(7))
        held = jnp.asarray(side, jnp.float32)

        def go(s: Any, steering: Any) -> Any:
            return jax.lax.scan(lambda now, _: (step(now, steering, jnp.float32(1.0)), None), s,
                                None, length=steps)[0]

        work = jax.jit(jax.vmap(go))
        return lambda: jax.block_until_ready(work(first, held))

    def rate(work: Callable[[], None]) -> float:
        work()  # compiles
        return CARS * steps / best_cpu(work, ROUNDS)

    bare, full, other = (rate(work) for work in (dart(BARE), dart(FULL), peer()))
    return [Figure("JAX: 4,096 cars, bare", bare, "car-steps/s"),
            Figure("JAX: 4,096 cars, sensors, noise, force", full, "car-steps/s"),
            Figure("JAX: single-track car of f1tenth_gym", other, "car-steps/s",
                   note="the peer: no motor, friction, delay, lag or sensor; linear tyres"),
            Figure("JAX: bare over the peer", bare / other, "times", low=MIN_RATIO)]


def main() -> None:
    """Print the rows."""
    for f in figures():
        print(f"{f.name:<52}{f.measured:>26}{f.target:>14}  {f.note}")


if __name__ == "__main__":
    main()
