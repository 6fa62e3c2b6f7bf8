"""C beside numpy: compiled once, kept in the user's cache, as ``dart_hal.vehicle.native``.

DART_HAL_NATIVE=0 switches it off. Whoever takes a function holds it against numpy before its first
use.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

from dart_hal.vehicle.native.build import CannotCompile, Variant, cache_folder, compile_kernel
from dart_hal.vehicle.native.library import switched_off

HERE = Path(__file__).parent


def function(name: str, source: str) -> Any | None:
    """A C function of a file beside this one, without a result; None where it cannot be had."""
    if switched_off():
        return None
    try:
        text = (HERE / source).read_text(encoding="utf-8")
        found = getattr(ctypes.CDLL(str(compile_kernel(text, Variant(64, False), cache_folder()))),
                        name)
    except (CannotCompile, OSError, AttributeError):
        return None
    found.restype = None
    return found
