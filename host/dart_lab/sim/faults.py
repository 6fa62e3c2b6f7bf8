"""The line between Nano and host: damage and delay, seeded and repeatable.

A line is a seeded function of (bytes, time of the last stop bit): the same seed and input give the
same output, whether the bytes come from a Nano or from a recording. Bytes never overtake others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.types import BoolArray

Interval = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Latency:
    """Delay from stop bit to host: uniform in 0..spread [s], and a tail of probability ``tail_p``.

    The tail is uniform in ``tail`` [s]. The distributions are assumed: that of a real USB bridge
    has not been measured.
    """

    spread: float = 0.0
    tail_p: float = 0.0
    tail: Interval = (0.001, 0.040)


# usb: like a CH340; busy: the same on a loaded host; ftdi: an FT232 with its default 16 ms timer.
LATENCY_MODELS = {
    "none": Latency(),
    "usb": Latency(0.001, 0.02, (0.001, 0.040)),
    "busy": Latency(0.001, 0.30, (0.001, 0.040)),
    "ftdi": Latency(0.016),
}


@dataclass(frozen=True, slots=True)
class LineFaults:
    """Rates and intervals of damage; all 0 or empty is a perfect line.

    ``bit_error``: probability per bit; ``drop``, ``duplicate``: per byte; ``burst``: per byte that
    a burst starts, which replaces ``burst_length`` bytes (0x00 among them); ``silence``: intervals
    [s] in which nothing passes; ``delay``: additional delay of every byte [s].
    """

    bit_error: float = 0.0
    drop: float = 0.0
    duplicate: float = 0.0
    burst: float = 0.0
    burst_length: int = 8
    silence: Sequence[Interval] = ()
    delay: float = 0.0

    @property
    def is_clean(self) -> bool:
        return not (self.bit_error or self.drop or self.duplicate or self.burst)


class Line:
    """One direction of a line with its faults and its latency.

    ``faults``: the present ones; ``initial_faults``: those that it was made with.
    """

    def __init__(self, faults: LineFaults | None = None, latency: Latency | None = None,
                 seed: Sequence[int] = (0,)) -> None:
        self.faults = self.initial_faults = faults or LineFaults()
        self.latency = latency or Latency()
        self.damaged = 0
        self._rng = np.random.default_rng(list(seed))
        self._delay_rng = np.random.default_rng([*seed, 1])
        self._burst_remaining = 0
        self._last = 0.0

    def carry(self, data: bytes, t: float) -> tuple[bytes, float]:
        """Return what arrives of ``data`` (b"" = nothing) and its time [s]."""
        if any(a <= t < b for a, b in self.faults.silence):
            self.damaged += len(data)
            data = b""
        if not self.faults.is_clean and data:
            data = self._damage(data)
        return data, self._arrival(t)

    def _damage(self, data: bytes) -> bytes:
        f = self.faults
        n = len(data)
        rng = self._rng
        # Drawn in this order for every chunk, so that a seed gives the same damage on every run.
        flips = np.packbits(rng.random((n, 8)) < f.bit_error, axis=1)[:, 0]
        lost = rng.random(n) < f.drop
        twice = rng.random(n) < f.duplicate
        noise = np.where(self._burst_mask(rng.random(n) < f.burst), rng.integers(0, 256, n), -1)
        if not (flips.any() or lost.any() or twice.any() or noise.max() >= 0):
            return data
        # A burst replaces a byte, flipped bits change it, then it is lost or duplicated.
        raw = np.frombuffer(data, np.uint8)
        raw = np.where(noise >= 0, noise, raw).astype(np.uint8) ^ flips
        out = np.repeat(raw, np.where(lost, 0, np.where(twice, 2, 1))).tobytes()
        self.damaged += out != data
        return out

    def _burst_mask(self, starts: BoolArray) -> BoolArray:
        """Return which bytes lie in a burst; a burst may continue in the next chunk."""
        inside = np.zeros(len(starts), np.bool_)
        inside[:self._burst_remaining] = True
        remaining = max(0, self._burst_remaining - len(starts))
        for k in np.flatnonzero(starts):
            inside[k:k + self.faults.burst_length] = True
            remaining = max(remaining, int(k) + self.faults.burst_length - len(starts))
        self._burst_remaining = remaining
        return inside

    def _arrival(self, t: float) -> float:
        latency = self.latency
        t += self.faults.delay
        if latency.spread or latency.tail_p:
            u, p, w = self._delay_rng.random(3).tolist()
            low, high = latency.tail
            t += u * latency.spread + (low + w * (high - low) if p < latency.tail_p else 0.0)
        self._last = max(self._last, t)
        return self._last


def latency_model(name: str) -> Latency:
    """The latency model of that name. Raises UsageError."""
    if name not in LATENCY_MODELS:
        raise UsageError(f"no jitter {name!r}", expected=", ".join(LATENCY_MODELS))
    return LATENCY_MODELS[name]
