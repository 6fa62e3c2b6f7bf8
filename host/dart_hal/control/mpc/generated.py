"""The stages and their slopes as C: casadi differentiates the car's equations, a compiler does the
rest. Exact slopes instead of differences. Extra ``mpc``. The splitting of ``admm`` in C besides.

A library is kept in the user's cache (``vehicle.native``), so that a car is compiled once.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.control.mpc.admm import RELAXATION, Splitting, Sweep
from dart_hal.control.mpc.model import INPUTS, STATES, Linearise, Linearised, make_stage
from dart_hal.core.errors import UsageError
from dart_hal.core.process.extras import install_command
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.native.build import CannotCompile, Variant, cache_folder, compile_kernel
from dart_hal.vehicle.parameters import Vehicle

# Its source, and the most rows and inputs that it takes.
SPLITTING = Path(__file__).parent / "admm.c"
LARGEST = 512
NAME = "stages"
OVER_STAGES = f"""
void {NAME}(long long n, const double *z, const double *u, double *after, double *a, double *b)
{{
    for (; n > 0; n--) {{
        const double *given[] = {{z, u}};
        double *told[] = {{after, a, b}};
        one(given, told, 0, 0, 0);
        z += {STATES}, u += {INPUTS}, after += {STATES};
        a += {STATES * STATES}, b += {STATES * INPUTS};
    }}
}}
"""


def compiled(vehicle: Vehicle) -> Linearise:
    """As ``model.linearised`` of a car, in C.

    Raises UsageError where casadi or a compiler is missing, or fails.
    """
    run = _function(_source(vehicle), NAME)
    run.argtypes = ctypes.c_longlong, *(ctypes.c_void_p,) * 5

    def linearised(states: FloatArray, inputs: FloatArray) -> Linearised:
        n = len(states)
        z = np.ascontiguousarray(states)
        u = np.ascontiguousarray(inputs)
        after = np.empty((n, STATES))
        a = np.empty((n, STATES, STATES))
        b = np.empty(
            (n, INPUTS, STATES))
        run(n, *(each.ctypes.data for each in (z, u, after, a, b)))
        return after, a.transpose(0, 2, 1), b.transpose(0, 2, 1)  # casadi goes by columns

    return linearised


def sweep() -> Sweep:
    """As ``admm.swept``, in C. Raises UsageError where there is no compiler."""
    run = _function(SPLITTING.read_text(encoding="utf-8"), "swept")
    run.argtypes = *(ctypes.c_int64,) * 3, ctypes.c_double, *(ctypes.c_void_p,) * 8

    def swept(times: int, of: Splitting, z: FloatArray, y: FloatArray) -> None:
        m, n = of.c.shape
        assert max(m, n) <= LARGEST
        parts = [np.ascontiguousarray(part) for part in of]
        run(times, n, m, RELAXATION, *(part.ctypes.data for part in (*parts, z, y)))

    return swept


def _function(source: str, name: str) -> Any:
    """A function without a result, compiled unless it was. Raises UsageError."""
    try:
        path = compile_kernel(source, Variant(64, False), cache_folder())
        found = getattr(ctypes.CDLL(str(path)), name)
    except (CannotCompile, OSError) as why:
        raise UsageError("contouring control in C needs a compiler", found=str(why),
                         expected="gcc, clang or $CC", remedy="sudo apt install gcc") from why
    found.restype = None
    return found


def _source(vehicle: Vehicle) -> str:
    """C of a stage and its slopes to states and inputs, and a loop over stages."""
    try:
        import casadi as ca
    except ImportError as why:
        raise UsageError("contouring control in C needs casadi", found=str(why),
                         expected="the extra mpc", remedy=install_command("mpc")) from why
    z = ca.SX.sym("z", STATES)
    u = ca.SX.sym("u", INPUTS)
    after = ca.vertcat(*make_stage(vehicle, ca)(*ca.vertsplit(z), *ca.vertsplit(u)))
    slopes = (ca.densify(ca.jacobian(after, of)) for of in (z, u))
    code = ca.CodeGenerator(NAME, {"with_header": False})
    code.add(ca.Function("one", [z, u], [after, *slopes]))
    return str(code.dump()) + OVER_STAGES
