"""Encoder rings on the main gear: where the edges are.

Positions are fractions of one revolution, sorted in [0, 1). Between an even
edge and the next lies a tooth, after it a gap; unequal pitch, unequal duty
and missing teeth are what real rings have.
"""

from __future__ import annotations

import math
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


def turned_ring(ring: Ring, by: float) -> Ring:
    """The ring, glued on ``by`` of a turn further round."""
    return Ring(tuple(sorted((edge + by) % 1.0 for edge in ring.edges)))


def worn_ring(ring: Ring, missing: float, uneven: float, phase: float) -> Ring:
    """The ring with bad marks, as the effect ``encoder_ring`` has them.

    Marks stand with the density 1 + uneven cos(2 pi u) along a turn u; the
    first ``missing`` of a turn has none, in whole marks and at least one (below
    0: has each twice); ``phase`` [turn]: where on the ring the gear stands at
    the start.
    """
    at = [_warped(edge, uneven) for edge in ring.edges]
    bad = max(1, round(abs(missing) * ring.n)) if missing else 0
    ends = [*at[1:], at[0] + 1.0]
    twice = [0.5 * (a + b) for a, b in zip(at[:bad], ends, strict=False)]
    at = at[bad:] if missing > 0.0 else at + twice
    return Ring(tuple(sorted((edge - phase) % 1.0 for edge in at)))


def twice_round(ring: Ring) -> Ring:
    """Two turns of a ring as one of twice the way."""
    return Ring(tuple(0.5 * (edge + turn) for turn in (0, 1) for edge in ring.edges))


def _warped(edge: float, uneven: float) -> float:
    """The u with u + uneven sin(2 pi u) / (2 pi) = edge; Newton, |uneven| < 1."""
    u = edge
    for _ in range(20):
        turned = 2.0 * math.pi * u
        off = u + uneven * math.sin(turned) / (2.0 * math.pi) - edge
        u -= off / (1.0 + uneven * math.cos(turned))
    return u
