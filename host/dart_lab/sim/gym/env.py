"""One car as ``gymnasium.Env``."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from dart_hal.core.errors import BadCommand
from dart_hal.vehicle.flat import value, with_values
from dart_lab.sim.gym.config import GymConfig
from dart_lab.sim.gym.lidar import LidarObservation
from dart_lab.sim.gym.render import TrackPicture
from dart_lab.sim.gym.resets import (
    ResetDraws,
    action_box,
    factors_by_name,
    make_config,
    noise_seed,
    observation_box,
)
from dart_lab.sim.gym.tasks import Memory, make_task
from dart_lab.sim.light.car import LightCar, vehicle_named
from dart_lab.sim.light.ops import SCALAR_OPS
from dart_lab.sim.light.sense import Reading

Observation = NDArray[np.float32]


class DartCarEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """One car. Action: (throttle, steering) in -1..1, +1 steering = full left, constant per step.

    Observation: float32, named by ``names`` and described in docs/how_to/learning.md. Keywords are
    the fields of ``GymConfig``. ``reset(options={"randomise": True})`` draws another car at this
    and every later reset. ``car.state`` is the truth. Raises UsageError and ConfigError for invalid
    configurations.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012

    def __init__(self, config: GymConfig | None = None, render_mode: str | None = None,
                 **changes: Any) -> None:
        self.config = c = make_config(config, changes)
        self.render_mode = render_mode
        self._nominal = vehicle_named(c.vehicle)
        self.car = LightCar(self._nominal, c.light)
        self._task = make_task(c, SCALAR_OPS, self._nominal.body.l_r)
        self._draws = ResetDraws(c.randomise, self._nominal, self._task.draws)
        self._lidar = LidarObservation(c, self._task, scalar=True)
        self._frame = c.frame
        self._limit = c.limit
        self.names = tuple(name for name, _ in self._task.limits)
        self.action_space = action_box()
        self.observation_space = observation_box(self._task)
        self._limits: list[float] = [limit for _, limit in self._task.limits]
        self._memory = Memory(0.0, ())
        self._command = [0.0, 0.0]
        self._k = -1
        self._picture: TrackPicture | None = None

    def reset(self, *, seed: int | None = None,
              options: dict[str, Any] | None = None) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; see the class for ``options``."""
        super().reset(seed=seed)
        self._draws.set(options)
        if seed is not None or self._k < 0:
            noise = [noise_seed(self.np_random)]
            self.car.seed(noise)
            self._lidar.seed([noise])
        else:
            # A reset in the vector environment takes a step, so the same noise is used up here.
            self.car.skip(self._frame)
        # Parameters: those of the nominal car times the drawn factors.
        u, factors = self._draws.draw(self.np_random)
        if len(factors) or self.car.vehicle is not self._nominal:
            drawn = factors_by_name(self._draws.spread, factors.tolist())
            self.car.set_vehicle(with_values(self._nominal, {
                name: factor * value(self._nominal, name)
                for name, factor in drawn.items()}))
        state, self._memory = self._task.start(u.tolist())
        self.car.reset(*state)
        self._k = 0
        self._command = [0.0, 0.0]
        reading = self.car.read()
        return self._observation(reading), self._info(reading)

    def step(self, action: NDArray[np.float32]) -> tuple[
            Observation, float, bool, bool, dict[str, Any]]:
        """Apply the action (2,) for one period.

        Raises BadCommand for another shape, NaN or infinity.
        """
        requested = np.asarray(action, dtype=np.float64)
        if requested.shape != (2,) or not np.isfinite(requested).all():
            raise BadCommand("an action is not two numbers", found=str(action),
                             expected="throttle and steering, -1 to 1")
        throttle, steering = (min(1.0, max(-1.0, a)) for a in requested.tolist())
        last = self._command
        # The reward penalises the change of the clipped commands.
        change = (throttle - last[0]) ** 2 + (steering - last[1]) ** 2
        self._command = [throttle, steering]
        state = self.car.advance(throttle, steering, self._frame)
        self._k += 1
        outcome, self._memory = self._task.judge(state, change, self._k, self._memory)
        reading = self.car.read()
        return (self._observation(reading), float(outcome.reward), bool(outcome.terminated),
                self._k >= self._limit, {**outcome.info, **self._info(reading)})

    def render(self) -> NDArray[np.uint8] | None:
        """Return a top view (height, width, 3) if ``render_mode`` is "rgb_array"."""
        if self.render_mode is None:
            return None
        if self._picture is None:
            self._picture = TrackPicture(self.config)
        return self._picture.draw([self.car.state[:3]], self._nominal.body,
                                  self._task.others(self._memory.kept))

    def _observation(self, reading: Reading) -> Observation:
        values = self._task.observe(reading, self._command, self._memory)
        values += self._lidar.observe(self.car.state, self._memory.kept).ravel().tolist()
        pairs = zip(values, self._limits, strict=True)
        return np.array([min(limit, max(-limit, v)) for v, limit in pairs], dtype=np.float32)

    def _info(self, reading: Reading) -> dict[str, Any]:
        return {"t": float(reading.t)}
