"""Open-loop rollouts of windows: from a measured state onwards with the logged commands alone.

Windows of several recordings go side by side, as pairs (grid, first samples). States
are (.., 6, windows): x, y [m], yaw [rad, unwrapped], v_x, v_y [m/s], yaw rate [rad/s]
of the centre of mass.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.recording.dart import Grid
from dart_hal.vehicle.batch import rollout
from dart_hal.vehicle.delay import Sampled
from dart_hal.vehicle.fitting.covariance import pool_blocks
from dart_hal.vehicle.parameters import Vehicle

from .actuators import actuated

Parts = Sequence[tuple[Grid, IntArray]]
Progress = Callable[[float], None]
LANES = 2048
"""Windows that are rolled out together: what a core's cache holds, and bounds the memory."""


def states(g: Grid, at: IntArray | slice = slice(None)) -> FloatArray:
    """Measured states (6, n) of a recording, of all its samples or at some."""
    return np.stack([v[at] for v in (g.x, g.y, g.yaw, g.v_x, g.v_y, g.omega)])


def measured(parts: Parts, at: Sequence[int] | IntArray) -> FloatArray:
    """Measured states (len(at), 6, windows) so many samples after each start."""
    return np.stack([np.concatenate([states(g, first + k) for g, first in parts], axis=1)
                     for k in at])


def joined(parts: Parts, series: Sequence[FloatArray]) -> tuple[FloatArray, IntArray]:
    """(series of all recordings end to end, start (windows,) of each window in it)."""
    offsets = np.cumsum([0, *(len(g) for g, _ in parts)])
    return np.concatenate(series), np.concatenate(
        [first + offset for (_, first), offset in zip(parts, offsets, strict=False)])


def stretches(parts: Parts, length: float) -> tuple[IntArray, IntArray]:
    """(recording, stretch of ``length`` [s] of it) in which each window starts, (windows,)."""
    return pool_blocks([(first * SAMPLE // length).astype(np.int64) for _, first in parts])


def windowed(series: FloatArray, at: IntArray, samples: int) -> FloatArray:
    """(samples, windows): what windows that start at ``at`` see of a joined series."""
    return np.asarray(series[at[None, :] + np.arange(samples)[:, None]])


def inputs(p: Vehicle, parts: Parts, smooth: bool = False, sampled: Sampled = "start"
           ) -> tuple[FloatArray, FloatArray, IntArray]:
    """(throttle, road-wheel angle, starts) as ``joined``, behind the actuators."""
    throttle, angle = zip(*(actuated(p, g, smooth=smooth, sampled=sampled) for g, _ in parts),
                          strict=True)
    tau, at = joined(parts, throttle)
    return tau, np.concatenate(angle), at


def batches(n: int) -> Iterator[slice]:
    """Slices of at most LANES windows."""
    return (slice(a, min(a + LANES, n)) for a in range(0, n, LANES))


def predict(p: Vehicle, parts: Parts, at: Sequence[int], *, smooth: bool = False,
            sampled: Sampled = "start", progress: Progress | None = None) -> FloatArray:
    """What the model says so many samples after each start, (len(at), 6, windows).

    smooth, sampled: as ``behind_actuator``; progress(share) is called as it goes.
    """
    throttle, angle, first = inputs(p, parts, smooth, sampled)
    start = measured(parts, (0,))[0]
    out = np.empty((len(at), 6, len(first)))
    for some in batches(len(first)):
        with np.errstate(over="ignore", invalid="ignore"):  # a model may diverge: it is scored
            out[:, :, some] = rollout(p, start[:, some], windowed(throttle, first[some], max(at)),
                                      windowed(angle, first[some], max(at)), at=at)
        if progress is not None:
            progress(some.stop / len(first))
    return out
