"""Which engine runs the vehicles here, and why: for ``dart-hal doctor`` and for bug reports."""

from __future__ import annotations

import numpy as np

from dart_hal.vehicle.native import build
from dart_hal.vehicle.native.build import CannotCompile
from dart_hal.vehicle.native.kernel import CompiledStep
from dart_hal.vehicle.sets import PAPER


def status() -> str:
    """One sentence: "compiled kernels, built with the package", or numpy and the reason."""
    try:
        kernel = CompiledStep(PAPER, "motion", 0.01, np.float64)
    except CannotCompile as why:
        return f"numpy; no compiled kernels: {why}"
    command = build.compiler()
    others = (f"others with {command[0]} on demand into {build.cache_folder()}" if command
              else "no C compiler for others: they run in numpy")
    return f"compiled kernels, {kernel.origin}; {others}"
