"""Prepared kernels: a vehicle's step, compiled, on arrays of cars or on one car."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from dart_hal.core.timing import SAMPLE
from dart_hal.vehicle.compose import keep_motion_effects
from dart_hal.vehicle.flat import shapes
from dart_hal.vehicle.native.build import CannotCompile, Variant
from dart_hal.vehicle.native.call import Array, align_coefficients, call
from dart_hal.vehicle.native.check import check
from dart_hal.vehicle.native.library import NATIVE_SWITCH, Job, Run, is_switched_off, load
from dart_hal.vehicle.native.model import STATE_NAMES, coefficients, form_of, trace
from dart_hal.vehicle.parameters import Vehicle


class CompiledStep:
    """The step of one vehicle, or of a stack of them, ready to run.

    kind: "car" (8 states; throttle and steering command), "motion" (6 states;
    throttle and road-wheel angle behind the actuators) or "tick" (9 states; see
    ``make_tick_step``; equal to the Python step to the last bit); dt [s] of a step.
    Raises CannotCompile where numpy has to do it.
    """

    def __init__(self, p: Vehicle, kind: str, dt: float, dtype: DTypeLike = np.float64,
                 method: str = "rk4") -> None:
        number = np.dtype(dtype)
        if number not in (np.float32, np.float64):
            raise CannotCompile(f"no kernel for numbers of type {number}")
        p = keep_motion_effects(p)
        form = form_of(p)
        lanes = count_vehicles(p)
        self._lanes = lanes
        if is_switched_off():
            raise CannotCompile(f"switched off by {NATIVE_SWITCH}=0")
        run, self.origin = find_kernel(form, kind, method, number.itemsize * 8, lanes > 0)
        if run is None:
            raise CannotCompile(self.origin)
        self.run = run
        self.h = align_coefficients(coefficients(trace(form, kind, method), p, dt, lanes), number)

    def __call__(self, start: Array, first: Array, second: Array,
                 output_samples: Sequence[int], substeps: int = 1,
                 out: Array | None = None) -> Array:
        """States (m, states, n) after ``output_samples`` (m,); see ``call.call``.

        The caller has checked the other shapes.

        Raises ValueError when a stack has not as many vehicles as start has cars.
        """
        if self._lanes not in (0, start.shape[1]):
            raise ValueError(f"{self._lanes} vehicles for {start.shape[1]} cars")
        return call(self.run, self.h, start, first, second, output_samples, substeps, out)


def make_native_step(p: Vehicle, kind: str = "car", dt: float = SAMPLE,
                     method: str = "rk4") -> Callable[..., tuple[float, ...]]:
    """``step(*state, first, second) -> state`` of one car in f64, as that of ``vehicle.step``.

    Takes and returns floats. Not for two threads at once. Raises CannotCompile
    where the Python step has to do it.
    """
    kernel = CompiledStep(p, kind, dt, np.float64, method)
    n = len(STATE_NAMES[kind])
    memory = (ctypes.c_double * (n + 2))()
    at = ctypes.c_int64(1)
    state = ctypes.addressof(memory)
    first = state + n * ctypes.sizeof(ctypes.c_double)
    second = first + ctypes.sizeof(ctypes.c_double)
    job = Job(n=1, samples=1, substeps=1, reads=1, ldh=1, lane=0, row=1, at=ctypes.addressof(at),
              h=kernel.h.ctypes.data, u0=first, u1=second, start=state, out=state)
    job.keeps = (kernel, at)
    run = kernel.run
    pointer = ctypes.byref(job)

    def step(*values: float) -> tuple[float, ...]:
        memory[:] = values  # type: ignore[call-overload]  # any sequence will do
        run(pointer)
        return tuple(memory[:n])

    return step


class KernelLookup(NamedTuple):
    """A kernel's function and its origin; or None, and why."""

    run: Run | None
    origin: str


@lru_cache(maxsize=128)
def find_kernel(form: Vehicle, kind: str, method: str, bits: int, lanes: bool) -> KernelLookup:
    """The kernel of a form, once it gave what the Python equations give; cached."""
    traced = trace(form, kind, method)
    variant = Variant(bits, lanes, exact=kind == "tick")
    try:
        run, origin = load(traced, variant)
        check(run, traced, variant, form, kind, method)
    except CannotCompile as why:
        return KernelLookup(None, str(why))
    return KernelLookup(run, origin)


def count_vehicles(p: Vehicle) -> int:
    """Number of vehicles in a stack, 0 for a single one. Raises CannotCompile for other arrays."""
    found = shapes(p)
    if len(found) > 1 or any(len(shape) != 1 for shape in found):
        raise CannotCompile(f"parameters of shapes {sorted(found)} are no stack of vehicles")
    return int(found.pop()[0]) if found else 0
