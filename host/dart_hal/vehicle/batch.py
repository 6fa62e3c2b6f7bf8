"""Many cars at once, and the open-loop rollouts of many windows.

Arrays have one lane per car. The equations are those of ``step``, over numpy;
the compiled kernel, where it was built, gives the same numbers faster.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from dart_hal.errors import UsageError
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.step import make_car_step, make_motion_step

Array = NDArray[Any]
SAMPLE, SUBSTEPS = 0.01, 4
"""s between held inputs of an open-loop rollout, and RK4 steps in between."""


def rollout(p: Vehicle, start: Array, throttle: Array, angle: Array, *,
            at: Sequence[int] | None = None, sample: float = SAMPLE,
            substeps: int = SUBSTEPS) -> Array:
    """States of n cars under held inputs, (len(at), 6, n); at: numbers of samples passed.

    start (6, n): x, y [m], yaw [rad], v_x, v_y [m/s], yaw rate [rad/s] of the
    centre of mass; throttle -1..1 behind gate, delay and lag and road-wheel
    angle [rad], (samples, n) each, row i held from i to i + 1. at None = after
    every sample. p: one vehicle, or ``flat.stack`` of n. Raises UsageError
    when shapes do not fit.
    """
    samples = len(throttle)
    wanted = list(range(1, samples + 1)) if at is None else list(at)
    check_shapes(start, throttle, angle, wanted)
    out = np.empty((len(wanted), 6, start.shape[1]), dtype=start.dtype)
    step = make_motion_step(p, ARRAY, sample / substeps, substeps)
    state: tuple[Any, ...] = tuple(start)
    where = {k: [i for i, w in enumerate(wanted) if w == k] for k in wanted}
    for k in range(max(wanted, default=0) + 1):
        if k:
            state = step(*state, throttle[k - 1], angle[k - 1])
        for i in where.get(k, ()):
            out[i] = state
    return out


def check_shapes(start: Array, throttle: Array, angle: Array, at: Sequence[int]) -> None:
    """Raises UsageError unless a rollout of these arrays makes sense."""
    good = (start.ndim == 2 and start.shape[0] == 6 and throttle.shape == angle.shape
            and throttle.ndim == 2 and throttle.shape[1] == start.shape[1])
    if not good:
        raise UsageError("shapes of a rollout do not fit",
                         found=f"start {start.shape}, throttle {throttle.shape}, "
                               f"angle {angle.shape}",
                         expected="(6, n), (samples, n), (samples, n)")
    if any(not 0 <= k <= len(throttle) for k in at):
        raise UsageError("a rollout cannot be read there", found=f"at = {list(at)}",
                         expected=f"0 to {len(throttle)} samples")


class Batch:
    """n cars with their actuators: state (8, n) as ``make_car_step`` orders it.

    p: one vehicle for all, or ``flat.stack`` of n; dt [s] of one RK4 step.
    Pure delays of the commands are the caller's.
    """

    def __init__(self, p: Vehicle, n: int, dt: float = SAMPLE, dtype: DTypeLike = np.float32,
                 method: str = "rk4") -> None:
        self.state: Array = np.zeros((8, n), dtype=dtype)
        self._step = make_car_step(p, ARRAY, dt, method)

    def advance(self, throttle: Array, steering: Array, steps: int = 1) -> Array:
        """State (8, n) after ``steps`` steps with commands -1..1 (n,) held."""
        state: tuple[Any, ...] = tuple(self.state)
        for _ in range(steps):
            state = self._step(*state, throttle, steering)
        for row, new in zip(self.state, state, strict=True):
            row[...] = new
        return self.state
