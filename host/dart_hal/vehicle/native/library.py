"""Find the library of a traced step: built with the package, kept from before, or made now."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable
from functools import lru_cache

from dart_hal.vehicle.native import build
from dart_hal.vehicle.native.emit import body, source
from dart_hal.vehicle.native.model import Traced

# Environment variable: 0 = numpy always.
NATIVE_SWITCH = "DART_HAL_NATIVE"


class Job(ctypes.Structure):
    """What one call of a kernel is given: ``job`` of the C text, in its order.

    Addresses keep nothing alive: ``keeps`` holds what they point to.
    """

    keeps: object = None

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("n", "samples", "substeps", "reads", "ldh", "lane",
                                              "row")),
        *((name, ctypes.c_void_p) for name in ("at", "h", "u0", "u1", "start", "out")),
    )


# ``run(byref(job))``.
Run = Callable[[object], None]


def is_switched_off() -> bool:
    """Return whether the user has switched kernels off."""
    return os.environ.get(NATIVE_SWITCH, "").strip() == "0"


def load(traced: Traced, variant: build.Variant) -> tuple[Run, str]:
    """The kernel's function and where it is from. Raises build.CannotCompile when there is none."""
    text = body(traced)
    committed = _read_committed()
    if text in committed:
        path = build.BUILT / f"{build.key(committed, variant)}.so"
        if path.is_file():
            try:
                return _load_function(path, traced.name), "built with the package"
            except build.CannotCompile:
                pass  # damaged: one compiled on demand does as well
    try:
        return _load_compiled(text, traced.name, variant), "compiled on demand"
    except build.CannotCompile:
        portable = build.BUILT / f"{build.key(committed, variant, portable=True)}.so"
        if text not in committed or not portable.is_file():
            raise
        return _load_function(portable, traced.name), "built for any processor"


def _load_compiled(text: str, name: str, variant: build.Variant) -> Run:
    """Compile the kernel for this processor, unless that was done before, and load it."""
    whole = source([text])
    folder = build.cache_folder()
    path = build.compile_kernel(whole, variant, folder)
    try:
        return _load_function(path, name)
    except build.CannotCompile:
        # damaged since it was kept: once more, else it would never be used again
        path.unlink(missing_ok=True)
        return _load_function(build.compile_kernel(whole, variant, folder), name)


@lru_cache(maxsize=1)
def _read_committed() -> str:
    return build.COMMITTED.read_text(encoding="utf-8") if build.COMMITTED.is_file() else ""


def _load_function(path: object, name: str) -> Run:
    try:
        function = getattr(ctypes.CDLL(str(path)), f"run_{name}")
    except (OSError, AttributeError) as why:
        raise build.CannotCompile(f"{path} does not load: {why}") from why
    function.restype = None
    function.argtypes = (ctypes.c_void_p,)
    return function  # type: ignore[no-any-return]
