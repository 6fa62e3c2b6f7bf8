"""DartCar-v0 as pure functions: ``reset`` and ``step`` with a state that is passed on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from dart_hal.car.lidar import DEFAULT_MOUNT_X
from dart_hal.control.tracks import track_named
from dart_hal.vehicle import Vehicle
from dart_hal.vehicle.flat import bind, value, with_values
from dart_hal.vehicle.namespace import Value
from dart_lab.sim.gym.config import GymConfig, check_spread
from dart_lab.sim.gym.lidar import MAX_RANGE, RangeSensor, box_distances
from dart_lab.sim.gym.resets import make_config
from dart_lab.sim.gym.tasks import Memory, make_task
from dart_lab.sim.jax.light import Light, LightState
from dart_lab.sim.jax.ops import JAX_OPS
from dart_lab.sim.light.car import vehicle_named
from dart_lab.sim.light.sense import Reading

Array = Any


class EnvState(NamedTuple):
    """All that changes in an environment; a pytree of arrays.

    car: its motion and sensors; memory: of the task; k: steps of the episode; command: the last
    throttle and steering; factors: drawn parameters relative to the nominal ones, in the order of
    ``DartCar.spread``; key: of the random numbers.
    """

    car: LightState
    memory: Memory
    k: Array
    command: Array
    factors: Array
    key: Array


class EnvStep(NamedTuple):
    """Result of a step: observation, state, reward, and whether the episode ended, and how."""

    observation: Array
    state: EnvState
    reward: Array
    terminated: Array
    truncated: Array
    info: dict[str, Array]


class DartCar:
    """DartCar-v0 for ``jit``, ``vmap`` and ``grad``: observation, reward and ends are the same.

    Keywords are the fields of ``GymConfig``. ``names`` describes the observation, docs/how_to/
    learning.md each number of it. Random numbers come from the key of a reset, so noise and starts
    differ from those of gymnasium. Raises UsageError and ConfigError for invalid configurations.

    Example:
        >>> env = DartCar(track="vicon", speed=1.5)
        >>> observation, state = jax.vmap(env.reset)(jax.random.split(jax.random.key(1), 4096))
        >>> out = jax.jit(jax.vmap(env.step))(state, jnp.full((4096, 2), 0.2))
        >>> out.reward.shape
        (4096,)
    """

    def __init__(self, config: GymConfig | None = None, **changes: Any) -> None:
        self.config = c = make_config(config, changes)
        self._nominal = p = vehicle_named(c.vehicle)
        self._task = make_task(c, JAX_OPS, p.body.l_r)
        self.spread = check_spread(c.randomise, p)
        # Tyres and friction raise the rates of the lateral equations, mass and inertia lower them.
        self._fastest = with_values(p, {
            name: value(p, name) * (1.0 - half if name.startswith("body.") else 1.0 + half)
            for name, half in self.spread.items()})
        self._lidar = _Lidar(c) if c.beams else None
        self.names = tuple(name for name, _ in self._task.limits)
        self._limits = jnp.array([limit for _, limit in self._task.limits])

    def reset(self, key: Array) -> tuple[Array, EnvState]:
        """Begin an episode with random numbers of ``key``; return (observation, state)."""
        key, own, start, car = jax.random.split(key, 4)
        half = jnp.array(list(self.spread.values()))
        factors = 1.0 + half * jax.random.uniform(own, half.shape, minval=-1.0)
        state, memory = self._task.start(list(jax.random.uniform(start, (self._task.draws,))))
        light = self._light(factors)
        # The actuators begin at rest.
        s = light.start(car, (*state, 0.0 * state[0], 0.0 * state[0]))
        s, reading = light.read(s)
        new = EnvState(s, _as_floats(memory), jnp.asarray(0), jnp.zeros(2), factors, key)
        return self._observe(new, reading)

    def step(self, state: EnvState, action: Array) -> EnvStep:
        """Apply the action (throttle, steering), clipped to -1..1, for one period.

        The episode goes on after its end; see ``step_or_reset``.
        """
        command = jnp.clip(action, -1.0, 1.0)
        change = jnp.sum((command - state.command) ** 2)
        light = self._light(state.factors)
        frame = self.config.frame
        s = light.advance(state.car, command[0], command[1], frame)
        k = state.k + 1
        outcome, memory = self._task.judge(s.state, change, k, state.memory)
        s, reading = light.read(s, frame)
        observation, new = self._observe(
            EnvState(s, _as_floats(memory), k, command, state.factors, state.key), reading)
        return EnvStep(observation, new, outcome.reward, outcome.terminated,
                       k >= self.config.limit, outcome.info)

    def step_or_reset(self, state: EnvState, action: Array) -> EnvStep:
        """``step``, and a reset where the episode ended.

        State and observation are then those of the new episode; ``info["last"]`` has the last
        observation of the old one, for the value of a truncated episode.
        """
        out = self.step(state, action)
        done = jnp.logical_or(out.terminated, out.truncated)
        key, own = jax.random.split(out.state.key)
        first, fresh = self.reset(own)
        observation, new = jax.tree.map(lambda a, b: jnp.where(done, a, b), (first, fresh), (
            out.observation, out.state._replace(key=key)))
        return out._replace(observation=observation, state=new,
                            info={**out.info, "last": out.observation})

    def _light(self, factors: Array) -> Light:
        p = self._nominal
        drawn = dict(zip(self.spread, factors, strict=True))

        def lookup(name: str) -> Value:
            return value(p, name) * drawn[name] if name in drawn else value(p, name)

        vehicle: Vehicle = bind(p, lookup) if drawn else p
        return Light(vehicle, self.config.light, p, self._fastest)

    def _observe(self, s: EnvState, reading: Reading) -> tuple[Array, EnvState]:
        values = self._task.observe(reading, list(s.command), s.memory)
        observed = jnp.stack([jnp.asarray(v) for v in values])
        if self._lidar is not None:
            key, own = jax.random.split(s.key)
            s = s._replace(key=key)
            others = self._task.others(s.memory.kept)
            reach = self._lidar.ranges(self._task.rear_axle(s.car.state), others)
            noise = self.config.range_noise * jax.random.normal(own, reach.shape)
            observed = jnp.concatenate([observed, jnp.maximum(reach + noise, 0.0)])
        return jnp.clip(observed, -self._limits, self._limits).astype(jnp.float32), s


class _Lidar:
    """Ranges of one car, to the same boards and cars as ``gym.lidar.RangeSensor``."""

    def __init__(self, c: GymConfig) -> None:
        sensor = RangeSensor(track_named(c.track), c)
        self._bearing = jnp.asarray(sensor.bearing)
        self._lines = np.ascontiguousarray(sensor.lines.T)

    def ranges(self, pose: Sequence[Value], others: Sequence[Sequence[Value]]) -> Array:
        """Return distances (beams,) [m] from a rear axle x, y [m], yaw [rad].

        A ray o + t d meets the line from a to a + e where t d - u e = a - o with 0 <= u <= 1.
        """
        x, y, yaw = pose
        lidar_x = x + DEFAULT_MOUNT_X * jnp.cos(yaw)
        lidar_y = y + DEFAULT_MOUNT_X * jnp.sin(yaw)
        c = jnp.cos(yaw + self._bearing)
        s = jnp.sin(yaw + self._bearing)
        x1, y1, x2, y2 = self._lines
        dx = x1 - lidar_x
        dy = y1 - lidar_y
        ex = x2 - x1
        ey = y2 - y1
        area = c[:, None] * ey - s[:, None] * ex
        area = jnp.where(jnp.abs(area) < 1e-12, 1e-12, area)
        t = (dx * ey - dy * ex) / area
        u = (dx * s[:, None] - dy * c[:, None]) / area
        hit = jnp.where((t >= 0.0) & (u >= 0.0) & (u <= 1.0), t, MAX_RANGE).min(axis=1)
        reach = jnp.minimum(hit, MAX_RANGE)
        for other in others:
            reach = jnp.minimum(reach, box_distances(lidar_x, lidar_y, c, s, other, jnp))
        return reach


def _as_floats(memory: Memory) -> Memory:
    """Return the memory with one type for all numbers, as a loop needs it."""
    floats: Memory = jax.tree.map(lambda v: jnp.asarray(v, float), memory)
    return floats
