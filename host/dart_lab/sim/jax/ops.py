"""What the light simulation needs of JAX: operations, a history of signals, a stepper."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from dart_hal.vehicle import Vehicle, make_car_step, make_motion_step
from dart_hal.vehicle.namespace import Value, adapt
from dart_hal.vehicle.step import METHODS
from dart_lab.sim.light.history import Rows
from dart_lab.sim.light.ops import Ops
from dart_lab.sim.light.stepper import State8, Stepper, Substeps

# jnp.fmin and jnp.fmax ignore NaN, which takes a comparison more.
JAX = replace(adapt(jnp), fmin=jnp.minimum, fmax=jnp.maximum)
JAX_OPS = Ops(JAX, jnp.where, lambda v: jnp.floor(v).astype(int), jnp.asarray, jnp.logical_and,
              jnp.logical_or, jnp)
# Of a stage of RK4: weight of its rates in the step, and length of the way to the next stage.
RK4_STAGES = ((1.0 / 6.0, 0.5), (1.0 / 3.0, 0.5), (1.0 / 3.0, 1.0), (1.0 / 6.0, 0.0))


def make_staged_rk4(rates: Callable[..., Any]) -> Callable[..., Any]:
    """Return a step as ``integrate.make_dynamic_step`` or ``make_kinematic_step`` do, by a loop.

    In a rollout XLA computes unrolled stages again wherever a later one needs them: 100 steps of
    131 cars in double precision took twenty times as long. A loop computes and compiles each once.
    """
    def step(*arguments: Value) -> tuple[Value, ...]:
        *state, dt, start, middle, end = arguments
        inputs = (*start, *middle, *middle, *end)
        n = len(state)
        together = jnp.stack(jnp.broadcast_arrays(*state, *inputs))
        begun = together[:n]

        def stage(now: tuple[Value, Value], part: Any) -> tuple[tuple[Value, Value], None]:
            at, total = now
            held, (weight, way) = part
            # Positions, the first two numbers of a state, do not act on its rates.
            rate = jnp.stack(rates(*at[2:], *held))
            return ((begun + way * dt * rate).astype(begun.dtype),
                    (total + weight * rate).astype(begun.dtype)), None

        parts = (together[n:].reshape(len(RK4_STAGES), -1, *begun.shape[1:]),
                 jnp.array(RK4_STAGES, begun.dtype))
        total = jax.lax.scan(stage, (begun, jnp.zeros_like(begun)), parts)[0][1]
        return tuple(begun + dt * total)

    return step


JAX_METHODS = {**METHODS, "rk4": (make_staged_rk4, make_staged_rk4)}


class JaxHistory:
    """History of one car in an array (depth, signals), the newest first."""

    def __init__(self, depth: int) -> None:
        self._depth = depth
        self.ring: Any = None

    def push(self, signals: Any) -> None:
        """Append the signals of a new step, and drop the oldest."""
        self.ring = jnp.concatenate([jnp.stack(signals)[None], self.ring[:-1]])

    def fill(self, rows: Rows, lanes: Any = None) -> None:
        """Replace the whole history."""
        self.ring = jnp.stack([jnp.stack(rows(k)) for k in range(self._depth)])

    def value(self, signal: int, back: Value) -> Value:
        """Return a signal ``back`` steps ago, linear between steps."""
        k = jnp.floor(back).astype(int)
        newer = self.ring[k, signal]
        return newer + (back - k) * (self.ring[k + 1, signal] - newer)


def make_jax_stepper(p: Vehicle, step: float, method: str, substeps: Substeps, max_parts: int,
                     kind: str = "car") -> Stepper:
    """Make ``stepper(state, throttle, steering) -> state`` for one car, see ``light.stepper``.

    A slow car takes several short steps. Their number may depend on a traced vehicle, and differs
    between the cars of a batch: the batch is driven on until the slowest car has taken its steps.
    JAX cannot differentiate a loop of unknown length backward, so derivatives are those of
    ``max_parts`` steps, of which each car drops those that it does not take.
    """
    def run(bounded: bool, state: State8, tau: Value, s: Value, slow_speed: Value,
            slow_parts: Value) -> State8:
        parts = jnp.where(jnp.abs(state[3]) < slow_speed, slow_parts, 1)
        advance = (make_motion_step(p, JAX, step / parts, 1, method) if kind == "motion"
                   else make_car_step(p, JAX, step / parts, method))

        def substep(k: Value, old: State8) -> State8:
            return tuple(jnp.where(k < parts, new, was).astype(was.dtype)
                         for new, was in zip(advance(*old, tau, s), old, strict=True))

        ended: State8
        if bounded:
            ended = jax.lax.fori_loop(0, max_parts, substep, state)
        else:
            ended = jax.lax.while_loop(lambda loop: loop[0] < parts, lambda loop: (
                loop[0] + 1, substep(*loop)), (0, state))[1]
        return ended

    def stepper(state: State8, tau: Value, s: Value) -> State8:
        arguments = (tuple(map(jnp.asarray, state)), jnp.asarray(tau), jnp.asarray(s),
                     jnp.asarray(substeps.speed), jnp.asarray(substeps.parts))
        # A function with its own derivative needs all that is traced as arguments, also parameters
        # of the vehicle.
        (fast, fast_values), (bounded, bounded_values) = (
            jax.closure_convert(partial(run, whether), *arguments) for whether in (False, True))

        @jax.custom_jvp
        def drive(arguments: Any, fast_values: Any, bounded_values: Any) -> State8:
            ended: State8 = fast(*arguments, *fast_values)
            return ended

        @drive.defjvp
        def differentiate(values: Any, changes: Any) -> tuple[State8, State8]:
            ended: tuple[State8, State8] = jax.jvp(
                lambda arguments, _, traced: bounded(*arguments, *traced), values, changes)
            return ended

        driven: State8 = drive(arguments, tuple(fast_values), tuple(bounded_values))
        return driven

    return stepper
