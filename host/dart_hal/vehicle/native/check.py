"""Compare a kernel with the Python equations before its first use.

A wrong compiler flag, a library of another equation or a processor that rounds differently can
make a kernel differ. It is then not used, and the reason is reported. The check takes about a
millisecond.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from dart_hal.vehicle.effect import ActiveEffect
from dart_hal.vehicle.flat import bind, value
from dart_hal.vehicle.namespace import ARRAY, SCALAR, Namespace
from dart_hal.vehicle.native.build import CannotCompile, Variant
from dart_hal.vehicle.native.call import align_coefficients, call
from dart_hal.vehicle.native.library import Run
from dart_hal.vehicle.native.model import STATE_NAMES, STEP_FACTORIES, Traced, coefficients
from dart_hal.vehicle.parameters import AxleTyres, SpeedLoop, Vehicle
from dart_hal.vehicle.sets import PAPER, UPSTREAM_2024

CHECK_STEP_S = 0.01
CHECK_SAMPLES = 3
CHECK_SUBSTEPS = 2
# More cars than a vector holds, and not a multiple of it.
CHECKED_CARS = 19
# Largest difference by number of bits, relative to the value or to 1, whichever is larger.
TOLERANCE = {64: 1e-12, 32: 1e-4}
EXACT_TOLERANCE = 0.0
# Weak enough that the commands of VALUE_RANGES reach its limit in some cars and not in others.
REFERENCE_LOOP = SpeedLoop(gain=3.0, max_force=4.0)
VALUE_RANGES = {"x": 2.0, "y": 2.0, "eta": 3.0, "vx": 2.0, "vy": 0.3, "om": 3.0, "tau": 0.5,
                "s": 1.0, "delta": 0.4, "tau_command": 0.5, "s_command": 1.0, "k0": 5.0, "k1": 2.0,
                "brake": 8.0, "cos_d": 1.0, "sin_d": 0.4}


def check(run: Run, traced: Traced, variant: Variant, form: Vehicle, kind: str,
          method: str) -> None:
    """Raises CannotCompile when the kernel and the equations disagree."""
    draw = np.random.default_rng(1)
    tolerance = EXACT_TOLERANCE if variant.exact else TOLERANCE[variant.bits]
    for n in (1, CHECKED_CARS):
        lanes = n if variant.lanes else 0
        p = make_reference_vehicle(form, lanes, draw)
        start = np.stack([draw.uniform(-1, 1, n) * VALUE_RANGES[q] for q in STATE_NAMES[kind]])
        if form.slip == "paper":    # as published it divides by v_x
            start[3] = 0.5 + np.abs(start[3])
        inputs = [draw.uniform(-1, 1, (CHECK_SAMPLES, n)) * VALUE_RANGES[q] for q in traced.inputs]
        dtype = np.float64 if variant.bits == 64 else np.float32
        h = align_coefficients(coefficients(traced, p, CHECK_STEP_S, lanes), dtype)
        got = call(run, h, start, inputs[0], inputs[1], [0, CHECK_SAMPLES], CHECK_SUBSTEPS)
        # An exact kernel calls the functions of math, one car at a time; numpy has its own.
        expected = (np.column_stack([
            integrate_reference(p, kind, method, start[:, i], [u[:, i] for u in inputs], SCALAR)
            for i in range(n)]) if variant.exact
            else integrate_reference(p, kind, method, start, inputs, ARRAY))
        error = disagreement(got[1], expected)
        if not error <= tolerance or not np.array_equal(got[0], start.astype(dtype)):
            raise CannotCompile(f"the kernel {traced.name} (f{variant.bits}) differs from the "
                                f"Python equations by {error:.1e}")


def integrate_reference(p: Vehicle, kind: str, method: str, start: Any, inputs: Any,
                        xp: Namespace = ARRAY) -> Any:
    """Integrate the equations in Python."""
    step = STEP_FACTORIES[kind](p, xp, dt=CHECK_STEP_S, method=method)
    state = tuple(start)
    for first, second in zip(*inputs, strict=True):
        for _ in range(CHECK_SUBSTEPS):
            state = step(*state, first, second)
    return np.array([np.broadcast_to(q, start.shape[1:]) for q in state])


def disagreement(got: Any, reference: Any) -> float:
    """Largest difference, as a share of each value or of 1."""
    return float(np.max(np.abs(got - reference) / np.maximum(1.0, np.abs(reference))))


def make_reference_vehicle(form: Vehicle, lanes: int, draw: np.random.Generator) -> Vehicle:
    """A vehicle of that form with the numbers of a shipped set; in lanes a little varied."""
    tyres = UPSTREAM_2024.tyres if isinstance(form.tyres, AxleTyres) else PAPER.tyres
    motor = REFERENCE_LOOP if isinstance(form.motor, SpeedLoop) else UPSTREAM_2024.motor
    effects = tuple(ActiveEffect(a.effect, tuple(q.null + q.sizes[0] for q in a.effect.parameters))
                    for a in form.effects)
    # None of its parameters is 0, which would hide a term.
    known = replace(UPSTREAM_2024, motor=motor, tyres=tyres, effects=effects)

    def varied_value(name: str) -> Any:
        if name == "tyres.rear_max":
            return 4.0 * (1.0 + np.arange(lanes) / 8) if lanes else 4.0
        number = value(known, name)
        return number * draw.uniform(0.98, 1.02, lanes) if lanes else number

    return bind(form, varied_value)
