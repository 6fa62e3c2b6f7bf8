"""Random draws of a reset, for one environment or a vector environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding

from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray
from dart_hal.vehicle import Vehicle
from dart_lab.sim.gym.config import GymConfig, check_spread
from dart_lab.sim.gym.tasks import Task


def make_config(config: GymConfig | None, changes: Mapping[str, Any]) -> GymConfig:
    """Return a configuration with fields changed by keyword. Raises UsageError for unknown ones."""
    try:
        return replace(config or GymConfig(), **changes)
    except TypeError as err:
        raise UsageError(f"DartCar-v0 has no such option: {', '.join(changes)}",
                         expected=", ".join(GymConfig.__slots__),
                         remedy="docs/how_to/learning.md has every keyword") from err


def observation_box(task: Task) -> Any:
    """Return the observation space of a task."""
    limits = np.array([limit for _, limit in task.limits], dtype=np.float32)
    return spaces.Box(-limits, limits, dtype=np.float32)


def action_box() -> Any:
    """Return the action space: (throttle, steering), -1..1 each."""
    return spaces.Box(-1.0, 1.0, (2,), np.float32)


def noise_seed(rng: np.random.Generator) -> int:
    """Draw the seed of a car's noise from the generator of its environment."""
    return int(rng.integers(2**62))


def new_generator(seed: int | None) -> np.random.Generator:
    """Return the generator that gymnasium gives an environment for a seed."""
    return seeding.np_random(seed)[0]


class ResetDraws:
    """Draws of the resets; their options remain valid until others are given."""

    def __init__(self, randomise: bool | Mapping[str, float], p: Vehicle, draws: int) -> None:
        self._p = p
        self._draws = draws
        self.spread = check_spread(randomise, p)

    def set(self, options: Mapping[str, Any] | None) -> None:
        """Take over the options of a reset. Raises UsageError for an unknown one."""
        unknown = [k for k in options or {} if k != "randomise"]
        if unknown:
            raise UsageError(f"a reset has no option {unknown[0]!r}", expected="randomise",
                             remedy="docs/how_to/learning.md, DartCar-v0: randomise")
        if options and "randomise" in options:
            self.spread = check_spread(options["randomise"], self._p)

    def draw(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Draw (uniform numbers for the task, factors of the parameters)."""
        # First the draws of the task, then those of the parameters, in the order of the spread.
        u = rng.random(self._draws)
        half = np.array(list(self.spread.values()))
        return u, 1.0 + half * rng.uniform(-1.0, 1.0, len(half))


def factors_by_name(spread: Mapping[str, float], factors: Sequence[Any]) -> dict[str, Any]:
    """Return the factors of the nominal values by the names of the parameters."""
    return dict(zip(spread, factors, strict=True))
