"""Encoder rings on the main gear: positions of their edges.

Positions are fractions of one revolution, sorted in [0, 1). A tooth lies between an edge of even
index and the next, then a gap. Real rings have unequal pitch, unequal duty and missing teeth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dart_hal.vehicle.parameters import GEAR_REVOLUTION as GEAR_REVOLUTION

# Edges per revolution: ten printed teeth (infrared), five magnets (Hall).
RING_A = 20
RING_B = 10


@dataclass(frozen=True, slots=True)
class EncoderRing:
    """A ring with its edges."""

    edges: tuple[float, ...]

    @property
    def n(self) -> int:
        return len(self.edges)

    @property
    def fractions(self) -> tuple[float, ...]:
        """Return the intervals, from edge k to k + 1, relative to their mean."""
        ends = (*self.edges[1:], self.edges[0] + 1.0)
        return tuple(self.n * (b - a) for a, b in zip(self.edges, ends, strict=True))


def even_ring(n: int) -> EncoderRing:
    """Return a ring with n equal intervals; n must be even, since a tooth has two edges."""
    return EncoderRing(tuple(k / n for k in range(n)))


def uneven_ring(n: int, rng: np.random.Generator, spacing: float = 0.03, duty: float = 0.12,
                missing: Sequence[int] = ()) -> EncoderRing:
    """Return a ring with spacing errors and a duty error, relative to the mean interval.

    Every edge is displaced by N(0, spacing), at most 2.5 sigma. Teeth are wider than gaps by
    ``duty``. ``missing``: indices of missing teeth.
    """
    pitch = 1.0 / n
    shift = np.clip(rng.normal(0.0, spacing, n), -2.5 * spacing, 2.5 * spacing) * pitch
    shift[1::2] += duty * pitch
    edges = np.arange(n) * pitch + shift
    edges -= edges[0]
    gone = {k for tooth in missing for k in (2 * tooth, 2 * tooth + 1)}
    return EncoderRing(tuple(float(e) for k, e in enumerate(edges) if k not in gone))


def rotate_ring(ring: EncoderRing, angle: float) -> EncoderRing:
    """Return the ring rotated by an angle [turn]."""
    return EncoderRing(tuple(sorted((edge + angle) % 1.0 for edge in ring.edges)))


def wear_ring(ring: EncoderRing, missing: float, uneven: float, phase: float) -> EncoderRing:
    """Return the ring with the bad marks of the effect ``encoder_ring``.

    uneven: the density of marks along a turn u is 1 + uneven cos(2 pi u). missing: share of a turn,
    from its start, without marks, in whole marks and at least one; below 0 these marks are doubled.
    phase [turn]: position of the gear on the ring at the start.
    """
    edges = [_warp(edge, uneven) for edge in ring.edges]
    bad = max(1, round(abs(missing) * ring.n)) if missing else 0
    ends = [*edges[1:], edges[0] + 1.0]
    # A doubled mark has a further edge in the middle of its interval.
    middles = [0.5 * (a + b) for a, b in zip(edges[:bad], ends, strict=False)]
    edges = edges[bad:] if missing > 0.0 else edges + middles
    return EncoderRing(tuple(sorted((edge - phase) % 1.0 for edge in edges)))


def double_ring(ring: EncoderRing) -> EncoderRing:
    """Return a ring whose one turn is two turns of the given ring."""
    return EncoderRing(tuple(0.5 * (edge + turn) for turn in (0, 1) for edge in ring.edges))


def _warp(edge: float, uneven: float) -> float:
    """Solve u + uneven sin(2 pi u) / (2 pi) = edge for u by Newton's method, |uneven| < 1."""
    u = edge
    for _ in range(20):
        angle = 2.0 * math.pi * u
        error = u + uneven * math.sin(angle) / (2.0 * math.pi) - edge
        u -= error / (1.0 + uneven * math.cos(angle))
    return u
