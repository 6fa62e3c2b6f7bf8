"""Commands over time for the segments of an experiment, as plain data."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Signal = Callable[[float], float]
"""A command of the time [s] since its segment began."""


@dataclass(frozen=True, slots=True)
class Constant:
    """One level."""

    level: float

    def __call__(self, t: float) -> float:
        return self.level


@dataclass(frozen=True, slots=True)
class Ramp:
    """Linear from ``start`` to ``end`` in ``seconds``, then constant."""

    start: float
    end: float
    seconds: float

    def __call__(self, t: float) -> float:
        return self.start + (self.end - self.start) * min(max(t / self.seconds, 0.0), 1.0)


@dataclass(frozen=True, slots=True)
class Sine:
    """``mean`` + ``amplitude`` sin(2 pi t / period)."""

    mean: float
    amplitude: float
    period: float

    def __call__(self, t: float) -> float:
        return self.mean + self.amplitude * math.sin(2.0 * math.pi * t / self.period)


@dataclass(frozen=True, slots=True)
class Chirp:
    """A sine whose frequency rises from ``low`` to ``high`` [Hz] within ``seconds``.

    Logarithmic: every octave lasts equally long.
    """

    mean: float
    amplitude: float
    low: float
    high: float
    seconds: float

    def __call__(self, t: float) -> float:
        rate = math.log(self.high / self.low) / self.seconds
        phase = 2.0 * math.pi * self.low * math.expm1(rate * min(t, self.seconds)) / rate
        return self.mean + self.amplitude * math.sin(phase)


@dataclass(frozen=True, slots=True)
class Levels:
    """``levels`` in order, each for ``hold`` [s]; the last one remains."""

    levels: tuple[float, ...]
    hold: float

    def __call__(self, t: float) -> float:
        return self.levels[min(max(int(t / self.hold), 0), len(self.levels) - 1)]


def random_steps(low: float, high: float, n: int, hold: float, seed: int = 1) -> Levels:
    """Draw n levels between ``low`` and ``high``, alternating around the middle.

    The seed is fixed, so that an experiment is repeatable.
    """
    rng = np.random.default_rng(seed)
    middle = 0.5 * (low + high)
    half = 0.5 * (high - low)
    size = rng.uniform(0.4, 1.0, n) * np.where(np.arange(n) % 2 == 0, 1.0, -1.0)
    return Levels(tuple(float(v) for v in middle + half * size), hold)
