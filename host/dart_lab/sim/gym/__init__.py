"""DartCar-v0: the light simulation as a Gymnasium environment.

Importing this package registers it; ``gymnasium.make("dart_lab.sim.gym:DartCar-v0")`` imports it.
It needs gymnasium (the extra ``gym``); no other package imports it.
"""

from __future__ import annotations

from dart_hal.core.errors import UsageError
from dart_hal.core.process.extras import install_command

try:
    from gymnasium.envs.registration import register, registry
except ImportError as err:
    raise UsageError("the learning environment needs gymnasium",
                     remedy=install_command("gym")) from err

from dart_hal.control.tracks import TRACKS
from dart_lab.sim.gym.config import SPREAD, GymConfig
from dart_lab.sim.gym.env import DartCarEnv
from dart_lab.sim.gym.vector import DartCarVectorEnv

__all__ = ["ENV_ID", "SPREAD", "TRACKS", "DartCarEnv", "DartCarVectorEnv", "GymConfig"]

ENV_ID = "DartCar-v0"

if ENV_ID not in registry:
    register(ENV_ID, entry_point="dart_lab.sim.gym.env:DartCarEnv",
             vector_entry_point="dart_lab.sim.gym.vector:DartCarVectorEnv")
