"""Open-loop rollouts of windows: from a measured state onwards with the logged commands alone.

Windows of several recordings are one batch, as pairs (grid, first samples). States are
(.., 6, windows): x, y [m], yaw [rad, unwrapped], v_x, v_y [m/s], yaw rate [rad/s]
of the centre of mass.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.recording.dart import Grid
from dart_hal.vehicle.batch import rollout
from dart_hal.vehicle.delay import Sampled
from dart_hal.vehicle.fitting.covariance import pool_blocks
from dart_hal.vehicle.parameters import Vehicle

from .actuators import actuator_outputs

Parts = Sequence[tuple[Grid, IntArray]]
Progress = Callable[[float], None]
# As ``map``, with the results in any order.
Apply = Callable[[Callable[[slice], Any], list[slice]], Iterable[Any]]
# Windows of one batch: they fit into the cache of a core, and bound the memory.
BATCH_WINDOWS = 2048


def states(g: Grid, rows: IntArray | slice = slice(None)) -> FloatArray:
    """Return the measured states (6, n) of a recording, at all samples or at ``rows``."""
    return np.stack([v[rows] for v in (g.x, g.y, g.yaw, g.v_x, g.v_y, g.omega)])


def measured_states(parts: Parts, offsets: Sequence[int] | IntArray) -> FloatArray:
    """Return measured states (len(offsets), 6, windows), ``offsets`` samples after each start."""
    return np.stack([np.concatenate([states(g, first + k) for g, first in parts], axis=1)
                     for k in offsets])


def concatenate_series(parts: Parts, series: Sequence[FloatArray]) -> tuple[FloatArray, IntArray]:
    """Concatenate series; return (the series, start (windows,) of each window in it)."""
    offsets = np.cumsum([0, *(len(g) for g, _ in parts)])
    return np.concatenate(series), np.concatenate(
        [first + offset for (_, first), offset in zip(parts, offsets, strict=False)])


def label_stretches(parts: Parts, length: float) -> tuple[IntArray, IntArray]:
    """Label each window (windows,) with its (recording, stretch of ``length`` [s])."""
    return pool_blocks([(first * SAMPLE // length).astype(np.int64) for _, first in parts])


def cut_windows(series: FloatArray, starts: IntArray, samples: int) -> FloatArray:
    """Cut the windows (samples, windows) that begin at ``starts`` from a concatenated series."""
    return np.asarray(series[starts[None, :] + np.arange(samples)[:, None]])


def inputs(p: Vehicle, parts: Parts, smooth: bool = False, sampled: Sampled = "start"
           ) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return (throttle, road-wheel angle, starts) behind the actuators, concatenated."""
    throttle, angle = zip(*(actuator_outputs(p, g, smooth=smooth, sampled=sampled) for g, _
                            in parts),
                          strict=True)
    tau, at = concatenate_series(parts, throttle)
    return tau, np.concatenate(angle), at


def batches(n: int) -> Iterator[slice]:
    """Return slices of at most BATCH_WINDOWS windows."""
    return (slice(a, min(a + BATCH_WINDOWS, n)) for a in range(0, n, BATCH_WINDOWS))


def predict(p: Vehicle, parts: Parts, offsets: Sequence[int], *, smooth: bool = False,
            sampled: Sampled = "start", progress: Progress | None = None,
            apply: Apply = map) -> FloatArray:
    """Predict the states (len(offsets), 6, windows), ``offsets`` samples after each start.

    smooth, sampled: as ``behind_actuator``; progress(share) reports each batch; apply: computes
    the batches, ``each`` on a cluster.
    """
    throttle, angle, first = inputs(p, parts, smooth, sampled)
    start = measured_states(parts, (0,))[0]
    out = np.empty((len(offsets), 6, len(first)))
    done = 0
    work = partial(_predict_batch, p, throttle, angle, first, start, offsets)
    for some, found in apply(work, list(batches(len(first)))):
        out[:, :, some] = found
        done += found.shape[-1]
        if progress is not None:
            progress(done / len(first))
    return out


def _predict_batch(p: Vehicle, throttle: FloatArray, angle: FloatArray, first: IntArray,
                   start: FloatArray, offsets: Sequence[int], some: slice
                   ) -> tuple[slice, FloatArray]:
    """Predict the windows ``some``; the slice with their states."""
    with np.errstate(over="ignore", invalid="ignore"):  # a model may diverge: it is scored
        return some, rollout(p, start[:, some], cut_windows(throttle, first[some], max(offsets)),
                             cut_windows(angle, first[some], max(offsets)),
                             output_samples=offsets)
