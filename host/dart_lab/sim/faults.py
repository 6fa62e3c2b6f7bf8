"""The line between Nano and host: damage and delay, seeded and repeatable.

A pure function on (bytes, time of the last stop bit): the same seed and input
give the same output, whether the bytes come from a Nano or from a recording.
FIFO order is never broken.
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
    """Delay from stop bit to host: uniform 0..spread, with ``tail_p`` a tail.

    The tail is uniform in ``tail`` [s]. Shapes are assumptions; the one of a
    real USB bridge is to be measured.
    """

    spread: float = 0.0
    tail_p: float = 0.0
    tail: Interval = (0.001, 0.040)


JITTER = {
    "none": Latency(),
    "usb": Latency(0.001, 0.02, (0.001, 0.040)),
    "busy": Latency(0.001, 0.30, (0.001, 0.040)),
    "ftdi": Latency(0.016),
}
"""CH340-like, the same on a loaded host, FT232 with its default 16 ms timer."""


@dataclass(frozen=True, slots=True)
class LineFaults:
    """Rates and intervals; everything 0 or empty is a perfect line.

    ``bit_error`` per bit; ``drop``, ``duplicate`` per byte; ``burst`` per byte,
    damaging ``burst_length`` bytes (0x00 among them); ``silence``: intervals
    [s] in which nothing passes; ``late``: s that every byte takes longer.
    """

    bit_error: float = 0.0
    drop: float = 0.0
    duplicate: float = 0.0
    burst: float = 0.0
    burst_length: int = 8
    silence: Sequence[Interval] = ()
    late: float = 0.0

    @property
    def clean(self) -> bool:
        return not (self.bit_error or self.drop or self.duplicate or self.burst)


class Line:
    """One direction of a line with its faults and its latency.

    ``faults``: those of now; ``lasting``: those that it was made with.
    """

    def __init__(self, faults: LineFaults | None = None, latency: Latency | None = None,
                 seed: Sequence[int] = (0,)) -> None:
        self.faults = self.lasting = faults or LineFaults()
        self.latency = latency or Latency()
        self.damaged = 0
        self._rng = np.random.default_rng(list(seed))
        self._delay_rng = np.random.default_rng([*seed, 1])
        self._burst_left = 0
        self._last = 0.0

    def carry(self, data: bytes, t: float) -> tuple[bytes, float]:
        """What arrives of ``data`` (b"" = nothing), and when."""
        if any(a <= t < b for a, b in self.faults.silence):
            self.damaged += len(data)
            data = b""
        if not self.faults.clean and data:
            data = self._damage(data)
        return data, self._arrival(t)

    def _damage(self, data: bytes) -> bytes:
        f, n, rng = self.faults, len(data), self._rng
        flips = np.packbits(rng.random((n, 8)) < f.bit_error, axis=1)[:, 0]
        lost, twice = rng.random(n) < f.drop, rng.random(n) < f.duplicate
        noise = np.where(self._bursting(rng.random(n) < f.burst), rng.integers(0, 256, n), -1)
        if not (flips.any() or lost.any() or twice.any() or noise.max() >= 0):
            return data
        raw = np.frombuffer(data, np.uint8)
        raw = np.where(noise >= 0, noise, raw).astype(np.uint8) ^ flips
        out = np.repeat(raw, np.where(lost, 0, np.where(twice, 2, 1))).tobytes()
        self.damaged += out != data
        return out

    def _bursting(self, starts: BoolArray) -> BoolArray:
        """Which bytes lie in a burst; one may run on into the next chunk."""
        inside = np.zeros(len(starts), np.bool_)
        inside[:self._burst_left] = True
        left = max(0, self._burst_left - len(starts))
        for k in np.flatnonzero(starts):
            inside[k:k + self.faults.burst_length] = True
            left = max(left, int(k) + self.faults.burst_length - len(starts))
        self._burst_left = left
        return inside

    def _arrival(self, t: float) -> float:
        latency = self.latency
        t += self.faults.late
        if latency.spread or latency.tail_p:
            u, p, w = self._delay_rng.random(3).tolist()
            low, high = latency.tail
            t += u * latency.spread + (low + w * (high - low) if p < latency.tail_p else 0.0)
        self._last = max(self._last, t)
        return self._last


def jitter(name: str) -> Latency:
    """The latency model of that name. Raises UsageError."""
    if name not in JITTER:
        raise UsageError(f"no jitter {name!r}", expected=", ".join(JITTER))
    return JITTER[name]
