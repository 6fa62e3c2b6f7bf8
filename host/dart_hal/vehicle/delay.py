"""Delays and lags of signals: of whole series, of ticks, and of events with a time.

Every delay of the vehicle model, of the simulation and of predictions is applied by these.

- ``delay_series`` shifts an array; ``first_order_lag`` filters one.
- ``DelayRing`` delays a signal that comes tick by tick.
- ``DelayQueue`` hands out events when their time has come.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, Generic, Literal, TypeVar

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.namespace import ARRAY, SCALAR, Namespace

WHOLE_SAMPLE_TOLERANCE = 1e-9  # samples; a time closer than that to a sample is at it
LAG_BLOCK = 64  # samples of a lag at once
# At which moment of a sample, in which the command is held, the output of a lag is taken.
Sampled = Literal["start", "middle", "mean"]

Event = TypeVar("Event")


def delay_series(signal: Any, seconds: Any, dt: float) -> Any:
    """The series ``seconds`` later, linear between samples, its ends held; also earlier.

    signal (n,) or (n, lanes), or a tuple of them; seconds a number, or (lanes,).

    >>> delay_series(np.array([0.0, 1.0, 2.0]), 0.005, 0.01)
    array([0. , 0.5, 1.5])
    """
    if isinstance(signal, tuple):
        return tuple(delay_series(part, seconds, dt) for part in signal)
    series = np.asarray(signal)
    # 1. The delay in samples is a whole number k and a share r of one sample.
    whole, share = split_delay(np.asarray(seconds, dtype=np.float64) / dt, ARRAY)
    last = len(series) - 1
    index = np.arange(len(series))
    if series.ndim == 2:
        index, whole = index[:, None], np.broadcast_to(whole, series.shape[1:])
    # 2. y_i = u_(i-k) + r (u_(i-k-1) - u_(i-k)). Indices beyond an end take the sample there.
    late = index - whole.astype(np.int64)
    here, before = (np.take_along_axis(series, np.clip(at, 0, last), axis=0)
                    for at in (late, late - 1))
    return np.asarray(here + share * (before - here))


def split_delay(samples: Any, f: Namespace) -> tuple[Any, Any]:
    """Whole samples of a delay, and the share of the next one."""
    whole = f.floor(samples + WHOLE_SAMPLE_TOLERANCE)
    return whole, f.fmax(0.0, samples - whole)


class DelayRing:
    """Delays a signal, a float or a tuple, that comes each ``dt`` [s]; the first one is held.

    whole: whole samples of the delay; below 0 it would need the future, and ``step`` is not for it.
    """

    def __init__(self, seconds: float, dt: float) -> None:
        self.whole, self._share = split_delay(seconds / dt, SCALAR)
        self._size = max(math.floor(self.whole), 0) + 2
        self._ring: deque[Any] = deque(maxlen=self._size)

    def step(self, signal: Any) -> Any:
        """Take the next value and return the delayed one."""
        # The first call fills the ring: the signal was constant before it. For a delay of k whole
        # samples, the two oldest entries are from k + 1 and k steps ago.
        self._ring.extend([signal] * (1 if self._ring else self._size))
        here = self._ring[1]
        before = self._ring[0]
        if isinstance(signal, tuple):
            return tuple(h + self._share * (b - h) for h, b in zip(here, before, strict=True))
        return here + self._share * (before - here)


class DelayQueue(Generic[Event]):
    """Events in the order of their times, each handed out once its time has come."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[float, Event]] = deque()

    def put(self, t: float, event: Event) -> None:
        """Add an event that is due at t [s], not before those that were put earlier."""
        self._waiting.append((t, event))

    def take(self, t: float) -> Iterator[Event]:
        """Hand out what is due by t [s]."""
        while self._waiting and self._waiting[0][0] <= t:
            yield self._waiting.popleft()[1]


def first_order_lag(u: FloatArray, lag: float, sampled: Sampled = "start") -> FloatArray:
    """T y' = u - y of a command u (..., n) held over each sample, T = ``lag`` [s], y_0 = u_0.

    y_i = k y_(i-1) + (1 - k) u_(i-1) with k = exp(-0.01 s / T) as sample i starts. In its
    middle sqrt(k) y_i + (1 - sqrt(k)) u_i; its mean u_i + (y_i - u_i) (1 - k) T / 0.01 s.
    """
    if lag <= 0.0:
        return u
    keep = math.exp(-SAMPLE / lag)
    y = low_pass(u, keep)
    if sampled == "mean":
        return np.asarray(u + (y - u) * (1.0 - keep) * lag / SAMPLE)
    half = math.exp(-0.5 * SAMPLE / lag)
    return np.asarray(half * y + (1.0 - half) * u) if sampled == "middle" else y


def low_pass(u: FloatArray, keep: float) -> FloatArray:
    """y (..., n) with y_0 = u_0 and y_i = keep y_(i-1) + (1 - keep) u_(i-1), u (..., n).

    In blocks, each a product with the same triangle. (scipy's ``lfilter`` does the same;
    its module alone takes longer to import than a recording to evaluate.)
    """
    # Within a block of N samples with the first output y_0, the recursion is
    #     y_j = keep^j y_0 + (1 - keep) sum_(i < j) keep^(j-1-i) u_i
    # 1. forced: the sum for all blocks at once, a product with a triangular matrix.
    # 2. From block to block: the next y_0 is keep^N y_0 plus the sum of the whole block.
    # 3. Add the decay of y_0 to each sample of its block.
    n, (left, answer) = u.shape[-1], _lag_block(keep)
    padded = np.concatenate([u, np.repeat(u[..., -1:], -n % LAG_BLOCK, axis=-1)], axis=-1)
    blocks = padded.reshape(*u.shape[:-1], -1, LAG_BLOCK)
    forced = blocks @ answer
    last = keep * forced[..., -1] + (1.0 - keep) * blocks[..., -1]
    begin, over = [u[..., 0]], keep**LAG_BLOCK
    # numbers are quicker than arrays of one
    for one in last.tolist() if u.ndim == 1 else np.moveaxis(last, -1, 0):
        begin.append(over * begin[-1] + one)
    # np.stack makes an array of each plain number
    starts = np.array(begin[:-1]) if u.ndim == 1 else np.stack(begin[:-1], axis=-1)
    out = forced + starts[..., None] * left
    return np.asarray(out.reshape(padded.shape)[..., :n])


@lru_cache(maxsize=8)
def _lag_block(keep: float) -> tuple[FloatArray, FloatArray]:
    """Of a lag: what is left of y_0 after each sample of a block, and y (j) by u (i), (i, j)."""
    ahead = np.arange(LAG_BLOCK)
    since = ahead[None, :] - 1 - ahead[:, None]  # samples from u_i to y_j
    left = np.asarray(keep**ahead, dtype=np.float64)
    return left, np.where(since >= 0, (1.0 - keep) * left[np.maximum(since, 0)], 0.0)
