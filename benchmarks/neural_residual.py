"""A black box to compare with: the bicycle model plus a neural network that adds accelerations.

    d/dt [v_x, v_y, omega] = bicycle(state, throttle, angle) + network(state, throttle, angle)

Both inputs are behind delay and lag. The network has two hidden layers and is held over a sample of
10 ms. It is trained through rollouts of 1 s. Needs the extra ``bench`` (JAX).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.bicycle import make_dynamic
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.integrate import MAX_RELAXATION, make_dynamic_midpoint
from dart_hal.vehicle.motor import make_motor_gains
from dart_hal.vehicle.namespace import adapt
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evaluation.cases import Case
from dart_lab.identification.evaluation.prediction import errors, measured, parts
from dart_lab.identification.prediction.rollout import cut_windows, inputs

Network = Any
"""[(weights, offsets)] of each layer, with the scales of inputs and outputs that stay fixed."""

HIDDEN = 24
STEPS = 500
BATCH = 256
"""Windows of a step of Adam, drawn without replacement."""
RATE = 3e-3
"""Step size of Adam at the start; it falls to 0 as a half cosine."""
SECOND = round(1.0 / SAMPLE)
SUBSTEPS = 2
"""Midpoint steps in a sample. Errors are within 1e-5 of the project's four Runge-Kutta steps."""


class Windows(NamedTuple):
    """start (6, n), inputs (samples, 2, n), and truth (samples, 3, n): the measured velocities."""

    start: FloatArray
    inputs: FloatArray
    truth: FloatArray


class Scales(NamedTuple):
    """Mean and spread of the five inputs; spread of the velocities and of accelerations (3, 1)."""

    mean: FloatArray
    spread: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


def make_windows(vehicle: Vehicle, cases: Sequence[Case], samples: int = SECOND) -> Windows:
    """Collect the windows of the evaluation, with commands behind the vehicle's actuators."""
    throttle, angle, first = inputs(vehicle, parts(cases))
    both = np.stack([cut_windows(s, first, samples) for s in (throttle, angle)], axis=1)
    states = measured(cases, range(samples + 1))
    return Windows(*(np.asarray(a, np.float32) for a in (states[0], both, states[1:, 3:])))


def make_scales(windows: Windows) -> Scales:
    """Measure the scales of training windows; accelerations are means over 0.1 s."""
    samples = np.concatenate([windows.start[3:], windows.inputs[0]])
    rise = (windows.truth[9] - windows.start[3:]) / 0.1
    return Scales(samples.mean(axis=1, keepdims=True), samples.std(axis=1, keepdims=True),
                  windows.truth.std(axis=(0, 2))[:, None], rise.std(axis=1, keepdims=True))


def make_network(seed: int = 0) -> Network:
    """Draw the hidden layers; the last layer is zero, so that training starts at the bicycle."""
    rng = np.random.default_rng(seed)
    sizes = (5, HIDDEN, HIDDEN, 3)
    layers = [[rng.normal(0.0, n**-0.5, (m, n)), np.zeros((m, 1))]
              for n, m in pairwise(sizes)]
    layers[-1][0] *= 0.0
    return jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), layers)


def add_accelerations(network: Network, scales: Scales, velocity: Any, held: Any) -> Any:
    """Compute what the network adds to the three accelerations (3, n)."""
    x = (jnp.concatenate([velocity, held]) - scales.mean) / scales.spread
    for weights, offsets in network[:-1]:
        x = jnp.tanh(weights @ x + offsets)
    weights, offsets = network[-1]
    return scales.acceleration * (weights @ x + offsets)


def make_rollout(vehicle: Vehicle, scales: Scales) -> Callable[..., Any]:
    """``rollout(network, start, inputs)`` -> states (samples, 6, n) after each sample."""
    p = apply_parameter_effects(vehicle)
    f = adapt(jnp)
    dt = SAMPLE / SUBSTEPS
    bicycle = make_dynamic(p, f, max_rate=MAX_RELAXATION["midpoint"] / dt)
    gains = make_motor_gains(p.motor, f)

    def rates(eta: Any, vx: Any, vy: Any, om: Any, *held: Any) -> Any:
        *slow, ax, ay, turn = bicycle(eta, vx, vy, om, *held[:5])
        return (*slow, ax + held[5], ay + held[6], turn + held[7])

    step = make_dynamic_midpoint(rates)

    def advance(network: Network, state: Any, held: Any) -> tuple[Any, Any]:
        k0, k1 = gains(held[0])
        added = add_accelerations(network, scales, state[3:], held)
        u = (k0, k1, 0.0, jnp.cos(held[1]), jnp.sin(held[1]), *added)
        moved = tuple(state)
        for _ in range(SUBSTEPS):
            moved = step(*moved, dt, u, u, u)
        state = jnp.stack(moved)
        return state, state

    def rollout(network: Network, start: Any, held: Any) -> Any:
        return jax.lax.scan(lambda s, u: advance(network, s, u), start, held)[1]

    return rollout


def train(vehicle: Vehicle, windows: Windows, steps: int = STEPS, batch: int = BATCH,
          seed: int = 0) -> tuple[Network, list[float]]:
    """Train a network on windows of 1 s; (network, loss of the batch at each step).

    The loss is the mean square of the velocity errors over the second, each channel divided by its
    spread. Adam with the usual constants .9, .999 and 1e-8.
    """
    scales = make_scales(windows)
    rollout = make_rollout(vehicle, scales)

    def loss(network: Network, some: Windows) -> Any:
        wrong = rollout(network, some.start, some.inputs)[:, 3:] - some.truth
        return jnp.mean((wrong / scales.velocity)**2)

    @jax.jit
    def update(i: Any, state: Any, some: Windows) -> Any:
        network, mean, square = state
        value, slope = jax.value_and_grad(loss)(network, some)
        mean = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, mean, slope)
        square = jax.tree.map(lambda v, g: 0.999 * v + 0.001 * g * g, square, slope)
        rate = RATE * 0.5 * (1.0 + jnp.cos(jnp.pi * i / steps))
        a, b = 1.0 - 0.9**(i + 1.0), 1.0 - 0.999**(i + 1.0)
        network = jax.tree.map(lambda w, m, v: w - rate * m / a / (jnp.sqrt(v / b) + 1e-8),
                               network, mean, square)
        return (network, mean, square), value

    rng = np.random.default_rng(seed)
    network = make_network(seed)
    zero = jax.tree.map(jnp.zeros_like, network)
    state = (network, zero, zero)
    values = []
    n = windows.start.shape[1]
    for i in range(steps):
        few = rng.choice(n, min(batch, n), replace=False)
        state, value = update(float(i), state, Windows(*(a[..., few] for a in windows)))
        values.append(float(value))
    return state[0], values


def compute_errors(vehicle: Vehicle, network: Network, scales: Scales,
                   cases: Sequence[Case]) -> FloatArray:
    """Compute RMS errors 1 s ahead (5,) in the order of ``evaluate.prediction.CHANNELS``."""
    windows = make_windows(vehicle, cases)
    # starts at the origin: float32 keeps 1e-7 of a path of 1 s, not of a position in the hall
    moved = windows.start.copy()
    moved[:3] = 0.0
    rollout = jax.jit(make_rollout(vehicle, scales))
    end = np.asarray(rollout(network, moved, windows.inputs)[-1], np.float64)
    start = measured(cases, (0,))[0]
    c, s = np.cos(start[2]), np.sin(start[2])
    end[:3] = (start[0] + c * end[0] - s * end[1], start[1] + s * end[0] + c * end[1],
               start[2] + end[2])
    wrong = errors(end[None], measured(cases, (SECOND,)))[0]
    return np.sqrt(np.mean(wrong**2, axis=1))
