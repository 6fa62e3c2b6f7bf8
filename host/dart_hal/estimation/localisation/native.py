"""C functions of this package: compiled once, cached per user, as in ``dart_hal.vehicle.native``.

DART_HAL_NATIVE=0 disables them. Each caller compares a function with NumPy before its first use.
"""

from __future__ import annotations

import ctypes
import logging
from pathlib import Path
from typing import Any

from dart_hal.vehicle.native.build import CannotCompile, Variant, cache_folder, compile_kernel
from dart_hal.vehicle.native.library import is_switched_off

HERE = Path(__file__).parent
logger = logging.getLogger(__name__)


def load_function(name: str, source: str) -> Any | None:
    """Load a C function without result from a file of this package; None if not available.

    The reason is logged: without it NumPy is used, and a scan costs several times as much.
    """
    if is_switched_off():
        return None
    try:
        text = (HERE / source).read_text(encoding="utf-8")
        found = getattr(ctypes.CDLL(str(compile_kernel(text, Variant(64, False), cache_folder()))),
                        name)
    except (CannotCompile, OSError, AttributeError) as why:
        logger.info("%s: numpy takes over: %s", source, why)
        return None
    found.restype = None
    return found
