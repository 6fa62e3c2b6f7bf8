"""Encoder rings on the main gear: where the edges are.

Positions are fractions of one revolution, sorted in [0, 1). Between an even
edge and the next lies a tooth, after it a gap; unequal pitch, unequal duty
and missing teeth are what real rings have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.vehicle.parameters import GEAR_REVOLUTION as GEAR_REVOLUTION

RING_A, RING_B = 20, 10
"""Edges per revolution: ten printed teeth (infrared), five magnets (Hall)."""


@dataclass(frozen=True, slots=True)
class Ring:
    """A ring with its edges; ``missing`` teeth were left out."""

    edges: tuple[float, ...]

    @property
    def n(self) -> int:
        return len(self.edges)

    @property
    def fractions(self) -> tuple[float, ...]:
        """Interval k (edge k to k + 1) as part of the mean interval: sum n."""
        ends = (*self.edges[1:], self.edges[0] + 1.0)
        return tuple(self.n * (b - a) for a, b in zip(self.edges, ends, strict=True))


def even_ring(n: int) -> Ring:
    """n equal intervals; n must be even (a tooth has two flanks)."""
    return Ring(tuple(k / n for k in range(n)))


def uneven_ring(n: int, rng: np.random.Generator, spacing: float = 0.03, duty: float = 0.12,
                missing: Sequence[int] = ()) -> Ring:
    """A ring with spacing errors and duty error, as parts of the mean interval.

    Every flank is displaced by N(0, spacing) (at most 2.5 sigma), teeth are
    ``duty`` wider than gaps; ``missing`` are indices of teeth left out.
    """
    pitch = 1.0 / n
    shift = np.clip(rng.normal(0.0, spacing, n), -2.5 * spacing, 2.5 * spacing) * pitch
    shift[1::2] += duty * pitch
    edges = np.arange(n) * pitch + shift
    edges -= edges[0]
    gone = {k for tooth in missing for k in (2 * tooth, 2 * tooth + 1)}
    return Ring(tuple(float(e) for k, e in enumerate(edges) if k not in gone))
