"""C functions of this package: compiled once, cached per user, as in ``dart_hal.vehicle.native``.

DART_HAL_NATIVE=0 disables them. Each caller compares a function with NumPy before its first use.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

from dart_hal.vehicle.native.build import CannotCompile, Variant, cache_folder, compile_kernel
from dart_hal.vehicle.native.library import is_switched_off

HERE = Path(__file__).parent


def load_function(name: str, source: str) -> Any | None:
    """Load a C function without result from a file of this package; None if not available."""
    if is_switched_off():
        return None
    try:
        text = (HERE / source).read_text(encoding="utf-8")
        found = getattr(ctypes.CDLL(str(compile_kernel(text, Variant(64, False), cache_folder()))),
                        name)
    except (CannotCompile, OSError, AttributeError):
        return None
    found.restype = None
    return found
