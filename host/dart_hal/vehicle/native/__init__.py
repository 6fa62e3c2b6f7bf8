"""Compiled kernels of the vehicle equations, generated from them; numpy is the fallback.

``trace`` runs the equations on symbols, ``model`` splits what it sees, ``emit``
writes it as C, ``build`` compiles, ``library`` finds what is compiled already,
``check`` holds it against the Python equations, ``kernel`` runs it.
"""

from __future__ import annotations

from dart_hal.vehicle.native.build import CannotCompile
from dart_hal.vehicle.native.kernel import CompiledStep, make_native_step
from dart_hal.vehicle.native.status import status

__all__ = ["CannotCompile", "CompiledStep", "make_native_step", "status"]
