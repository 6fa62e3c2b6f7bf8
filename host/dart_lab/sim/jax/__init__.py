"""The light simulation on JAX: pure functions for ``jit``, ``vmap`` and ``grad``.

The equations, actuators, sensors and tasks are those of ``dart_hal.vehicle`` and of the light
simulation with its environment; this package gives them arrays of JAX and a state that is passed
on. It needs JAX and gymnasium (the extra ``jax``); no other package imports it.
"""

from __future__ import annotations

from dart_hal.core.errors import UsageError
from dart_hal.core.process.extras import install_command

try:
    import jax  # noqa: F401 - the error names what is missing
except ImportError as err:
    raise UsageError("the simulation on JAX needs jax", remedy=install_command("jax")) from err

from dart_lab.sim.jax.env import DartCar, EnvState, EnvStep
from dart_lab.sim.jax.light import Light, LightState
from dart_lab.sim.jax.ops import JAX_OPS
from dart_lab.sim.jax.rollout import rollout

__all__ = ["JAX_OPS", "DartCar", "EnvState", "EnvStep", "Light", "LightState", "rollout"]
