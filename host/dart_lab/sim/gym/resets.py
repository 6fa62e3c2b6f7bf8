"""What a reset draws from a car's generator, alone or in a vector environment."""

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
from dart_lab.sim.gym.config import GymConfig, spread_of
from dart_lab.sim.gym.tasks import Task


def config_of(config: GymConfig | None, changes: Mapping[str, Any]) -> GymConfig:
    """A configuration with some fields given by keyword. Raises UsageError for an unknown one."""
    try:
        return replace(config or GymConfig(), **changes)
    except TypeError as err:
        raise UsageError(f"DartCar-v0 has no such option: {', '.join(changes)}",
                         expected=", ".join(GymConfig.__slots__),
                         remedy="docs/how_to/learning.md has every keyword") from err


def box_of(task: Task) -> Any:
    """Observation space of a task."""
    most = np.array([limit for _, limit in task.limits], dtype=np.float32)
    return spaces.Box(-most, most, dtype=np.float32)


def action_box() -> Any:
    """(throttle, steering), -1..1 each."""
    return spaces.Box(-1.0, 1.0, (2,), np.float32)


def noise_seed(rng: np.random.Generator) -> int:
    """Seed of a car's noise, from the generator of its environment."""
    return int(rng.integers(2**62))


def new_generator(seed: int | None) -> np.random.Generator:
    """The generator that gymnasium gives an environment for a seed."""
    return seeding.np_random(seed)[0]


class Draws:
    """Options of the resets, kept until others are given; ``draw`` uses them."""

    def __init__(self, randomise: bool | Mapping[str, float], p: Vehicle, draws: int) -> None:
        self._p, self._draws = p, draws
        self.spread = spread_of(randomise, p)

    def set(self, options: Mapping[str, Any] | None) -> None:
        """Take over the options of a reset. Raises UsageError for an unknown one."""
        unknown = [k for k in options or {} if k != "randomise"]
        if unknown:
            raise UsageError(f"a reset has no option {unknown[0]!r}", expected="randomise",
                             remedy="docs/how_to/learning.md, DartCar-v0: randomise")
        if options and "randomise" in options:
            self.spread = spread_of(options["randomise"], self._p)

    def draw(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """(uniform numbers for the task, factors of the drawn parameters)."""
        u = rng.random(self._draws)
        half = np.array(list(self.spread.values()))
        return u, 1.0 + half * rng.uniform(-1.0, 1.0, len(half))


def factors_by_name(spread: Mapping[str, float], factors: Sequence[Any]) -> dict[str, Any]:
    """Name -> factor of the nominal value."""
    return dict(zip(spread, factors, strict=True))
