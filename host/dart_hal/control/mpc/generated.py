"""Stages and their slopes in C: casadi differentiates the equations, a compiler translates them.

The slopes are exact instead of differences. Needs the extra ``mpc``. The iterations of ``admm``
exist in C too. A library is stored in the user's cache (``vehicle.native``), so each car is
compiled once.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.control.mpc.admm import RELAXATION, Splitting, Sweep
from dart_hal.control.mpc.model import N_INPUTS, N_STATES, Linearisation, Lineariser, make_stage
from dart_hal.core.errors import UsageError
from dart_hal.core.process.extras import install_command
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.native.build import CannotCompile, Variant, cache_folder, compile_kernel
from dart_hal.vehicle.parameters import Vehicle

# C source of the iterations, and the largest number of rows and inputs that it supports.
ADMM_SOURCE = Path(__file__).parent / "admm.c"
MAX_ROWS = 512
STAGES_FUNCTION = "stages"
STAGES_SOURCE = f"""
void {STAGES_FUNCTION}(long long n, const double *z, const double *u, double *after, double *a,
                       double *b)
{{
    for (; n > 0; n--) {{
        const double *given[] = {{z, u}};
        double *results[] = {{after, a, b}};
        one(given, results, 0, 0, 0);
        z += {N_STATES}, u += {N_INPUTS}, after += {N_STATES};
        a += {N_STATES * N_STATES}, b += {N_STATES * N_INPUTS};
    }}
}}
"""


def compile_lineariser(vehicle: Vehicle) -> Lineariser:
    """Return ``model.linearise`` for a car, in C.

    Raises UsageError if casadi or a compiler is missing or fails.
    """
    run = _load_function(_generate_source(vehicle), STAGES_FUNCTION)
    run.argtypes = ctypes.c_longlong, *(ctypes.c_void_p,) * 5

    def linearise(states: FloatArray, inputs: FloatArray) -> Linearisation:
        n = len(states)
        z = np.ascontiguousarray(states)
        u = np.ascontiguousarray(inputs)
        next_states = np.empty((n, N_STATES))
        a = np.empty((n, N_STATES, N_STATES))
        b = np.empty(
            (n, N_INPUTS, N_STATES))
        run(n, *(each.ctypes.data for each in (z, u, next_states, a, b)))
        return next_states, a.transpose(0, 2, 1), b.transpose(0, 2, 1)  # casadi stores columns

    return linearise


def compile_sweep() -> Sweep:
    """Return ``admm.run_sweep`` in C. Raises UsageError without a compiler."""
    run = _load_function(ADMM_SOURCE.read_text(encoding="utf-8"), "run_sweep")
    run.argtypes = *(ctypes.c_int64,) * 3, ctypes.c_double, *(ctypes.c_void_p,) * 8

    def run_sweep(iterations: int, splitting: Splitting, z: FloatArray, y: FloatArray) -> None:
        m, n = splitting.c.shape
        assert max(m, n) <= MAX_ROWS
        parts = [np.ascontiguousarray(part) for part in splitting]
        run(iterations, n, m, RELAXATION, *(part.ctypes.data for part in (*parts, z, y)))

    return run_sweep


def _load_function(source: str, name: str) -> Any:
    """Load a function without a result, compiled unless it is in the cache. Raises UsageError."""
    try:
        path = compile_kernel(source, Variant(64, False), cache_folder())
        function = getattr(ctypes.CDLL(str(path)), name)
    except (CannotCompile, OSError) as error:
        raise UsageError("contouring control in C needs a compiler", found=str(error),
                         expected="gcc, clang or $CC", remedy="sudo apt install gcc") from error
    function.restype = None
    return function


def _generate_source(vehicle: Vehicle) -> str:
    """Generate C of a stage, its slopes to states and inputs, and a loop over stages."""
    try:
        import casadi as ca
    except ImportError as error:
        raise UsageError("contouring control in C needs casadi", found=str(error),
                         expected="the extra mpc", remedy=install_command("mpc")) from error
    z = ca.SX.sym("z", N_STATES)
    u = ca.SX.sym("u", N_INPUTS)
    next_state = ca.vertcat(*make_stage(vehicle, ca)(*ca.vertsplit(z), *ca.vertsplit(u)))
    slopes = (ca.densify(ca.jacobian(next_state, variables)) for variables in (z, u))
    code = ca.CodeGenerator(STAGES_FUNCTION, {"with_header": False})
    code.add(ca.Function("one", [z, u], [next_state, *slopes]))
    return str(code.dump()) + STAGES_SOURCE
