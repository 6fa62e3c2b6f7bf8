"""Many cars at once, and open-loop rollouts of many windows.

Arrays have one column per car. The equations are those of ``step``, in numpy or in a kernel that is
compiled from them: ``engine`` "numpy", "native", or "auto" for native if there is a kernel. The
two agree to 1e-12 in f64, not to the last bit. Inputs that are not finite always use numpy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from dart_hal.compat import accept_old_keyword
from dart_hal.core.errors import UsageError
from dart_hal.core.timing import SAMPLE
from dart_hal.vehicle.flat import shapes
from dart_hal.vehicle.namespace import ARRAY, SCALAR
from dart_hal.vehicle.native.build import CannotCompile
from dart_hal.vehicle.native.kernel import CompiledStep, make_native_step
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.step import make_car_step, make_motion_step

Array = NDArray[Any]
Step = Callable[..., tuple[Any, ...]]
ROLLOUT_SUBSTEPS = 4  # RK4 steps per input sample of an open-loop rollout
ENGINES = ("auto", "numpy", "native")


@accept_old_keyword("at", "output_samples")
def rollout(p: Vehicle, start: Array, throttle: Array, angle: Array, *,
            output_samples: Sequence[int] | None = None, sample: float = SAMPLE,
            substeps: int = ROLLOUT_SUBSTEPS, method: str = "rk4", engine: str = "auto") -> Array:
    """Compute states (m, 6, n) of n cars after ``output_samples`` (m,), inputs held between.

    start (6, n): x, y [m], yaw [rad], v_x, v_y [m/s], yaw rate [rad/s] of the
    centre of mass; throttle -1..1 behind gate, delay and lag and road-wheel
    angle [rad], (samples, n) each, row i held from i to i + 1. output_samples
    None = after every sample. p: one vehicle, or ``flat.stack`` of n. Raises UsageError
    when shapes do not fit.
    """
    start, throttle, angle = (_to_floats(a) for a in (start, throttle, angle))
    samples = list(range(1, len(throttle) + 1)) if output_samples is None else list(output_samples)
    check_shapes(start, throttle, angle, samples)
    _check_stack_size(p, start.shape[1])
    if not (sample > 0.0 and substeps >= 1):
        raise UsageError("a rollout needs time to pass",
                         found=f"{substeps} substep(s) in {sample} s",
                         expected="at least one, in more than 0 s")
    # Kernels are compiled with -ffast-math, which assumes finite numbers.
    kernel = prepare(p, "motion", sample / substeps, start.dtype, method, engine)
    if kernel and _all_finite(start, throttle, angle):
        return kernel(start, throttle, angle, samples, substeps)
    step = make_motion_step(p, ARRAY, sample / substeps, substeps, method)
    return _rollout_numpy(step, start, throttle, angle, samples)


@accept_old_keyword("at", "output_samples")
def car_rollout(p: Vehicle, start: Array, throttle: Array, steering: Array, *,
                output_samples: Sequence[int] | None = None, dt: float = SAMPLE,
                method: str = "rk4", engine: str = "auto") -> Array:
    """Compute a rollout with the actuators: states (m, 8, n) from commands -1..1 (steps, n).

    start (8, n) as ``make_car_step`` orders it; dt [s] of one step, for which a
    row of commands is held. Pure delays are the caller's. Raises UsageError
    when shapes do not fit.
    """
    start, throttle, steering = (_to_floats(a) for a in (start, throttle, steering))
    samples = list(range(1, len(throttle) + 1)) if output_samples is None else list(output_samples)
    check_shapes(start, throttle, steering, samples, states=8)
    _check_stack_size(p, start.shape[1])
    kernel = prepare(p, "car", dt, start.dtype, method, engine)
    if kernel and _all_finite(start, throttle, steering):
        return kernel(start, throttle, steering, samples)
    return _rollout_numpy(make_car_step(p, ARRAY, dt, method), start, throttle, steering, samples)


def car_step(p: Vehicle, dt: float = SAMPLE, method: str = "rk4", engine: str = "auto") -> Step:
    """``make_car_step`` for floats with the fastest engine: one car, step by step.

    The step of a kernel is not for two threads at once.
    """
    try:
        if _check_engine(engine) != "numpy":
            return make_native_step(p, "car", dt, method)
    except CannotCompile as why:
        _report_missing_kernel(engine, why)
    return make_car_step(p, SCALAR, dt, method)


def prepare(p: Vehicle, kind: str, dt: float, dtype: DTypeLike, method: str,
            engine: str) -> CompiledStep | None:
    """The kernel for a vehicle, None = numpy.

    Raises UsageError for an unknown engine, or for "native" where there is none.
    """
    if _check_engine(engine) == "numpy":
        return None
    try:
        return CompiledStep(p, kind, dt, dtype, method)
    except CannotCompile as why:
        _report_missing_kernel(engine, why)
    return None


def check_shapes(start: Array, first: Array, second: Array, samples: Sequence[int],
                 states: int = 6) -> None:
    """Raise UsageError unless the shapes of a rollout fit and its samples exist."""
    good = (start.ndim == 2 and start.shape[0] == states and first.shape == second.shape
            and first.ndim == 2 and first.shape[1] == start.shape[1])
    if not good:
        raise UsageError("shapes of a rollout do not fit",
                         found=f"start {start.shape}, inputs {first.shape}, {second.shape}",
                         expected=f"({states}, n), (samples, n), (samples, n)")
    if any(not 0 <= k <= len(first) or k != int(k) for k in samples):
        raise UsageError("a rollout cannot be read there", found=f"samples {list(samples)}",
                         expected=f"whole numbers of 0 to {len(first)} samples")


class Batch:
    """n cars with their actuators: state (8, n) as ``make_car_step`` orders it.

    p: one vehicle for all, or ``flat.stack`` of n; dt [s] of one step. Pure
    delays of the commands are the caller's. ``engine``: "native" or "numpy".
    Raises UsageError for a stack of another size, or a dtype that is no float.
    """

    def __init__(self, p: Vehicle, n: int, dt: float = SAMPLE, dtype: DTypeLike = np.float32,
                 method: str = "rk4", engine: str = "auto") -> None:
        if np.dtype(dtype).kind != "f":
            raise UsageError("a state is of real numbers", found=f"dtype {np.dtype(dtype)}",
                             expected="float64 or float32")
        _check_stack_size(p, n)
        self.state: Array = np.zeros((8, n), dtype=dtype)
        self._kernel = prepare(p, "car", dt, dtype, method, engine)
        self.engine = "native" if self._kernel else "numpy"
        self._step = make_car_step(p, ARRAY, dt, method)

    def advance(self, throttle: Array, steering: Array, steps: int = 1) -> Array:
        """State (8, n) after ``steps`` steps with commands -1..1 (n,) held."""
        if self._kernel and _all_finite(self.state, throttle, steering):
            tau, s = (np.broadcast_to(u, (1, self.state.shape[1])) for u in (throttle, steering))
            self.state[...] = self._kernel(self.state, tau, s, [1], steps)[0]
            return self.state
        state: tuple[Any, ...] = tuple(self.state)
        for _ in range(steps):
            state = self._step(*state, throttle, steering)
        for row, new in zip(self.state, state, strict=True):
            row[...] = new
        return self.state


def _rollout_numpy(step: Step, start: Array, first: Array, second: Array,
             samples: Sequence[int]) -> Array:
    """Rollout over numpy, sample by sample."""
    out = np.empty((len(samples), *start.shape), dtype=start.dtype)
    state: tuple[Any, ...] = tuple(start)
    # Rows of the output by sample: a sample may be requested several times.
    where = {k: [i for i, w in enumerate(samples) if w == k] for k in samples}
    for k in range(max(samples, default=0) + 1):
        if k:
            state = step(*state, first[k - 1], second[k - 1])
        for i in where.get(k, ()):
            out[i] = state
    return out


def _check_engine(engine: str) -> str:
    if engine not in ENGINES:
        raise UsageError(f"no engine {engine!r}", expected=", ".join(ENGINES))
    return engine


def _report_missing_kernel(engine: str, why: CannotCompile) -> None:
    if engine == "native":
        raise UsageError("there is no compiled kernel for this vehicle", found=str(why),
                         remedy="install a C compiler (apt install gcc), or engine=\"numpy\"")


def _to_floats(a: Array) -> Array:
    """As an array of floats: integers would cut off what the states become."""
    a = np.asarray(a)
    return a if a.dtype.kind == "f" else a.astype(np.float64)


def _check_stack_size(p: Vehicle, n: int) -> None:
    sizes = shapes(p)
    if sizes - {(n,)}:
        raise UsageError("a stack has a vehicle for each car", found=f"{n} cars and parameters "
                         f"of shapes {sorted(sizes)}", expected=f"({n},)")


def _all_finite(*arrays: Array) -> bool:
    """Whether a kernel may take them: -ffast-math knows neither NaN nor infinity."""
    return all(bool(np.isfinite(a).all()) for a in arrays)
