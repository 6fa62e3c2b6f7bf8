"""Many cars as ``gymnasium.vector.VectorEnv``, computed together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from dart_hal.core.errors import BadCommand, UsageError
from dart_hal.vehicle.flat import bind, value
from dart_lab.sim.gym.config import GymConfig
from dart_lab.sim.gym.lidar import LidarObservation
from dart_lab.sim.gym.render import TrackPicture
from dart_lab.sim.gym.resets import (
    ResetDraws,
    action_box,
    make_config,
    new_generator,
    noise_seed,
    observation_box,
)
from dart_lab.sim.gym.tasks import Memory, make_task
from dart_lab.sim.light.batch import LightBatch
from dart_lab.sim.light.car import vehicle_named
from dart_lab.sim.light.ops import ARRAY_OPS
from dart_lab.sim.light.sense import Reading

Array = NDArray[Any]


class DartCarVectorEnv(gymnasium.vector.VectorEnv[Array, Array, Array]):
    """n environments in one, each equal to a ``DartCarEnv`` with its seed.

    Autoreset mode NEXT_STEP: the step after the last one of an episode ignores the action, resets
    and returns reward 0. Keywords and options are those of DartCarEnv. ``cars.state`` is the truth.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"], "render_fps": 20,
        "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(self, num_envs: int = 1, config: GymConfig | None = None,
                 render_mode: str | None = None, **changes: Any) -> None:
        self.config = c = make_config(config, changes)
        self.num_envs = num_envs
        self.render_mode = render_mode
        self._nominal = vehicle_named(c.vehicle)
        self.cars = LightBatch(self._nominal, num_envs, c.light)
        self._task = make_task(c, ARRAY_OPS, self._nominal.body.l_r)
        self._draws = ResetDraws(c.randomise, self._nominal, self._task.draws)
        self._lidar = LidarObservation(c, self._task, scalar=False)
        self._factors: dict[str, Array] = {}
        self.names = tuple(name for name, _ in self._task.limits)
        self.single_action_space = action_box()
        self.single_observation_space = observation_box(self._task)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._limits = np.array([limit for _, limit in self._task.limits])[:, None]
        self._command = np.zeros((2, num_envs))
        self._k = np.zeros(num_envs, dtype=np.intp)
        self._done = np.zeros(num_envs, dtype=bool)
        self._memory = Memory(0.0, ())
        self._rngs: list[np.random.Generator] = []
        self._picture: TrackPicture | None = None

    def reset(self, *, seed: int | Sequence[int | None] | None = None,
              options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Start an episode in all environments; seed n gives environment i the seed n + i."""
        self._draws.set(options)
        seeds = self._new_seeds(seed)
        if len(seeds):
            self._seed_generators(seeds)
        else:
            self.cars.skip(self.config.frame)
        self._done[:] = False
        self._factors = {name: np.ones(self.num_envs) for name in self._draws.spread}
        self._restart(np.arange(self.num_envs))
        reading = self.cars.read()
        return self._observation(reading), self._infos({"t": reading.t})

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Apply the actions (n, 2) for one period; return arrays (n, ...) and ``info``.

        Raises BadCommand for another shape, NaN or infinity, before any car moves.
        """
        requested = np.asarray(actions, dtype=np.float64)
        if requested.shape != (self.num_envs, 2) or not np.isfinite(requested).all():
            raise BadCommand("an action of two numbers is needed for each car",
                             found=f"shape {requested.shape}, or NaN",
                             expected=f"({self.num_envs}, 2) of -1 to 1")
        command = np.clip(requested.T, -1.0, 1.0)
        change = ((command - self._command) ** 2).sum(axis=0)
        self._command = command
        state = self.cars.advance(command[0], command[1], self.config.frame)
        self._k = self._k + 1
        outcome, self._memory = self._task.judge(state, change, self._k, self._memory)
        reward = np.array(outcome.reward)
        terminated = np.array(outcome.terminated)
        truncated = self._k >= self.config.limit
        info = {name: np.array(v) for name, v in outcome.info.items()}
        # Cars whose episode ended in the last step are reset now.
        again = np.flatnonzero(self._done)
        if len(again):
            self._restart(again)
            reward[again] = 0.0
            terminated[again] = truncated[again] = False
        reading = self.cars.read()
        going = ~self._done
        self._done = terminated | truncated
        infos = self._infos({"t": reading.t})
        if going.any():
            infos.update(self._infos(info, going))
        return self._observation(reading), reward, terminated, truncated, infos

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return one top view with all cars if ``render_mode`` is "rgb_array"."""
        if self.render_mode is None:
            return None
        if self._picture is None:
            self._picture = TrackPicture(self.config)
        poses = np.array(self.cars.state[:3]).T.tolist()
        others = [v for other in self._task.others(self._memory.kept) for v in np.array(other).T]
        return (self._picture.draw(poses, self._nominal.body, others),)

    def _new_seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        """Return one seed per environment if the generators start again, else nothing."""
        if seed is None:
            return [] if self._rngs else [None] * self.num_envs
        seeds: list[int | None] = (
            [int(seed) + i for i in range(self.num_envs)] if isinstance(seed, int | np.integer)
            else list(seed))
        if len(seeds) != self.num_envs:
            raise UsageError("as many seeds as environments are needed",
                             found=f"{len(seeds)} seeds", expected=f"{self.num_envs}",
                             remedy="give one seed, or one for each environment")
        return seeds

    def _seed_generators(self, seeds: list[int | None]) -> None:
        self._rngs = [new_generator(seed) for seed in seeds]
        noise = [[noise_seed(rng)] for rng in self._rngs]
        self.cars.seed(noise)
        self._lidar.seed(noise)

    def _restart(self, cars: Array) -> None:
        drawn = [self._draws.draw(self._rngs[i]) for i in cars]
        if self._factors or self.cars.vehicle is not self._nominal:
            factors = np.array([f for _, f in drawn]).T
            for row, f in zip(self._factors.values(), factors, strict=True):
                row[cars] = f
            self._set_vehicles()
        # Start states and memories of the cars that are reset; the others keep theirs.
        start, memory = self._task.start(np.array([u for u, _ in drawn]).T)
        self.cars.reset(np.array(start), cars)
        self._memory = self._merge_memory(memory, cars)
        self._k[cars] = 0
        self._command[:, cars] = 0.0

    def _set_vehicles(self) -> None:
        nominal = self._nominal
        factors = self._factors
        self.cars.set_vehicle(bind(nominal, lambda name: (
            factors[name] * value(nominal, name) if name in factors else value(nominal, name))))

    def _merge_memory(self, new: Memory, cars: Array) -> Memory:
        if len(cars) == self.num_envs:
            return new
        s = np.array(self._memory.s)
        s[cars] = new.s
        kept = tuple(np.array(old) for old in self._memory.kept)
        for old, value_ in zip(kept, new.kept, strict=True):
            old[cars] = value_
        return Memory(s, kept)

    def _observation(self, reading: Reading) -> Array:
        values = np.array(self._task.observe(reading, tuple(self._command), self._memory))
        if self.config.beams:
            values = np.vstack((values, self._lidar.observe(self.cars.state, self._memory.kept)))
        out: Array = np.clip(values, -self._limits, self._limits).T.astype(np.float32)
        return np.ascontiguousarray(out)

    def _infos(self, values: dict[str, Array], where: Array | None = None) -> dict[str, Any]:
        """Return infos in the format of Gymnasium: an array and a mask each, 0 where masked."""
        mask = np.ones(self.num_envs, dtype=bool) if where is None else where
        out: dict[str, Any] = {}
        for name, v in values.items():
            out[name] = np.where(mask, v, 0.0)
            out[f"_{name}"] = mask.copy()
        return out
