"""Rollouts of the equations of motion, differentiable in the parameters of the vehicle."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from dart_hal.core.timing import SAMPLE
from dart_hal.vehicle import Vehicle, make_car_step
from dart_lab.sim.jax.ops import JAX, JAX_METHODS

Array = Any


def rollout(p: Vehicle, start: Array, throttle: Array, steering: Array, *, dt: float = SAMPLE,
            method: str = "rk4") -> Array:
    """Compute the states (steps, 8, ...) from commands -1..1 (steps, ...), as ``car_rollout``.

    The result is that of ``dart_hal.vehicle.batch.car_rollout``, for one car or many. To
    differentiate with respect to parameters, make the vehicle inside of the function by
    ``dart_hal.vehicle.flat.make_setter``.

    Args:
        p: the vehicle; its parameters may be traced.
        start: state (8, ...) of the centre of mass [m, rad, m/s, rad/s] and of the actuators.
        throttle: (steps, ...); of a speed loop in m/s.
        steering: (steps, ...), 1 = full lock left.
        dt: length [s] of a step, for which a row of commands is held.
        method: "rk4", "midpoint" or "euler". Raises UsageError for another one.

    Example:
        >>> from dart_hal.vehicle.sets import PAPER
        >>> states = rollout(PAPER, jnp.zeros(8), jnp.full(100, 0.3), jnp.zeros(100))
        >>> states.shape
        (100, 8)
    """
    step = make_car_step(p, JAX, dt, method, JAX_METHODS)

    def advance(state: Array, command: Array) -> tuple[Array, Array]:
        new = jnp.stack(step(*state, *command))
        return new, new

    commands = jnp.stack([throttle, steering], axis=1)
    return jax.lax.scan(advance, jnp.asarray(start, commands.dtype), commands)[1]
