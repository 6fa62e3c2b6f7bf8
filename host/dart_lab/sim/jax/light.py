"""One light car as pure functions: start, advance, read."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from dart_hal.vehicle import Vehicle
from dart_hal.vehicle.namespace import Value
from dart_lab.sim.jax.ops import JAX_OPS, JaxHistory, make_jax_stepper
from dart_lab.sim.light.config import LightConfig
from dart_lab.sim.light.noise import Seed
from dart_lab.sim.light.plant import LightPlant
from dart_lab.sim.light.sense import Reading
from dart_lab.sim.light.stepper import State8, Stepper, Substeps, find_substeps

Array = Any


class LightState(NamedTuple):
    """All that changes in a light car; a pytree of arrays.

    state: that of ``LightCar``; k: steps since the start; queue: delayed commands, the newest
    first; servo: position behind the rate limit; force [N]: of the disturbance; ring: history of
    the signals; memory: of the effects on commands; travel, path [m]: of the encoder; bias: of gyro
    and accelerometer; last: reading; fresh: no reading since the start; key: of the random numbers.
    """

    state: State8
    k: Array
    queue: tuple[tuple[Array, Array], ...]
    servo: Array
    force: tuple[Array, Array]
    ring: Array
    memory: dict[str, Any]
    travel: Array
    path: Array
    bias: tuple[Array, Array, Array]
    last: Reading
    fresh: Array
    key: Array


class Light:
    """Functions of a light car whose result depends on their arguments alone.

    vehicle: its parameters may be traced, its pure delays and effects not; nominal: the vehicle of
    the pure delays; fastest: a vehicle that needs the most substeps, None = vehicle. Raises
    UsageError and ConfigError as ``LightCar`` does.

    Example:
        >>> light = Light(vehicle_named("paper"))
        >>> s = light.start(jax.random.key(0), jnp.zeros(8))
        >>> s = light.advance(s, 0.3, 0.1, steps=100)
        >>> s, reading = light.read(s, passed=100)
    """

    def __init__(self, vehicle: Vehicle, config: LightConfig | None = None,
                 nominal: Vehicle | None = None, fastest: Vehicle | None = None) -> None:
        self._plant = _JaxPlant(vehicle, config or LightConfig(), nominal or vehicle,
                                fastest or vehicle)

    def start(self, key: Array, state: Sequence[Value]) -> LightState:
        """Return a car that begins with a state (8) as that of ``LightCar``."""
        return _as_arrays(self._plant.start(key, state))

    def advance(self, s: LightState, throttle: Value, steering: Value,
                steps: int = 1) -> LightState:
        """Return the car after steps with constant commands -1..1."""
        def one(now: LightState, _: None) -> tuple[LightState, None]:
            self._plant.load(now)
            self._plant.advance(throttle, steering)
            return _as_arrays(self._plant.save()), None

        return jax.lax.scan(one, s, None, length=steps)[0]

    def read(self, s: LightState, passed: int = 0) -> tuple[LightState, Reading]:
        """Return the car after a reading, and the reading; passed: steps since the last one."""
        reading = self._plant.load(s).read_after(passed)
        return _as_arrays(self._plant.save()), reading


class _KeyStream:
    """Standard normal numbers from the key of a plant."""

    def __init__(self, plant: _JaxPlant, columns: int) -> None:
        self._plant = plant
        self._columns = columns

    def row(self) -> Array:
        """Return the next row."""
        return jax.random.normal(self._plant.next_key(), (self._columns,))


class _JaxPlant(LightPlant):
    """A plant that takes over a state before each call and gives it back after it."""

    def __init__(self, vehicle: Vehicle, config: LightConfig, nominal: Vehicle,
                 fastest: Vehicle) -> None:
        def make(p: Vehicle, step: float, method: str, substeps: Substeps,
                 kind: str = "car") -> Stepper:
            most = find_substeps(fastest, step, method).parts
            return make_jax_stepper(p, step, method, substeps, most, kind)

        self._key: Array = None
        self._fresh: Array = True
        super().__init__(vehicle, config, JAX_OPS, make, [0], False, nominal)
        if config.sensors is not None:
            self._history = JaxHistory(self._depth)

    def next_key(self) -> Array:
        """Return a new key."""
        self._key, own = jax.random.split(self._key)
        return own

    def make_stream(self, seeds: Sequence[Seed], stream: int, columns: int) -> Any:
        return _KeyStream(self, columns)

    def start(self, key: Array, state: Sequence[Value]) -> LightState:
        self._key = key
        self._fresh = True
        self.begin(tuple(state), list(jax.random.normal(self.next_key(), (5,))))
        if self._sensor_model is not None:
            self._sensor_model.last_reading = Reading(*(0.0 * v for v in state))
        return self.save()

    def read_after(self, passed: int) -> Reading:
        self._passed = passed
        reading = super().read(jnp.logical_not(self._fresh))
        self._fresh = False
        return reading

    def load(self, s: LightState) -> _JaxPlant:
        self.state = s.state
        self.k = s.k
        self._queue = deque(s.queue, maxlen=self._queue.maxlen)
        self._servo = s.servo
        self._memory.clear()
        self._memory.update(s.memory)
        self._travel = s.travel
        self._path = s.path
        self._bias = s.bias
        self._fresh = s.fresh
        self._key = s.key
        if self._force is not None:
            self._force.force = s.force
        if isinstance(self._history, JaxHistory):
            self._history.ring = s.ring
        if self._sensor_model is not None:
            self._sensor_model.last_reading = s.last
        return self

    def save(self) -> LightState:
        force = self._force.force if self._force is not None else (0.0, 0.0)
        ring = self._history.ring if isinstance(self._history, JaxHistory) else 0.0
        last = self._sensor_model.last_reading if self._sensor_model is not None else None
        return LightState(
            tuple(self.state), self.k, tuple(self._queue), self._servo, force, ring,
            {name: list(kept) for name, kept in self._memory.items()}, self._travel, self._path,
            tuple(self._bias), last or Reading(*[0.0] * 8), self._fresh, self._key)


def _as_arrays(s: LightState) -> LightState:
    """Return the state with one type for all numbers, as a loop needs it."""
    kind = jnp.result_type(float)
    numbers = s._replace(k=(), fresh=(), key=())
    floats: LightState = jax.tree.map(lambda v: jnp.asarray(v, kind), numbers)
    return floats._replace(k=jnp.asarray(s.k, int), fresh=jnp.asarray(s.fresh, bool), key=s.key)
