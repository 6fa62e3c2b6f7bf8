"""One call of a kernel on numpy arrays: addresses, strides, order of what is read."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dart_hal.vehicle.native.library import Job, Run

Array = NDArray[Any]
# Cars that are computed together at most: ``PAD`` of the C text.
PAD = 16


def call(run: Run, h: Array, start: Array, first: Array, second: Array,
         output_samples: Sequence[int], substeps: int, out: Array | None = None) -> Array:
    """Return the states (m, states, n) after ``output_samples`` (m,), in any order.

    h: from ``align_coefficients``; start (states, n); inputs (samples, n), or (samples,) for all
    cars. out: C-contiguous, of h's type; it may be start's memory when the only
    thing read is the end.
    """
    start, first, second = (np.ascontiguousarray(a, dtype=h.dtype)
                            for a in (start, first, second))
    states, n = start.shape
    # The kernel writes states in ascending order of their samples; any other order is restored at
    # the end.
    order = np.argsort(output_samples, kind="stable")
    reads = np.asarray(output_samples, dtype=np.int64)[order]
    in_order = bool((order[:-1] < order[1:]).all())
    result = (out if out is not None and in_order
              else np.empty((len(reads), states, n), dtype=h.dtype))
    # Strides of the inputs: a column for each car, or one column for all.
    lane, row = (1, n) if first.ndim == 2 else (0, 1)
    run(ctypes.byref(Job(
        n=n, samples=len(first), substeps=substeps, reads=len(reads), ldh=h.shape[-1], lane=lane,
        row=row, at=reads.ctypes.data, h=h.ctypes.data, u0=first.ctypes.data,
        u1=second.ctypes.data, start=start.ctypes.data, out=result.ctypes.data)))
    if in_order:
        return result
    back = np.empty_like(result)
    back[order] = result
    return back


def align_coefficients(h: Array, dtype: Any) -> Array:
    """Coefficients as a kernel reads them: rows of whole vectors, the last lane repeated."""
    if h.ndim == 1:
        return h.astype(dtype)
    return np.ascontiguousarray(np.pad(h, ((0, 0), (0, -h.shape[1] % PAD)), mode="edge"),
                                dtype=dtype)
